"""Where the camera has looked from."""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2


class ViewpointHistory:
    """A pose for every bit of way or turn, spacing [m and rad] apart, oldest first."""

    def __init__(self, spacing: float) -> None:
        self._spacing = spacing
        self.poses: list[SE2] = []

    def add(self, T_map_base: SE2) -> None:
        """Remember the pose if it is far enough from the last one."""
        last = self.poses[-1] if self.poses else None
        if (
            last is None
            or last.distance_to(T_map_base) > self._spacing
            or abs(last.angle_to(T_map_base)) > self._spacing
        ):
            self.poses.append(T_map_base)

    def as_array(self) -> FloatArray:
        """(N, 3) x, y [m], theta [rad]."""
        return np.array([pose.as_array() for pose in self.poses]).reshape(-1, 3)
