"""A pose with its time: what trajectories are made of."""

from typing import NamedTuple

from vsx_ros.geometry.se3 import SE3


class StampedPose(NamedTuple):
    """stamp_ns: time [ns]. T: the pose at that time; the owner says of what in what."""

    stamp_ns: int
    T: SE3
