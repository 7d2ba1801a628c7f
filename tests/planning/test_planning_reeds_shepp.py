"""Every Reeds-Shepp word leads where it says; the shortest is no longer than any other way found."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.kernels.planning.motions import TABLE_HEADINGS, TABLE_STEP, look_up_length
from vsx_ros.kernels.planning.reeds_shepp import SEGMENTS, advance, reeds_shepp_words
from vsx_ros.planning.coarse_path import shortest_word
from vsx_ros.planning.joint_qp import free_space_sequences
from vsx_ros.planning.lattice_ways import word_table

coordinate = st.floats(-6.0, 6.0)
angle = st.floats(-math.pi, math.pi)


@given(coordinate, coordinate, angle)
@settings(max_examples=200)
def test_every_word_ends_on_the_goal(x, y, theta):
    turns, lengths = reeds_shepp_words(x, y, theta)
    assert len(turns) >= 1
    for turn, length in zip(turns, lengths):
        pose = (0.0, 0.0, 0.0)
        for k in range(SEGMENTS):
            pose = advance(*pose, float(turn[k]), float(length[k]), 1.0)
        assert math.hypot(pose[0] - x, pose[1] - y) < 1e-6
        assert abs(wrap_angle(pose[2] - theta)) < 1e-6


@given(coordinate, coordinate, angle)
@settings(max_examples=200)
def test_the_shortest_length_is_symmetric_and_at_least_the_straight_line(x, y, theta):
    here, there = SE2(), SE2(x, y, theta)
    forth, back = shortest_word(here, there, 1.0).length_m, shortest_word(there, here, 1.0).length_m
    assert forth == pytest.approx(back, abs=1e-6)
    assert forth >= math.hypot(x, y) - 1e-9
    assert forth >= abs(wrap_angle(theta)) - 1e-9


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((3.0, 0.0, 0.0), 3.0),
        ((-3.0, 0.0, 0.0), 3.0),
        ((1.0, 1.0, math.pi / 2), math.pi / 2),
        ((0.0, 0.0, math.pi), math.pi),  # three arcs of 60 deg, two cusps
    ],
)
def test_known_lengths(goal, length):
    assert shortest_word(SE2(), SE2(*goal), 1.0).length_m == pytest.approx(length, abs=1e-9)


@given(coordinate, coordinate, angle, st.floats(0.2, 4.0))
@settings(max_examples=100)
def test_sequences_turn_by_the_heading_difference(x, y, theta, phi):
    start, goal = SE2(0.4, -1.0, 0.7), SE2(0.4, -1.0, 0.7) @ SE2(x, y, theta)
    for sequence in free_space_sequences(start, goal, phi, 0.15):
        assert abs(wrap_angle(sum(sequence.turns) - theta)) < 1e-12
        assert len(sequence.joints) == len(sequence.turns) - 1
        for k, joint in enumerate(sequence.joints):
            assert joint == (sequence.directions[k] == sequence.directions[k + 1])


@pytest.mark.parametrize(("sx", "sy"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_the_table_is_exact_at_its_places_in_every_quadrant(sx, sy):
    for i, j, k in ((0, 0, 5), (3, 7, 0), (20, 2, 31), (31, 31, 16)):
        x, y, theta = sx * i * TABLE_STEP, sy * j * TABLE_STEP, k * 2.0 * math.pi / TABLE_HEADINGS
        length = shortest_word(SE2(), SE2(x, y, theta), 1.0).length_m
        assert look_up_length(word_table(), x, y, theta) == pytest.approx(length, abs=1e-5)
    assert look_up_length(word_table(), 50.0, 0.0, 0.0) == 0.0


def test_the_table_is_near_the_length_between_its_places():
    rng = np.random.default_rng(0)
    goals = rng.uniform((-6.0, -6.0, -9.0), (6.0, 6.0, 9.0), (500, 3))
    exact = np.array([shortest_word(SE2(), SE2(*goal.tolist()), 1.0).length_m for goal in goals])
    error = np.array([look_up_length(word_table(), *goal) for goal in goals]) - exact
    assert np.abs(error).max() < 0.25
    assert 1e-4 < np.abs(error).mean() < 0.02
