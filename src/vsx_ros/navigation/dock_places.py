"""Places before a dock, from which its light is looked for."""

import math

from vsx_ros.geometry.se2 import SE2

_AROUND_RAD = math.radians(35.0)
_MOVED_M, _MOVED_RAD = 0.05, 0.1  # of the dock with the map: its places are driven to anew


class PlacesBefore:
    """One on the axis of the dock, then one to each side of it."""

    def __init__(self, stand_m: float) -> None:
        """stand_m: how far they are from the dock [m]."""
        self._stand_m, self._left_rad = stand_m, [0.0, _AROUND_RAD, -_AROUND_RAD]  # directions, seen from the dock
        self._around_rad, self._given_for = 0.0, SE2()

    @property
    def all_tried(self) -> bool:
        """Whether there is no other place."""
        return not self._left_rad

    def goal(self, T_map_dock: SE2, another: bool) -> SE2 | None:
        """A pose that faces the dock, in the map: at another place, or at the same one if the dock has moved since it
        was given; None if it has not."""
        before, self._around_rad = self._given_for, self._left_rad.pop(0) if another else self._around_rad
        stays = before.distance_to(T_map_dock) <= _MOVED_M and abs(before.angle_to(T_map_dock)) <= _MOVED_RAD
        if stays and not another:
            return None
        self._given_for = T_map_dock
        return T_map_dock @ SE2(0.0, 0.0, self._around_rad) @ SE2(self._stand_m, 0.0, math.pi)
