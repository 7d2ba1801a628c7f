"""Whether the wheels turn while the camera stands: then the base pushes against something that no bumper feels."""

import math
from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

_STEP_M, _MEMORY = 0.005, 40  # by the wheels between two pairs that are kept; how many, 20 cm of way
# Beyond how much of a way by odometry it is judged, by how many poses in between, and how much of it must be seen.
_WAY_M, _POSES, _SHARE = 0.06, 3, 0.35
_JUMP_M = 0.02  # by which the camera moves farther than odometry when it is the map that moved
_UNSEEN_M = (1.0 - _SHARE) * _WAY_M  # by which the wheels move farther in one step when the camera saw none of it


class Stuck(NamedTuple):
    """T_world_push: the base, turned to what it pushes against. reason: what is seen, in words."""

    T_world_push: SE2
    reason: str


class StuckDetector:
    """``add`` every pose that the camera found. ``stuck`` holds until the base is seen to move again."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[Odometry, SE2]] = deque(maxlen=_MEMORY)
        self.stuck: Stuck | None = None

    def add(self, odometry: Odometry, T_world_base: SE2) -> None:
        """The base at one instant, by odometry and as the camera saw it."""
        T_odom_base = odometry.T_odom_base
        if self._pairs:
            last, T_world_last = self._pairs[-1]
            counted_m = last.T_odom_base.distance_to(T_odom_base)
            unseen_m = counted_m - T_world_last.distance_to(T_world_base)
            if last.odom_epoch != odometry.odom_epoch or unseen_m < -_JUMP_M or unseen_m > _UNSEEN_M:
                self._pairs.clear()
            elif counted_m < _STEP_M:
                return
        self._pairs.append((odometry, T_world_base))
        seen_m = 0.0
        for back, (before, T_world_before) in enumerate(reversed(self._pairs)):
            seen_m = max(seen_m, T_world_before.distance_to(T_world_base))
            if before.T_odom_base.distance_to(T_odom_base) >= _WAY_M:
                counted = before.T_odom_base.inverse() @ T_odom_base
                self.stuck = _verdict(counted, T_world_base, seen_m) if back > _POSES else None
                if self.stuck is not None:  # the way from here on is judged by itself
                    self._pairs = deque([(odometry, T_world_base)], maxlen=_MEMORY)
                return


def _verdict(counted: SE2, T_world_base: SE2, seen_m: float) -> Stuck | None:
    way_m = math.hypot(counted.x, counted.y)
    if seen_m >= _SHARE * way_m:
        return None
    ahead = counted.x > 0.0
    push = T_world_base @ SE2(0.0, 0.0, 0.0 if ahead else math.pi)
    where = "ahead" if ahead else "back"
    return Stuck(push, f"stuck: the wheels turned {way_m:.2f} m {where}, the camera moved {seen_m:.2f} m")
