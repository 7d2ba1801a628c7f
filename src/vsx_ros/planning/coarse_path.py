"""A way through the map by arcs and straight lines: lattice search, then shortcuts."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import lattice_search, lattice_way, reverse_run, word_is_free
from vsx_ros.kernels.planning.motions import Lattice
from vsx_ros.kernels.planning.reeds_shepp import reeds_shepp_shortest, reeds_shepp_words, room_for
from vsx_ros.kernels.planning.reeds_shepp_table import reeds_shepp_table
from vsx_ros.kernels.planning.shortcuts import shorten
from vsx_ros.occupancy.distance import travel_distance, with_fringe
from vsx_ros.planning.path import CUSP_COST_M
from vsx_ros.planning.pieces import Piece, arc_piece

_ARC_M = 0.27
_SHORTEST_M = 1e-9
_CELL_M = 0.1
_COARSE_STATES, _BACK_STATES, _FINE_STATES, _FEW_STATES = 5_000_000, 40_000, 120_000, 200
_SHORTCUTS = 300
OCTILE = 0.924
"""A straight line is at least this share of the 8-connected way along it."""


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

    def halved(self, longest_m: float) -> tuple[CoarsePath, frozenset[int]]:
        """The same way with longer straight lines cut in the middle, and the segments that end at such a cut."""
        turns: list[int] = []
        lengths: list[float] = []
        cuts: list[int] = []
        for turn, length in zip(self.turns.tolist(), self.lengths.tolist()):
            if turn == 0 and abs(length) > longest_m:
                cuts.append(len(turns))
                turns += [0, 0]
                lengths += [0.5 * length, 0.5 * length]
            else:
                turns.append(turn)
                lengths.append(length)
        return CoarsePath(np.array(turns, np.int64), np.array(lengths), self.phi), frozenset(cuts)

    def legs(self) -> list[CoarsePath]:
        """The ways between changes of direction."""
        keep = np.abs(self.lengths) >= _SHORTEST_M
        turns, lengths = self.turns[keep], self.lengths[keep]
        cusps = np.flatnonzero(lengths[1:] * lengths[:-1] < 0.0) + 1
        parts = zip(np.split(turns, cusps), np.split(lengths, cusps))
        return [CoarsePath(part, size, self.phi) for part, size in parts if len(part)]

    def parted(self) -> list[CoarsePath]:
        """The way in two parts: cut at the middle one of its changes of direction, else between its segments."""
        legs = self.legs()
        sizes = [len(leg.turns) for leg in legs]
        half = sum(sizes[: len(legs) // 2]) if len(legs) > 1 else sizes[0] // 2
        turns, lengths = (np.concatenate([getattr(leg, name) for leg in legs]) for name in ("turns", "lengths"))
        return [CoarsePath(turns[:half], lengths[:half], self.phi), CoarsePath(turns[half:], lengths[half:], self.phi)]

    def arcs(self, start: SE2) -> list[Piece]:
        """An arc or line for every segment."""
        at, pieces = start, []
        for turn, length in zip(self.turns.tolist(), self.lengths.tolist()):
            direction = 1 if length > 0 else -1
            pieces.append(arc_piece(at, turn * direction * self.phi, abs(length), direction))
            at = pieces[-1].end
        return pieces

    def pieces(self, start: SE2) -> tuple[Piece, ...]:
        """Arcs and lines without those of no length."""
        return tuple(piece for piece in self.arcs(start) if piece.length_m >= _SHORTEST_M)


def nanometres(cost_m: float) -> int:
    """By which costs are ordered: of equal ones the first is taken, whatever rounding a processor adds."""
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


def free_words(margin: DistanceField, start: SE2, goal: SE2, phi: float, max_reverse_m: float) -> list[CoarsePath]:
    """The Reeds-Shepp words between two poses that stay in the margin field, shortest first."""
    free = [
        word
        for word in words(start, goal, phi)
        if word.longest_reverse_m <= max_reverse_m
        and word_is_free(margin, start.x, start.y, start.theta, word.turns, word.lengths * phi, phi)
    ]
    return sorted(free, key=lambda word: nanometres(word.length_m))


@functools.cache
def word_table() -> Float32Array:
    """The lengths of shortest words, by which the search is guided; computed once, it is the same for every phi."""
    table = reeds_shepp_table()
    table.flags.writeable = False
    return table


def coarse_lattice(phi: float) -> Lattice:
    """Arcs of about 0.27 m."""
    headings = int(min(max(round(2.0 * math.pi / (phi * _ARC_M)), 16), 32))
    bins = max(1, math.ceil(1.6 * _CELL_M * phi * headings / (2.0 * math.pi)))
    return Lattice(headings, bins, _CELL_M, _COARSE_STATES)


def back_lattice(phi: float) -> Lattice:
    """The coarse one with fewer states, for a start that only the word at the end may reach."""
    return coarse_lattice(phi)._replace(most_states=_BACK_STATES)


def fine_lattice(phi: float) -> Lattice:
    """Half the cells and half the arcs, for manoeuvres where there is hardly room."""
    coarse = coarse_lattice(phi)
    return Lattice(2 * coarse.headings, coarse.bins, 0.5 * coarse.cell_m, _FINE_STATES)


def search_lattice(
    margin: DistanceField,
    start: SE2,
    goal: SE2,
    phi: float,
    max_reverse_m: float,
    remaining: FloatArray,
    lattice: Lattice,
) -> CoarsePath | None:
    """The cheapest way over the lattice, ended exactly on the goal by a Reeds-Shepp word; None when there is none.

    remaining (H, W): ``travel_distance`` from the goal.
    """
    poses, parents, motions, step, winner = _searched(margin, start, goal, phi, max_reverse_m, remaining, lattice)
    if winner < 0:
        return None
    turns, lengths = lattice_way(poses, parents, motions, winner, step, goal.as_array(), phi)
    return CoarsePath(turns, lengths, phi)


def search_lattice_back(
    margin: DistanceField, start: SE2, goal: SE2, phi: float, max_reverse_m: float, lattice: Lattice
) -> CoarsePath | None:
    """As ``search_lattice``, from the goal: the start is what the word ends on. For starts without room for an arc."""
    remaining = with_fringe(travel_distance(margin, (start.x, start.y)), margin.resolution)
    way = search_lattice(margin, about_turn(goal), about_turn(start), phi, max_reverse_m, remaining, lattice)
    # The same curve, driven the other way by a base that faces the other way: forward stays forward.
    return None if way is None else CoarsePath(-way.turns[::-1], way.lengths[::-1].copy(), phi)


def about_turn(pose: SE2) -> SE2:
    """The pose facing the other way."""
    return SE2(pose.x, pose.y, pose.theta + math.pi)


def is_stuck(margin: DistanceField, pose: SE2, target: SE2, phi: float, max_reverse_m: float, lattice: Lattice) -> bool:
    """Whether the arcs of a lattice lead no further from a pose, towards a target, than to a few states."""
    few = lattice._replace(most_states=_FEW_STATES)
    nothing_known = np.zeros(margin.values.shape)
    poses, *_, winner = _searched(margin, pose, target, phi, max_reverse_m, nothing_known, few)
    return winner < 0 and len(poses) < _FEW_STATES


def _searched(
    margin: DistanceField,
    start: SE2,
    goal: SE2,
    phi: float,
    max_reverse_m: float,
    remaining: FloatArray,
    lattice: Lattice,
) -> tuple[FloatArray, IntArray, NDArray[np.int8], float, int]:
    bound = np.where(np.isfinite(remaining), OCTILE * remaining, 1e6)
    return lattice_search(margin, start.as_array(), phi, lattice, max_reverse_m, goal.as_array(), bound, word_table())


def shortened(
    coarse: CoarsePath, margin: DistanceField, start: SE2, max_reverse_m: float, rng: np.random.Generator
) -> CoarsePath:
    """The coarse path after random shortcuts."""
    turns, lengths = shorten(
        margin, start.as_array(), coarse.turns, coarse.lengths, coarse.phi, max_reverse_m, CUSP_COST_M,
        np.uint64(rng.integers(1, 2**62)), _SHORTCUTS,
    )  # fmt: skip
    return CoarsePath(turns, lengths, coarse.phi)
