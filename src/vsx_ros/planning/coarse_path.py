"""A path through the map of arcs and straight lines: lattice search, then shortcuts."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import lattice_search, lattice_way, reverse_run, word_is_free
from vsx_ros.kernels.planning.motions import Lattice, reeds_shepp_table
from vsx_ros.kernels.planning.reeds_shepp import reeds_shepp_shortest, reeds_shepp_words, room_for
from vsx_ros.kernels.planning.shortcuts import shorten
from vsx_ros.occupancy.distance import joined_distance
from vsx_ros.planning.pieces import Piece, arc_piece

_ARC_M = 0.27  # length of an arc of the lattice, if that gives 16 to 32 headings; about two cells
_SHORTEST_M = 1e-9  # shorter pieces are rounding
_CELL_M = 0.1  # of the lattice; half of it where the goal or start lies in a pocket
# Most states of each search, to limit memory and time; fewer than the last number mean a pocket.
_COARSE_STATES, _BACK_STATES, _FINE_STATES, _FEW_STATES = 5_000_000, 40_000, 120_000, 200
_SHORTCUTS = 300  # random ones tried per path
OCTILE = 0.924  # A straight line is at least this share of the 8-connected path along it


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

    def part(self, first: int, last: int) -> CoarsePath:
        """Its segments from ``first`` on, before ``last``."""
        return CoarsePath(self.turns[first:last], self.lengths[first:last], self.phi)

    def without_rounding(self) -> CoarsePath:
        """Without the segments whose length is rounding."""
        keep = np.abs(self.lengths) >= _SHORTEST_M
        return CoarsePath(self.turns[keep], self.lengths[keep], self.phi)

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
        return tuple(self.without_rounding().arcs(start))


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


@functools.cache
def word_table() -> Float32Array:
    """The lengths of shortest words, which guide the search; computed once, as they are the same for every phi."""
    table = reeds_shepp_table()
    table.flags.writeable = False
    return table


def coarse_lattice(phi: float) -> Lattice:
    """Arcs of about 0.27 m."""
    headings = int(min(max(round(2.0 * math.pi / (phi * _ARC_M)), 16), 32))
    bins = max(1, math.ceil(1.6 * _CELL_M * phi * headings / (2.0 * math.pi)))
    return Lattice(headings, bins, _CELL_M, _COARSE_STATES)


def search(start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray) -> CoarsePath | None:
    """A path over a lattice; tries from the start, from the goal, and with arcs half as long. None if there is none.

    remaining (H, W): ``travel_distance`` from the goal."""
    coarse = coarse_lattice(bounds.phi)
    fine = Lattice(2 * coarse.headings, coarse.bins, 0.5 * coarse.cell_m, _FINE_STATES)  # for narrow places
    way = search_lattice(start, goal, bounds, remaining, coarse)
    if way is None and is_stuck(start, goal, bounds, coarse):
        way = search_lattice_back(start, goal, bounds, coarse._replace(most_states=_BACK_STATES))
    if way is None and not is_stuck(_about_turn(goal), _about_turn(start), bounds, fine):
        way = search_lattice(start, goal, bounds, remaining, fine)
        way = way or search_lattice_back(start, goal, bounds, fine)
    return way


def search_lattice(
    start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray, lattice: Lattice
) -> CoarsePath | None:
    """The cheapest path over the lattice. A Reeds-Shepp word ends it exactly on the goal. None when there is none."""
    poses, parents, motions, step, winner = _searched(start, goal, bounds, remaining, lattice)
    if winner < 0:
        return None
    turns, lengths = lattice_way(poses, parents, motions, winner, step, goal.as_array(), bounds.phi)
    return CoarsePath(turns, lengths, bounds.phi)


def search_lattice_back(start: SE2, goal: SE2, bounds: ArcBounds, lattice: Lattice) -> CoarsePath | None:
    """As ``search_lattice``, but from the goal: the word ends on the start. For starts without room for an arc."""
    remaining = joined_distance(bounds.margin, (start.x, start.y))
    way = search_lattice(_about_turn(goal), _about_turn(start), bounds, remaining, lattice)
    # The same curve, driven backwards by a base turned by 180 degrees: forward stays forward.
    return None if way is None else CoarsePath(-way.turns[::-1], way.lengths[::-1].copy(), bounds.phi)


def _about_turn(pose: SE2) -> SE2:
    """The pose turned by 180 degrees."""
    return SE2(pose.x, pose.y, pose.theta + math.pi)


def is_stuck(pose: SE2, target: SE2, bounds: ArcBounds, lattice: Lattice) -> bool:
    """Whether the arcs of a lattice reach only a few states from a pose towards a target."""
    few = lattice._replace(most_states=_FEW_STATES)
    poses, *_, winner = _searched(pose, target, bounds, np.zeros(bounds.margin.values.shape), few)
    return winner < 0 and len(poses) < _FEW_STATES


def _searched(
    start: SE2, goal: SE2, bounds: ArcBounds, remaining: FloatArray, lattice: Lattice
) -> tuple[FloatArray, IntArray, NDArray[np.int8], float, int]:
    margin, phi, limit = bounds
    hopes = np.where(np.isfinite(remaining), OCTILE * remaining, 1e6)
    return lattice_search(margin, start.as_array(), phi, lattice, limit, goal.as_array(), hopes, word_table())


def shortened(
    coarse: CoarsePath, start: SE2, bounds: ArcBounds, cusp_cost_m: float, rng: np.random.Generator
) -> CoarsePath:
    """The coarse path after random shortcuts; a cusp counts as cusp_cost_m [m]."""
    seed = np.uint64(rng.integers(1, 2**62))
    turns, lengths = shorten(
        bounds.margin, start.as_array(), coarse.turns, coarse.lengths, coarse.phi, bounds.max_reverse_m, cusp_cost_m,
        seed, _SHORTCUTS,
    )  # fmt: skip
    return CoarsePath(turns, lengths, coarse.phi)
