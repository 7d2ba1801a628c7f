"""Held, slowed and resumed at any moment, at 1 kHz no limit is exceeded and the way is the planned one."""

import math

import numpy as np
import pytest

from vsx_ros.config import LimitsConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Trajectory, certified
from vsx_ros.planning.pieces import arc_piece, turn_piece
from vsx_ros.planning.retiming import Timing, retime
from vsx_ros.planning.time_scaling import time_scale

LIMITS = LimitsConfig()
TICK_S, ASK_EVERY = 0.001, 20


def random_plan(rng: np.random.Generator) -> Trajectory:
    path = connect(SE2(), SE2(*rng.uniform(-2.0, 2.0, 3)), float(rng.choice([0.5, 1.0, 2.0])))
    assert isinstance(path, Path)
    return time_scale(path, LIMITS)


def play(planned: Trajectory, rng: np.random.Generator, factors: list[float]) -> tuple[np.ndarray, float]:
    """(N, 6) x, y, theta, v, omega, place at 1 kHz until the end, another factor wanted every now and then; and the
    longest wait for a change."""
    timing, t, want, have, asked, longest = Timing(planned, planned.times_s - planned.times_s[0]), 0.0, 1.0, 1.0, 0, 0.0
    rows, k, change = [], 0, rng.uniform(0.0, 3.0)
    while want == 0.0 or have == 0.0 or t < timing.trajectory.duration_s:
        if k * TICK_S > change:
            want = float(rng.choice(factors)) if k < 20_000 else 1.0
            asked, change = k, k * TICK_S + rng.uniform(0.1, 3.0)
        if want != have and k % ASK_EVERY == 0:
            new = retime(planned, timing, t, want, LIMITS)
            if new is not None:
                timing, t, have, longest = new, 0.0, want, max(longest, (k - asked) * TICK_S)
        pose, v, omega = timing.trajectory.at(t)
        own = timing.trajectory.times_s
        rows.append((*pose.as_array(), v, omega, np.interp(t, own - own[0], timing.places_s)))
        t, k = t + TICK_S, k + 1
    return np.array(rows), longest


@pytest.mark.parametrize("seed", range(6))
def test_hold_slow_and_resume_at_random_moments_keep_the_five_limits(seed):
    rng = np.random.default_rng(seed)
    planned = random_plan(rng)
    rows, longest = play(planned, rng, [0.0, 0.5, 0.7, 1.0])
    v, omega = rows[:, 3], rows[:, 4]
    a, alpha = np.diff(v) / TICK_S, np.diff(omega) / TICK_S
    window = 100  # samples are 20 ms apart and joined by lines: jerk is told over 0.1 s
    jerk = (a[window:] - a[:-window]) / (window * TICK_S)
    assert np.abs(v).max() <= LIMITS.v_m_s * (1 + 1e-3)
    assert np.abs(omega).max() <= LIMITS.omega_rad_s * (1 + 3e-3)
    assert np.abs(a).max() <= LIMITS.a_m_s2 * (1 + 5e-3)
    assert np.abs(alpha).max() <= LIMITS.alpha_rad_s2 * (1 + 5e-3)
    assert np.abs(jerk).max() <= LIMITS.jerk_m_s3 * 1.25
    bent = np.abs(np.diff(rows[:, 2], 2)).max() / TICK_S**2  # the heading itself, over all changes of the timing
    assert bent <= LIMITS.alpha_rad_s2 * 1.2
    # It is the planned way, to its end, never backwards.
    assert np.all(np.diff(rows[:, 5]) >= -1e-9)
    goal = planned.at(math.inf)[0]
    assert rows[-1, :3] == pytest.approx(goal.as_array(), abs=1e-3)
    planned_poses = np.array([planned.at(place)[0].as_array() for place in rows[::50, 5]])
    assert np.abs(rows[::50, :3] - planned_poses).max() <= 1e-3
    assert longest <= 1.5


def test_a_hold_on_a_straight_takes_the_known_way_and_slowing_holds_the_speed():
    line = certified(SE2(), SE2(2.0, 0.0, 0.0), (arc_piece(SE2(), 0.0, 2.0, 1),), "arcs and lines")
    planned = time_scale(line, LIMITS)
    held = retime(planned, Timing(planned, planned.times_s - planned.times_s[0]), 4.0, 0.0, LIMITS)
    assert held is not None
    v, a, j = LIMITS.v_m_s, LIMITS.a_m_s2, LIMITS.jerk_m_s3
    assert held.trajectory.duration_s == pytest.approx(v / a + a / j, abs=0.01)
    way = held.trajectory.poses[-1, 0] - held.trajectory.poses[0, 0]
    assert way == pytest.approx(0.5 * v * (v / a + a / j), abs=0.005)
    slow = retime(planned, Timing(planned, planned.times_s - planned.times_s[0]), 3.0, 0.5, LIMITS)
    assert slow is not None
    assert np.median(slow.trajectory.v) == pytest.approx(0.5 * v, rel=1e-3)
    assert slow.trajectory.poses[-1] == pytest.approx([2.0, 0.0, 0.0], abs=1e-6)


def test_turns_on_the_spot_are_held_too():
    planned = time_scale(certified(SE2(), SE2(0.0, 0.0, 2.0), (turn_piece(SE2(), 2.0),), "turns on the spot"), LIMITS)
    held = retime(planned, Timing(planned, planned.times_s - planned.times_s[0]), 2.0, 0.0, LIMITS)
    assert held is not None
    assert held.trajectory.omega[0] == pytest.approx(LIMITS.omega_rad_s, rel=1e-3)
    assert held.trajectory.omega[-1] == 0.0
    assert (
        np.abs(np.diff(held.trajectory.omega) / np.diff(held.trajectory.times_s)).max() <= LIMITS.alpha_rad_s2 * 1.001
    )
    resumed = retime(planned, held, held.trajectory.duration_s, 1.0, LIMITS)
    assert resumed is not None
    assert resumed.trajectory.poses[-1] == pytest.approx([0.0, 0.0, 2.0], abs=1e-6)
    assert np.all(resumed.trajectory.v == 0.0)


def test_at_the_end_and_without_a_way_it_stands():
    planned = time_scale(certified(SE2(1, 2, 3), SE2(1, 2, 3), (), "nothing"), LIMITS)
    for factor in (0.0, 1.0):
        standing = retime(planned, Timing(planned, planned.times_s - planned.times_s[0]), 0.0, factor, LIMITS)
        assert standing is not None
        assert standing.trajectory.at(1.0) == (SE2(1.0, 2.0, 3.0), 0.0, 0.0)


@pytest.mark.parametrize("left_m", [0.0, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("cusp", [False, True])
def test_what_came_to_rest_at_the_end_of_a_stretch_resumes(left_m: float, cusp: bool) -> None:
    pieces = (arc_piece(SE2(), 0.0, 1.0, 1), *([arc_piece(SE2(1.0), 0.0, 0.5, -1)] if cusp else []))
    path = certified(SE2(), SE2(0.5 if cusp else 1.0, 0.0, 0.0), pieces, "arcs and lines")
    planned = time_scale(path, LIMITS)
    times = planned.times_s - planned.times_s[0]
    stops = np.flatnonzero((planned.v == 0.0) & (times > 0.0))
    end_s = float(times[stops[0]])
    jerk_s = (6.0 * left_m / LIMITS.jerk_m_s3) ** (1.0 / 3.0)  # before the end, as the last metres are braked
    rest = Trajectory(np.zeros(1), np.array([[1.0 - left_m, 0.0, 0.0]]), np.zeros(1), np.zeros(1))
    resumed = retime(planned, Timing(rest, np.array([end_s - jerk_s])), 0.0, 1.0, LIMITS)
    assert resumed is not None
    assert resumed.places_s[-1] == pytest.approx(times[-1], abs=1e-6)
    assert resumed.trajectory.poses[-1] == pytest.approx(planned.poses[-1], abs=1e-6)


@pytest.mark.parametrize("first", [0.0, 0.5])
def test_a_slow_zone_ahead_is_not_overrun_after_a_hold_or_a_slow_stretch(first: float) -> None:
    line = certified(SE2(), SE2(3.0, 0.0, 0.0), (arc_piece(SE2(), 0.0, 3.0, 1),), "arcs and lines")
    planned = time_scale(line, LIMITS, np.array([[1.5, 3.0, 0.1]]))
    begun = Timing(planned, planned.times_s - planned.times_s[0])
    resumptions = 0
    for t_s in np.linspace(0.3, 0.5 * planned.duration_s, 80):
        slowed = retime(planned, begun, t_s, first, LIMITS)
        if slowed is None:
            continue
        resumed = retime(planned, slowed, slowed.trajectory.duration_s if first == 0.0 else 0.6, 1.0, LIMITS)
        if resumed is None:
            continue
        resumptions += 1
        for part in (slowed.trajectory, resumed.trajectory):
            assert part.v[part.poses[:, 0] > 1.5].max(initial=0.0) <= 0.1 * (1.0 + 2e-3)
    assert resumptions > 70
