"""No limit is exceeded anywhere, at 1 kHz; the base rests at both ends, at cusps and where the curvature jumps."""

import math

import numpy as np
import pytest

from vsx_ros.config import LimitsConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Trajectory, certified
from vsx_ros.planning.pieces import arc_piece, turn_piece
from vsx_ros.planning.time_scaling import time_scale

LIMITS = LimitsConfig()


def check_limits(trajectory: Trajectory, limits: LimitsConfig) -> None:
    """Speeds as sampled, their first and second differences over 5 samples, all within 2 % of the limits."""
    assert np.abs(trajectory.v).max() <= limits.v_m_s * (1 + 1e-6)
    assert np.abs(trajectory.omega).max() <= limits.omega_rad_s * (1 + 1e-4)
    t = trajectory.times_s
    a = np.diff(trajectory.v) / np.diff(t)
    alpha = np.diff(trajectory.omega) / np.diff(t)
    assert np.abs(a).max() <= limits.a_m_s2 * 1.02
    assert np.abs(alpha).max() <= limits.alpha_rad_s2 * 1.02
    middle = 0.5 * (t[1:] + t[:-1])
    moving = np.abs(trajectory.v[1:-1]) > 0.0  # acceleration may jump where the base stands
    jerk = np.diff(a) / np.diff(middle)
    assert np.abs(jerk[moving]).max(initial=0.0) <= limits.jerk_m_s3 * 1.3  # differences over steps of unequal length


@pytest.mark.parametrize("phi", [0.5, 1.0, 2.0])
def test_no_limit_is_exceeded(phi):
    rng = np.random.default_rng(7)
    for _ in range(8):
        path = connect(SE2(), SE2(*rng.uniform(-3.0, 3.0, 3)), phi)
        assert isinstance(path, Path)
        trajectory = time_scale(path, LIMITS)
        check_limits(trajectory, LIMITS)
        assert trajectory.v[0] == trajectory.v[-1] == trajectory.omega[0] == trajectory.omega[-1] == 0.0
        # The speeds really carry the base along the poses.
        t = trajectory.times_s
        driven = np.sum(0.5 * np.abs(trajectory.v[1:] + trajectory.v[:-1]) * np.diff(t))
        assert driven == pytest.approx(path.length_m, rel=2e-3, abs=2e-3)
        turned = np.sum(0.5 * (trajectory.omega[1:] + trajectory.omega[:-1]) * np.diff(t))
        assert turned == pytest.approx(path.end.theta - path.start.theta, abs=5e-3)
        # Not slower than a third of full speed allows, even with all stops.
        assert trajectory.duration_s <= 3.0 * path.length_m / LIMITS.v_m_s + 3.0 * (1 + len(path.cusps))


@pytest.mark.parametrize("sampled_s", [0.02, 0.005])
def test_headings_that_are_differentiated_twice_keep_the_turn_acceleration(sampled_s):
    """A hundred random ways, sampled as poses, the second of them between the trajectory's own samples."""
    rng = np.random.default_rng(11)
    worst = []
    for k in range(100):
        path = connect(SE2(), SE2(*rng.uniform(-3.0, 3.0, 3)), (0.5, 1.0, 2.0)[k % 3])
        assert isinstance(path, Path)
        trajectory = time_scale(path, LIMITS)
        samples = [trajectory.at(t) for t in np.arange(0.0, trajectory.duration_s, sampled_s)]
        theta, omega = np.array([pose.theta for pose, _, _ in samples]), np.array([omega for _, _, omega in samples])
        worst.append(np.abs(np.diff(theta, 2)).max() / sampled_s**2)
        # Heading and turn rate are one curve.
        assert np.abs(np.gradient(theta, sampled_s) - omega)[1:-1].max() <= LIMITS.alpha_rad_s2 * sampled_s
    assert max(worst) <= LIMITS.alpha_rad_s2 * 1.01


def test_a_straight_line_takes_the_known_time():
    path = certified(SE2(), SE2(2.0, 0.0, 0.0), (arc_piece(SE2(), 0.0, 2.0, 1),), "arcs and lines")
    trajectory = time_scale(path, LIMITS)
    v, a, j = LIMITS.v_m_s, LIMITS.a_m_s2, LIMITS.jerk_m_s3
    ramp = 2.0 * math.sqrt(v / j) if v * j <= a * a else v / a + a / j
    shortest = 2.0 / v + ramp
    assert shortest - 1e-6 <= trajectory.duration_s <= 1.1 * shortest


def test_the_base_stands_where_curvature_jumps_and_at_cusps():
    first = arc_piece(SE2(), 1.0, 0.5, 1)
    second = arc_piece(first.end, -1.0, 0.5, 1)
    third = arc_piece(second.end, -1.0, 0.5, -1)
    path = certified(SE2(), third.end, (first, second, third), "arcs and lines")
    trajectory = time_scale(path, LIMITS)
    check_limits(trajectory, LIMITS)
    for corner in (first.end, second.end):
        at = np.argmin(np.hypot(trajectory.poses[:, 0] - corner.x, trajectory.poses[:, 1] - corner.y))
        assert abs(trajectory.v[at]) < 1e-3
    assert len(path.cusps) == 1
    assert np.all(trajectory.v[trajectory.times_s > 0.8 * trajectory.duration_s] <= 0.0)


def test_a_turn_on_the_spot_turns_and_does_not_drive():
    path = certified(SE2(), SE2(0.0, 0.0, -2.0), (turn_piece(SE2(), -2.0),), "turns on the spot")
    trajectory = time_scale(path, LIMITS)
    check_limits(trajectory, LIMITS)
    assert np.all(trajectory.v == 0.0)
    assert trajectory.poses[-1] == pytest.approx([0.0, 0.0, -2.0], abs=1e-9)
    assert 2.0 / LIMITS.omega_rad_s < trajectory.duration_s < 2.0 / LIMITS.omega_rad_s + 2.0


def test_an_empty_path_is_a_single_sample():
    trajectory = time_scale(certified(SE2(1, 2, 3), SE2(1, 2, 3), (), "nothing"), LIMITS)
    assert trajectory.duration_s == 0.0
    assert trajectory.at(5.0) == (SE2(1.0, 2.0, 3.0), 0.0, 0.0)


def test_odd_limits_hold_too():
    limits = LimitsConfig(v_m_s=0.6, a_m_s2=1.0, jerk_m_s3=3.0, omega_rad_s=0.2, alpha_rad_s2=0.1)
    path = connect(SE2(), SE2(1.5, 1.0, 2.5), 2.0)
    assert isinstance(path, Path)
    check_limits(time_scale(path, limits), limits)


def test_interpolation_and_broken_arrays():
    t = np.array([0.0, 1.0, 2.0])
    poses = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
    trajectory = Trajectory(t, poses, np.full(3, 0.1), np.zeros(3))
    pose, v, omega = trajectory.at(1.5)
    assert (pose.x, v, omega) == pytest.approx((0.15, 0.1, 0.0))
    with pytest.raises(PlanningError, match="not finite"):
        Trajectory(t, poses * np.nan, np.zeros(3), np.zeros(3))
    with pytest.raises(PlanningError, match="backwards"):
        Trajectory(t[::-1].copy(), poses, np.zeros(3), np.zeros(3))
    with pytest.raises(PlanningError, match="arrays"):
        Trajectory(t, poses[:2], np.zeros(3), np.zeros(3))
