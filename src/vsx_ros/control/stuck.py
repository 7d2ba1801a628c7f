"""Detects wheels that turn while the camera stands: the base then pushes against something that no bumper feels."""

import math
from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

_STEP_M, _PAIRS = 0.005, 40  # wheel distance between two stored pairs; their number, for 20 cm
# Least wheel distance over which it is judged and least number of poses in between; share that the camera must see.
_WAY_M, _POSES, _SHARE = 0.06, 3, 0.35
_ELSEWHERE_M = 0.1  # seen so far from where it pushed: it slips on, or somebody has moved it
_MAP_JUMP_M = 0.02  # if the camera moves farther than odometry by more, the map has moved
# If the wheels move farther in one step by more, the camera did not see it, or their counts have jumped: from image to
# image, or, where images are slow, at this speed and up to this long.
_UNSEEN_M, _FAST_M_S, _SLOWEST_S = (1.0 - _SHARE) * _WAY_M, 0.5, 0.5


class Stuck(NamedTuple):
    """T_world_push: the base, turned towards what it pushes against. reason: in words."""

    T_world_push: SE2
    reason: str


class StuckDetector:
    """Call ``add`` with every pose from the camera. ``stuck`` is set until the base is seen to move again or elsewhere,
    or is lifted."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[Odometry, SE2]] = deque(maxlen=_PAIRS)
        self._seen_ns = 0  # when the camera gave a pose last
        self.stuck: Stuck | None = None

    def lifted(self) -> None:
        """The base is in the air, or was put down: it pushes against nothing, and stands anywhere."""
        self._pairs.clear()
        self.stuck = None

    def add(self, odometry: Odometry, T_world_base: SE2) -> None:
        """Take the base's pose at one instant, by odometry and by the camera."""
        T_odom_base = odometry.T_odom_base
        within_s, self._seen_ns = 1e-9 * (odometry.stamp_ns - self._seen_ns), odometry.stamp_ns
        if self.stuck is not None and self.stuck.T_world_push.distance_to(T_world_base) > _ELSEWHERE_M:
            self.stuck = None
        if self._pairs:
            last, T_world_last = self._pairs[-1]
            counted_m = last.T_odom_base.distance_to(T_odom_base)
            unseen_m = counted_m - T_world_last.distance_to(T_world_base)
            is_unseen = unseen_m > max(_UNSEEN_M, _FAST_M_S * min(within_s, _SLOWEST_S))
            if last.odom_epoch != odometry.odom_epoch or unseen_m < -_MAP_JUMP_M or is_unseen:
                self._pairs.clear()
            elif counted_m < _STEP_M:
                return
        self._pairs.append((odometry, T_world_base))
        seen_m = 0.0
        for back, (before, T_world_before) in enumerate(reversed(self._pairs)):
            seen_m = max(seen_m, T_world_before.distance_to(T_world_base))
            if back > _POSES and before.T_odom_base.distance_to(T_odom_base) >= _WAY_M:
                self.stuck = _verdict(before.T_odom_base.inverse() @ T_odom_base, T_world_base, seen_m)
                if self.stuck is not None:  # the drive from here on is judged separately
                    self._pairs = deque([(odometry, T_world_base)], maxlen=_PAIRS)
                return


def _verdict(counted: SE2, T_world_base: SE2, seen_m: float) -> Stuck | None:
    way_m = math.hypot(counted.x, counted.y)
    if seen_m >= _SHARE * way_m:
        return None
    ahead = counted.x > 0.0
    push = T_world_base @ SE2(0.0, 0.0, 0.0 if ahead else math.pi)
    where = "ahead" if ahead else "back"
    return Stuck(push, f"stuck: the wheels turned {way_m:.2f} m {where}, the camera moved {seen_m:.2f} m")
