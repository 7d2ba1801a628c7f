"""Message headers: a stamp in ROS time, and a frame by its global name.

All robots of a master share one tf tree, so a robot in a namespace uses a prefix. Inside a node, frames have the names
of topics.py. In messages they have the prefix: the parameter ``tf_prefix`` of this or a higher namespace, else the
namespace itself."""

import threading

import rospy
from std_msgs.msg import Header

from vsx_ros.errors import InputError

_AHEAD_S = 1.0  # the clocks of two machines with NTP differ by less

_prefix = ""
_timing = threading.Lock()
_timer_ns = _timed_ns = 0


def now_ns() -> int:
    """ROS time, the clock of all stamps [ns]."""
    return int(rospy.Time.now().to_nsec())


def timer_ns() -> int:
    """ROS time to wait by in this process [ns]: it goes on where the clock is set back, unlike stamps."""
    global _timer_ns, _timed_ns
    with _timing:
        now = now_ns()
        _timer_ns, _timed_ns = _timer_ns + max(0, now - _timed_ns), now
        return _timer_ns


def refuse_future(stamp_ns: int) -> None:
    """Raises InputError for a stamp over 1 s in the future: until then, all other readings would look out of date. Also
    while ROS time has not begun."""
    if (clock_ns := now_ns()) == 0:
        raise InputError(
            "ROS time stands: /use_sim_time is set and nobody publishes /clock; 'rosparam delete /use_sim_time' and "
            "start the nodes anew, or play the bag with --clock"
        )
    ahead_s = (stamp_ns - clock_ns) * 1e-9
    if ahead_s > _AHEAD_S:
        raise InputError(
            f"a stamp {ahead_s:.1f} s ahead of this machine's clock is not believed; 'vsx doctor' compares the clocks"
        )


def adopt_prefix() -> dict[str, object]:
    """Read the prefix from the parameters or the namespace; called once, after the node has joined the master. Returns
    the parameter, if there is one, by its full name."""
    global _prefix  # one per process, like rospy's node
    key = rospy.search_param("tf_prefix")
    said = rospy.get_param(key) if key else rospy.get_namespace()
    _prefix = str(said).strip("/")
    return {key: said} if key else {}


def own(name: str) -> str:
    """The global name of this robot's frame: map -> robot1/map. An empty name stays empty."""
    return f"{_prefix}/{name}" if _prefix and name else name


def bare(frame_id: str) -> str:
    """The name of this robot's frame without prefix; other frames stay. Removes an old-style leading slash."""
    return frame_id.lstrip("/").removeprefix(f"{_prefix}/")


def header(frame_id: str, stamp_ns: int) -> Header:
    """A message header with the frame's global name."""
    return Header(stamp=rospy.Time(0, stamp_ns), frame_id=own(frame_id))
