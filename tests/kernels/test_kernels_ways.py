"""Words and shortcuts over open ground and past a wall: every way is driven again, segment by segment."""

import math

import numpy as np
import pytest

from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import reverse_run, word_is_free
from vsx_ros.kernels.planning.motions import BENDS, MOTIONS, SIGNS, arc_places, places_are_free
from vsx_ros.kernels.planning.primitives import Grown, cone, grow
from vsx_ros.kernels.planning.reeds_shepp import advance, room_for, shortest_word
from vsx_ros.kernels.planning.shortcuts import SEGMENT_COST_M, random_unit, shorten, way_cost

PHI, MAX_REVERSE_M = 1.0, 1.5
START, GOAL = np.array([1.0, 1.0, 0.3]), np.array([4.2, 4.4, 1.9])
OPEN = DistanceField(np.full((50, 50), 1.0), 0.1, 0.0, 0.0)
"""A margin of 1 m everywhere on 5 x 5 m."""


def walled():
    """A wall at x = 2.5 m, open above y = 3.5 m; the margin falls to it with slope one."""
    row, column = np.mgrid[:50, :50] * 0.1 + 0.05
    return DistanceField(np.hypot(column - 2.5, np.maximum(0.0, row - 3.5)) - 0.15, 0.1, 0.0, 0.0)


def driven(start, turns, lengths):
    places = [tuple(start)]
    for turn, length in zip(turns, lengths):
        places.append(advance(*places[-1], float(turn), length, PHI))
    return np.array(places)


def is_at(pose, goal):
    turn = (pose[2] - goal[2] + math.pi) % (2.0 * math.pi) - math.pi
    return math.hypot(*(pose[:2] - goal[:2])) < 1e-6 and abs(turn) < 1e-6


def test_random_numbers_are_those_of_the_generator():
    state, x = np.array([12345], np.uint64), 12345
    for _ in range(5):
        x ^= x >> 12
        x ^= (x << 25) % 2**64
        x ^= x >> 27
        assert random_unit(state) == (x * 2685821657736338717 % 2**64 >> 11) / 2**53


@pytest.mark.parametrize(("kappa", "length"), [(0.0, 0.7), (1.0, 0.7), (-0.5, 1.3), (1.0, -0.7), (0.0, -0.2)])
def test_an_advance_is_the_integral_of_its_heading(kappa, length):
    s = (np.arange(20000) + 0.5) * length / 20000
    theta = 0.4 + kappa * s
    expected = [np.cos(theta).mean() * length + 1.0, np.sin(theta).mean() * length - 2.0, 0.4 + kappa * length]
    assert np.allclose(advance(1.0, -2.0, 0.4, kappa, length, 1.0), expected)


def test_places_are_those_of_the_arcs_at_every_heading():
    arcs = arc_places(8, 0.3, 0.4, PHI, 0.1)
    assert arcs.shape[:2] == (8, MOTIONS)
    last = arcs.shape[2] - 1
    assert 0.4 / last <= 0.3 * 0.1 + 1e-12
    for g, m, p in [(0, 0, last), (3, 1, 5), (5, 5, last), (7, 4, 2)]:
        place = advance(0.0, 0.0, 0.3 + g * math.pi / 4, float(BENDS[m]), SIGNS[m] * 0.4 * p / last, PHI)
        assert np.allclose(arcs[g, m, p], place[:2])


def test_an_arc_is_free_where_no_place_of_it_is_in_the_wall():
    field, arcs = walled(), arc_places(8, 0.0, 0.4, PHI, 0.1)
    assert places_are_free(field, 1.5, 1.0, arcs[0, 0], 0.4)
    assert not places_are_free(field, 2.2, 1.0, arcs[0, 0], 0.4)  # its end is in the wall
    assert not places_are_free(field, 2.3, 1.0, arcs[0, 0] * 1.5, 0.6)  # only its middle is
    assert places_are_free(field, 2.3, 4.2, arcs[0, 0] * 1.5, 0.6)


@pytest.mark.parametrize(("a", "d", "b"), [(0.4, 1.1, 0.7), (0.0, -0.6, 0.2), (1.5, 2.4, 0.3)])
def test_a_cone_tells_the_straights_around_its_arc(a, d, b):
    x, y, theta = advance(a, 0.0, 0.0, math.copysign(1.0, d), abs(d) / PHI, PHI)
    x, y, _ = advance(x, y, theta, 0.0, b, PHI)
    assert cone(x, y, d, PHI) == pytest.approx((a, b))


def test_the_longest_run_in_reverse_passes_over_nothing():
    assert reverse_run(np.array([1.0, -0.4, 0.0, -0.5, 2.0, -0.8])) == pytest.approx(0.9)
    assert reverse_run(np.array([1.0, 0.0])) == 0.0


def test_a_word_is_as_free_as_its_arcs():
    turns, straight = np.array([1, 0, -1, 0, 0]), np.array([0.5, 2.0, 0.5, 0.0, 0.0])
    assert word_is_free(OPEN, *START, turns, straight, PHI)
    assert not word_is_free(walled(), *START, turns, straight, PHI)
    assert word_is_free(walled(), *START, turns, 0.3 * straight, PHI)


def by_way_of(*poses):
    """Turns and lengths of the shortest words from each pose to the next."""
    way = []
    for a, b in zip(poses, poses[1:]):
        word = room_for(1)
        shortest_word(a, b, PHI, word)
        way += zip(word.turns[0].tolist(), (word.lengths[0] / PHI).tolist())
    turns, lengths = zip(*[segment for segment in way if segment[1] != 0.0])
    return np.array(turns), np.array(lengths)


@pytest.mark.parametrize("field", [OPEN, walled()], ids=["open", "walled"])
def test_shortcuts_lead_to_the_goal_over_free_ground(field):
    turns, lengths = by_way_of(START, np.array([1.0, 3.5, 2.0]), np.array([2.5, 4.4, 0.0]), GOAL)
    short = shorten(field, START, turns, lengths, PHI, MAX_REVERSE_M, 0.2, np.uint64(3), 40)
    for way in ((turns, lengths), short):
        places = driven(START, *way)
        assert is_at(places[-1], GOAL)
        for place, turn, length in zip(places, *way):
            assert word_is_free(field, *place, np.array([turn, 0, 0, 0, 0]), np.array([length, 0, 0, 0, 0.0]), PHI)
    assert way_cost(short[1], 0.2) < way_cost(lengths, 0.2)
    assert reverse_run(short[1]) <= max(MAX_REVERSE_M, reverse_run(lengths)) + 1e-9


def test_a_way_costs_its_length_its_cusps_and_its_segments():
    assert way_cost(np.array([1.0, -0.5, 0.0, -0.5, 1.0]), 0.2) == pytest.approx(3.4 + 4 * SEGMENT_COST_M)


def test_primitives_grow_from_their_parents_over_free_ground():
    field, n = walled(), 400
    poses, parents = np.zeros((n, 3)), np.full(n, -1)
    bends, signs, runs = np.zeros((3, n))
    poses[0], tree = START, Grown(poses, parents, bends, signs, runs)
    cells = np.flatnonzero(field.values > 0.0)
    size, winner = grow(field, cells, GOAL, PHI, 0.3, MAX_REVERSE_M, tree, 1, np.array([5], np.uint64))
    assert 1 < size <= n
    assert winner in (-1, size - 1)
    for k in range(1, size):
        place = advance(*poses[parents[k]], bends[k], signs[k] * 0.3, PHI)
        assert np.allclose(poses[k], place)
        assert runs[k] == (pytest.approx(runs[parents[k]] + 0.3) if signs[k] < 0.0 else 0.0)
    assert runs.max() <= MAX_REVERSE_M
