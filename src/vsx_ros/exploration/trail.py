"""The way the robot came, by odometry: the one piece of ground that is surely free."""

from __future__ import annotations

from vsx_ros.geometry.se2 import SE2


class Trail:
    """Poses at least spacing_m [m] apart, oldest first; driving back shortens it."""

    def __init__(self, spacing_m: float, length_m: float = 5.0) -> None:
        self._spacing_m = spacing_m
        self._capacity = max(2, int(length_m / spacing_m))
        self._poses: list[SE2] = []

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses(self) -> tuple[SE2, ...]:
        """The trail, oldest first."""
        return tuple(self._poses)

    def add(self, T_odom_base: SE2) -> None:
        """Append the pose when it is far enough from the last one."""
        if not self._poses or self._poses[-1].distance_to(T_odom_base) >= self._spacing_m:
            self._poses.append(T_odom_base)
            del self._poses[: -self._capacity]

    def pop_back(self, distance_m: float) -> SE2 | None:
        """The pose about distance_m [m] back along the trail, which ends there from now on; None on a short trail."""
        if len(self._poses) < 2:
            return None
        back_m = 0.0
        while len(self._poses) > 1 and back_m < distance_m - 0.5 * self._spacing_m:
            back_m += self._poses.pop().distance_to(self._poses[-1])
        return self._poses[-1]
