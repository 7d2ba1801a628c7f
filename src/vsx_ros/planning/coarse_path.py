"""A path of arcs and straight lines: Reeds-Shepp words, and shortcuts by them. (``lattice_ways.py`` searches one in the
map.)"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import reverse_run, word_is_free
from vsx_ros.kernels.planning.reeds_shepp import reeds_shepp_shortest, reeds_shepp_words, room_for
from vsx_ros.kernels.planning.shortcuts import MAX_SEGMENTS, shorten, way_cost
from vsx_ros.planning.pieces import Piece, arc_piece

_SHORTEST_M = 1e-9  # shorter pieces are rounding
_SHORTCUTS, _SHORTCUTS_PER_M = 300, 30  # random ones tried per path: at least, and for a long one


class ArcBounds(NamedTuple):
    """Bounds of arcs and lines: the field in which they stay, their curvature phi [rad/m], and the longest leg in
    reverse [m]."""

    margin: DistanceField
    phi: float
    max_reverse_m: float


@dataclass(frozen=True, slots=True, eq=False)
class CoarsePath:
    """turns (S,) +1 left, -1 right, 0 straight; lengths (S,) [m], negative in reverse; at curvature phi [rad/m]."""

    turns: IntArray
    lengths: FloatArray
    phi: float

    @property
    def length_m(self) -> float:
        """Arc length in both directions together [m]."""
        return float(np.abs(self.lengths).sum())

    @property
    def longest_reverse_m(self) -> float:
        """The longest leg driven in reverse [m]."""
        return float(reverse_run(self.lengths))

    def cost_m(self, cusp_cost_m: float) -> float:
        """Length plus the cost of cusps [m]."""
        return float(way_cost(self.lengths, cusp_cost_m))

    def cut(self, longest_m: float, longest_radii: float) -> tuple[CoarsePath, frozenset[int]]:
        """The same path with straight lines cut, and the segments that end at a cut: those above longest_m in the
        middle, those above longest_radii one radius (1 / phi) from both ends."""
        turns: list[int] = []
        lengths: list[float] = []
        cuts: set[int] = set()
        for turn, length in zip(self.turns.tolist(), self.lengths.tolist()):
            parts = [length]
            if turn == 0 and abs(length) > longest_radii / self.phi:
                end = math.copysign(1.0 / self.phi, length)
                parts = [end, length - 2.0 * end, end]
            elif turn == 0 and abs(length) > longest_m:
                parts = [0.5 * length, 0.5 * length]
            cuts |= set(range(len(turns), len(turns) + len(parts) - 1))
            turns += [turn] * len(parts)
            lengths += parts
        return CoarsePath(np.array(turns, np.int64), np.array(lengths), self.phi), frozenset(cuts)

    def driven_back(self) -> CoarsePath:
        """The same curve, driven backwards by a base turned by 180 degrees: forward stays forward."""
        return CoarsePath(-self.turns[::-1], self.lengths[::-1].copy(), self.phi)

    def part(self, first: int, last: int) -> CoarsePath:
        """Its segments from ``first`` on, before ``last``."""
        return CoarsePath(self.turns[first:last], self.lengths[first:last], self.phi)

    def joined(self) -> CoarsePath:
        """The same path in as few segments as possible, without those whose length is rounding."""
        keep = np.abs(self.lengths) >= _SHORTEST_M
        turns, lengths = self.turns[keep], self.lengths[keep]
        first = np.ones(len(turns), np.bool_)
        first[1:] = (turns[1:] != turns[:-1]) | (lengths[1:] * lengths[:-1] < 0.0)
        return (
            CoarsePath(turns[first], np.add.reduceat(lengths, np.flatnonzero(first)), self.phi) if len(turns) else self
        )

    def arcs(self, start: SE2) -> list[Piece]:
        """An arc or line for every segment."""
        at, pieces = start, []
        for turn, length in zip(self.turns.tolist(), self.lengths.tolist()):
            direction = 1 if length > 0 else -1
            pieces.append(arc_piece(at, turn * direction * self.phi, abs(length), direction))
            at = pieces[-1].end
        return pieces

    def pieces(self, start: SE2) -> tuple[Piece, ...]:
        """Arcs and lines, without those of zero length."""
        return tuple(self.joined().arcs(start))


def nanometres(cost_m: float) -> int:
    """Key to order costs: of equal costs the first is taken, whatever rounding a processor adds."""
    return round(1e9 * cost_m)


def words(start: SE2, goal: SE2, phi: float) -> list[CoarsePath]:
    """All Reeds-Shepp words between two poses at curvature phi [rad/m]."""
    relative = start.inverse() @ goal
    found = reeds_shepp_words(phi * relative.x, phi * relative.y, relative.theta)
    return [CoarsePath(turns, lengths / phi, phi) for turns, lengths in zip(*found)]


def shortest_word(start: SE2, goal: SE2, phi: float) -> CoarsePath:
    """The shortest path of curvature phi, by arcs and lines (Reeds and Shepp)."""
    relative, word = start.inverse() @ goal, room_for(1)
    reeds_shepp_shortest(phi * relative.x, phi * relative.y, relative.theta, word)
    return CoarsePath(word.turns[0], word.lengths[0] / phi, phi)


def free_words(start: SE2, goal: SE2, bounds: ArcBounds) -> list[CoarsePath]:
    """The Reeds-Shepp words between two poses that keep the bounds, shortest first."""
    margin, phi, limit = bounds
    free = [
        word
        for word in words(start, goal, phi)
        if word.longest_reverse_m <= limit
        and word_is_free(margin, start.x, start.y, start.theta, word.turns, word.lengths * phi, phi)
    ]
    return sorted(free, key=lambda word: nanometres(word.length_m))


def shortened(
    coarse: CoarsePath, start: SE2, bounds: ArcBounds, cusp_cost_m: float, rng: np.random.Generator
) -> CoarsePath:
    """The coarse path after random shortcuts; a cusp counts as cusp_cost_m [m]."""
    coarse = coarse.joined()
    if len(coarse.turns) > MAX_SEGMENTS:
        return coarse
    seed = np.uint64(rng.integers(1, 2**62))
    turns, lengths = shorten(
        bounds.margin, start.as_array(), coarse.turns, coarse.lengths, coarse.phi, bounds.max_reverse_m, cusp_cost_m,
        seed, max(_SHORTCUTS, round(_SHORTCUTS_PER_M * coarse.length_m)),
    )  # fmt: skip
    return CoarsePath(turns, lengths, coarse.phi)
