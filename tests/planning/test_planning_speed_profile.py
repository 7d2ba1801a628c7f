"""Moves between two speeds, as the solver finds them or not."""

import pytest

from vsx_ros.planning.speed_profile import Profile


def test_a_move_is_appended() -> None:
    profile = Profile()
    assert profile.add_move(0.5, 1.0, (0.1, 0.2), (0.3, 0.4, 2.0))
    assert profile.rows[0][1] == 0.5
    assert profile.end == pytest.approx(1.5)


def test_where_the_solver_gives_up_there_is_no_move() -> None:
    """Braking from the greatest speed on just the length it takes: the solver raises instead of returning an error."""
    profile = Profile()
    v = 0.2798233051854322
    assert not profile.add_move(0.0, 0.1149618858536705, (v, 0.141576141632726), (v, 0.4, 2.0))
    assert profile.rows == []
