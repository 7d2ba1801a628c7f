"""A pose on the floor that is moved along arcs."""

from __future__ import annotations

import math


class PlanarPose:
    """x_m, y_m, heading_rad, not wrapped; the origin at first."""

    def __init__(self) -> None:
        self.x_m = self.y_m = self.heading_rad = 0.0

    def advance(self, distance_m: float, turn_rad: float) -> None:
        """Along the arc, exactly."""
        half = 0.5 * turn_rad
        chord = distance_m if abs(half) < 1e-9 else distance_m * math.sin(half) / half
        self.x_m += chord * math.cos(self.heading_rad + half)
        self.y_m += chord * math.sin(self.heading_rad + half)
        self.heading_rad += turn_rad

    def approach(self, goal: PlanarPose, most_m: float, most_rad: float) -> None:
        """Towards another pose, by so much at most."""
        dx, dy, turn = goal.x_m - self.x_m, goal.y_m - self.y_m, goal.heading_rad - self.heading_rad
        share = min(1.0, most_m / max(math.hypot(dx, dy), 1e-12))
        self.x_m += share * dx
        self.y_m += share * dy
        self.heading_rad += max(-most_rad, min(most_rad, turn))
