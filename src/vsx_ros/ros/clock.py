"""ROS time, the clock of all stamps."""

import rospy

from vsx_ros.errors import InputError

_AHEAD_S = 1.0  # clocks of two machines with NTP differ by less


def now_ns() -> int:
    """ROS time, the clock of all stamps [ns]."""
    nanoseconds: int = rospy.Time.now().to_nsec()
    return nanoseconds


def refuse_future(stamp_ns: int) -> None:
    """Raises InputError for a reading of a second to come: beside it all others would be out of date until then."""
    ahead_s = (stamp_ns - now_ns()) * 1e-9
    if ahead_s > _AHEAD_S:
        raise InputError(
            f"a stamp {ahead_s:.1f} s ahead of this machine's clock is not believed; 'vsx doctor' compares the clocks"
        )
