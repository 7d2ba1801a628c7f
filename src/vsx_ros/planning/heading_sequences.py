"""Heading sequences: which way to drive and how far to turn, piece by piece, before any curve is computed.

A Reeds-Shepp word tells it for free space. Where the word bends one way, straight or not, without changing direction,
one piece suffices, because the joint optimisation puts the straight length where it is best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning.reeds_shepp import reeds_shepp_shortest, reeds_shepp_words, room_for
from vsx_ros.planning.path import CUSP_COST_M

_SHORTEST_SEGMENT = 1e-6


@dataclass(frozen=True, slots=True)
class HeadingSequence:
    """One entry a piece: direction (+1, -1) and signed turn [rad]; joints[k] tells whether the path runs on
    without stopping from piece k to k + 1. length_m: of the word it comes from; shortest_m: of its shortest piece.
    members[k]: which segments of the word piece k replaces.
    """

    directions: tuple[int, ...]
    turns: tuple[float, ...]
    joints: tuple[bool, ...]
    length_m: float
    shortest_m: float
    members: tuple[tuple[int, ...], ...]

    @property
    def cusps(self) -> int:
        """How often the driving direction changes."""
        return sum(not joint for joint in self.joints)

    def ends(self, k: int) -> tuple[bool, bool]:
        """Whether piece k is joined to the one before and to the one after."""
        return k > 0 and self.joints[k - 1], k < len(self.joints) and self.joints[k]


def merge_segments(
    turns: IntArray, lengths: FloatArray, phi: float, total_turn: float, breaks: frozenset[int] = frozenset()
) -> HeadingSequence | None:
    """The sequence of a word: turns (S,) in -1, 0, 1 and signed lengths (S,) [m] at curvature phi.

    The headings are made to add up to total_turn modulo a full circle exactly. After a segment in breaks, which must be
    straight, a new piece begins in any case. None for a word without length.
    """
    directions: list[int] = []
    bends: list[int] = []
    angles: list[float] = []
    sizes: list[float] = []
    joints: list[bool] = []
    members: list[list[int]] = []
    for index, (bend, length) in enumerate(zip(turns.tolist(), lengths.tolist())):
        if abs(length) * phi < _SHORTEST_SEGMENT:
            continue
        direction = 1 if length > 0 else -1
        same = bool(directions) and directions[-1] == direction
        if same and members[-1][-1] not in breaks and (bend == 0 or bends[-1] in (0, bend)):
            bends[-1] = bends[-1] or bend
            angles[-1] += bend * length * phi
            sizes[-1] += abs(length)
            members[-1].append(index)
            continue
        if directions:
            joints.append(same)
        directions.append(direction)
        bends.append(bend)
        angles.append(bend * length * phi)
        sizes.append(abs(length))
        members.append([index])
    if not directions:
        return None
    widest = int(np.argmax(np.abs(angles)))
    angles[widest] += wrap_angle(total_turn - sum(angles))
    return HeadingSequence(
        tuple(directions), tuple(angles), tuple(joints), sum(sizes), min(sizes), tuple(map(tuple, members))
    )


def shortest_segments(start: SE2, goal: SE2, phi: float) -> list[tuple[int, float]]:
    """(turn, signed length [m]) of the shortest Reeds-Shepp word between two poses at curvature phi [rad/m]."""
    relative = start.inverse() @ goal
    word = room_for(1)
    reeds_shepp_shortest(phi * relative.x, phi * relative.y, relative.theta, word)
    segments = zip(word.turns[0].tolist(), (word.lengths[0] / phi).tolist())
    return [(turn, length) for turn, length in segments if abs(length) > 1e-12]


def nanometres(cost_m: float) -> int:
    """By which costs are ordered: of equal ones the first is taken, whatever rounding a processor adds."""
    return round(1e9 * cost_m)


def free_space_sequences(start: SE2, goal: SE2, phi: float) -> list[HeadingSequence]:
    """The sequences of all Reeds-Shepp words between two poses at curvature phi [rad/m], cheapest first."""
    relative = start.inverse() @ goal
    words = reeds_shepp_words(phi * relative.x, phi * relative.y, relative.theta)
    sequences = [
        sequence
        for turns, lengths in zip(*words)
        if (sequence := merge_segments(turns, lengths / phi, phi, relative.theta)) is not None
    ]
    return sorted(sequences, key=lambda sequence: nanometres(sequence.length_m + CUSP_COST_M * sequence.cusps))
