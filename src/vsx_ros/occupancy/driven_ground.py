"""The ground that the base has driven over, that was promised to be free, and that it has bumped into."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy import ground_cells
from vsx_ros.kernels.occupancy.ground_cells import Lattice

_BUMP_ARC_RAD = 1.0  # to each side: the bumper does not show more exactly where it was hit
_BUMP_AHEAD_M = 0.05  # of the body: a cell
_SHADOW_CELLS = 0.75  # to each side of the middle of a cell: about half a cell, turned by any angle


class DriveHistory(NamedTuple):
    """The base's history. trail: driven poses, free as wide as the robot. bumps: poses where a bumper was pressed; an
    arc in front of each stays occupied. start: ``start_clear_m`` of floor in front of it are promised to be free, up to
    what is seen or touched there. passed (N,): index of the newest keyframe when the base was last at each pose of the
    trail. What later keyframes see there was put there since. None: all keyframes are older."""

    trail: Sequence[SE2] = ()
    bumps: Sequence[SE2] = ()
    start: SE2 | None = None
    passed: IntArray | None = None

    def places(self, start_clear_m: float) -> Points2:
        """(N, 2) driven and promised points [m], which the grid must cover."""
        ahead = [(self.start @ np.array([[start_clear_m, 0.0]]))[0]] if self.start else []
        poses = [(pose.x, pose.y) for pose in (*self.trail, *([self.start] if self.start else []))]
        return np.array([*poses, *ahead]).reshape(-1, 2)

    def last_pass(self, n_keyframes: int, radius_m: float, lattice: Lattice) -> Int32Array:
        """(rows, columns) index of the newest keyframe when a body of radius_m [m] last covered the middle of each
        cell; -1 where it never did."""
        places = np.array([(pose.x, pose.y) for pose in self.trail]).reshape(-1, 2)
        passed = np.full(len(places), n_keyframes) if self.passed is None else np.maximum(self.passed, 0)
        return ground_cells.cover_discs(places, passed.astype(np.int64), radius_m, lattice)

    def promised(self, start_clear_m: float, radius_m: float, lattice: Lattice, occupied: BoolArray) -> BoolArray:
        """(rows, columns) the promised floor: from behind the robot to start_clear_m [m] in front, a little wider than
        its body of radius_m [m]. Of that, nothing behind what is seen to be occupied (rows, columns), and nothing
        farther than a base that was stopped there has come."""
        strip, start = np.zeros((lattice.rows, lattice.columns), bool), self.start
        if start is None:
            return strip
        x, y = lattice.centres()
        half_width = radius_m + 2 * lattice.resolution
        reach = max(half_width, start_clear_m) + half_width
        columns, rows = np.abs(x[0] - start.x) <= reach, np.abs(y[:, 0] - start.y) <= reach
        x, y = x[:, columns], y[rows]
        c, s = math.cos(start.theta), math.sin(start.theta)
        forward = c * (x - start.x) + s * (y - start.y)
        left = -s * (x - start.x) + c * (y - start.y)
        ahead = (np.abs(left) <= half_width) & (forward >= -half_width) & (forward <= start_clear_m)
        driven = np.hypot(forward, left) <= radius_m
        seen = ahead & (forward > 0.0) & occupied[np.ix_(rows, columns)]
        ahead &= driven | ~_behind(forward, left, seen, lattice.resolution)
        for stop in self._stopped(start, radius_m):
            ahead &= driven | (forward <= stop.x) | (np.hypot(forward - stop.x, left - stop.y) <= radius_m)
        strip[np.ix_(rows, columns)] = ahead
        return strip

    def _stopped(self, start: SE2, radius_m: float) -> list[SE2]:
        """Where the way straight ahead from the start ends at bumps, seen from the start."""
        stops = []
        for bump in self.bumps:
            base = start.inverse() @ bump
            touched = base @ SE2(radius_m + _BUMP_AHEAD_M, 0.0, 0.0)
            if touched.x > 0.0 and abs(touched.y) <= radius_m:
                stops.append(SE2(max(0.0, min(base.x, touched.x)), base.y, base.theta))
        return stops

    def bump_points(self, radius_m: float, cell_m: float) -> Points2:
        """(N, 2) points of the arcs just in front of the bumper of a body of radius_m [m], closer than cells [m]."""
        radius = radius_m + _BUMP_AHEAD_M
        n = 2 * math.ceil(2 * _BUMP_ARC_RAD * radius / cell_m)
        angles = np.linspace(-_BUMP_ARC_RAD, _BUMP_ARC_RAD, n)
        arc = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.vstack([np.zeros((0, 2)), *(pose @ arc for pose in self.bumps)])


def _behind(forward: FloatArray, left: FloatArray, seen: BoolArray, cell_m: float) -> BoolArray:
    """(H, W) which cells lie behind one of those that are seen (H, W); forward, left: (H, W) their places [m]."""
    beside = np.abs(left[..., None] - left[seen]) < _SHADOW_CELLS * cell_m
    return np.asarray((beside & (forward[..., None] > forward[seen])).any(axis=-1))
