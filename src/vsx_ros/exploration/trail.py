"""The way the robot came, by odometry: the one piece of ground that is surely free."""

from itertools import pairwise

from vsx_ros.geometry.se2 import SE2

_TURN_RAD = 0.2


class Trail:
    """Poses at least spacing_m [m] or a turn on the spot apart, oldest first; driving back along it shortens it."""

    def __init__(self, spacing_m: float, length_m: float = 5.0) -> None:
        self._spacing_m = spacing_m
        self._capacity = max(2, int(length_m / spacing_m))
        self._poses: list[SE2] = []
        self._epoch: int | None = None

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses(self) -> tuple[SE2, ...]:
        """The trail, oldest first."""
        return tuple(self._poses)

    def enter_epoch(self, odom_epoch: int) -> bool:
        """Whether it is another one than last time; then nobody knows where the poses lie, and they are forgotten."""
        other = self._epoch not in (None, odom_epoch)
        self._epoch = odom_epoch
        if other:
            self.clear()
        return other

    def clear(self) -> None:
        """The base was carried: the way it came is not behind it."""
        self._poses.clear()

    def add(self, T_odom_base: SE2) -> None:
        """Append the pose when it is far enough from the last one."""
        last = self._poses[-1] if self._poses else None
        if (
            last is None
            or last.distance_to(T_odom_base) >= self._spacing_m
            or abs(last.angle_to(T_odom_base)) >= _TURN_RAD
        ):
            self._poses.append(T_odom_base)
            del self._poses[: -self._capacity]

    @property
    def length_m(self) -> float:
        """The way along the trail [m]."""
        return sum(a.distance_to(b) for a, b in pairwise(self._poses))

    def driven_back_to(self, T_odom_base: SE2) -> None:
        """Let the trail of a robot that backs along it end where the robot is by now."""
        poses, per_rad_m = self._poses, self._spacing_m / _TURN_RAD

        def off_m(pose: SE2) -> float:
            return pose.distance_to(T_odom_base) + per_rad_m * abs(pose.angle_to(T_odom_base))

        while len(poses) > 1 and off_m(poses[-2]) <= off_m(poses[-1]):
            poses.pop()

    def back(self, distance_m: float) -> SE2 | None:
        """The pose about distance_m [m] before the end, or nearer, where the robot changed between ahead and reverse or
        had turned on the spot: a drive that cut this corner would leave the trail. The pose before the turn, where the
        trail ends with one. None on a short trail."""
        if len(self._poses) < 2:
            return None
        at, back_m, before = len(self._poses) - 1, 0.0, 0
        while at > 0 and back_m < distance_m - 0.5 * self._spacing_m:
            step = self._poses[at - 1].inverse() @ self._poses[at]
            moved_m = step.distance_to(SE2())
            kind = 0 if moved_m < 0.5 * self._spacing_m else 1 if step.x > 0.0 else -1
            if at < len(self._poses) - 1 and kind != before:
                break
            before, back_m, at = kind, back_m + moved_m, at - 1
        return self._poses[at]
