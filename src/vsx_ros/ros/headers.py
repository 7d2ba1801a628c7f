"""What headers say: a stamp of ROS time, and a frame by the name that others know.

tf is one tree for all robots of a master, so a robot in a namespace has a prefix. Within a node frames are called by
the names of topics.py; messages carry them with the prefix: the parameter ``tf_prefix`` of the namespace or one above
it, else the namespace itself."""

import rospy
from std_msgs.msg import Header

from vsx_ros.errors import InputError

_AHEAD_S = 1.0  # clocks of two machines with NTP differ by less

_prefix = ""


def now_ns() -> int:
    """ROS time, the clock of all stamps [ns]."""
    return int(rospy.Time.now().to_nsec())


def refuse_future(stamp_ns: int) -> None:
    """Raises InputError for a reading of a second to come: beside it all others would be out of date until then."""
    ahead_s = (stamp_ns - now_ns()) * 1e-9
    if ahead_s > _AHEAD_S:
        raise InputError(
            f"a stamp {ahead_s:.1f} s ahead of this machine's clock is not believed; 'vsx doctor' compares the clocks"
        )


def adopt_prefix() -> None:
    """Learn the prefix from the namespace and the parameters; once, when the node has joined the master."""
    global _prefix  # as rospy's own node: one a process
    key = rospy.search_param("tf_prefix")
    said = rospy.get_param(key) if key else rospy.get_namespace()
    _prefix = str(said).strip("/")


def own(name: str) -> str:
    """The frame of this robot as others know it: map -> robot1/map. No name stays none."""
    return f"{_prefix}/{name}" if _prefix and name else name


def bare(frame_id: str) -> str:
    """The name of a frame of this robot without its prefix; any other frame as it is. A leading slash is old custom."""
    return frame_id.lstrip("/").removeprefix(f"{_prefix}/")


def header(frame_id: str, stamp_ns: int) -> Header:
    """A message header; the frame is called as others know it."""
    return Header(stamp=rospy.Time(0, stamp_ns), frame_id=own(frame_id))
