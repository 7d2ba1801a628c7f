"""The time by which the node vslam orders its images."""

from typing import TypeVar

from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.state import TrackingResult

StampedT = TypeVar("StampedT", Frame, Odometry, TrackingResult)


class SlamClock:
    """That of the stamps, but it goes on where they go back: a map needs its images in order. Thread-safe."""

    def __init__(self) -> None:
        self._ahead_ns = 0

    def set_back(self, by_ns: int) -> None:
        """Stamps are smaller by so much from now on."""
        self._ahead_ns += by_ns

    def entered(self, stamped: StampedT) -> StampedT:
        """What comes from a driver, in this time."""
        return stamped._replace(stamp_ns=stamped.stamp_ns + self._ahead_ns)

    def left(self, stamped: StampedT) -> StampedT:
        """What other nodes are told, in theirs."""
        return stamped._replace(stamp_ns=stamped.stamp_ns - self._ahead_ns)
