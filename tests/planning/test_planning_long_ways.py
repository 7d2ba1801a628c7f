"""Long ways, fitted window by window: one smooth drive, without a stop where nothing reverses."""

import math

import numpy as np
import pytest

from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Path, Plan
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.time_scaling import estimated_s, time_scale

ROBOT, LIMITS = RobotConfig(), LimitsConfig()
GATES = 9


def course(between: int = 50, gap: int = 24) -> OccupancyGrid:
    """A hall 3 m wide with walls across every 2.5 m; their gaps are on the left and on the right in turn."""
    data = np.full((64, between * (GATES + 1) + 4), FREE, np.int8)
    data[:2], data[-2:], data[:, :2], data[:, -2:] = OCCUPIED, OCCUPIED, OCCUPIED, OCCUPIED
    for gate in range(1, GATES + 1):
        wall = data[:, gate * between : gate * between + 3]
        wall[:] = OCCUPIED
        wall[2 : 2 + gap] = FREE if gate % 2 else OCCUPIED
        wall[-2 - gap : -2] = FREE if not gate % 2 else OCCUPIED
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


def planned(phi: float, map_: OccupancyGrid, start: SE2, goal: SE2, **options: float) -> Path:
    config = PlannerConfig(phi_rad_m=phi, **options)
    plan = Planner(config, ROBOT).plan(start, goal, map_, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    return plan.path


@pytest.fixture(scope="module", params=[0.5, 1.0, 2.0])
def through(request: pytest.FixtureRequest) -> tuple[float, Path]:
    """phi, and the path from one end of the course to the other."""
    map_ = course(between=80 if request.param < 1.0 else 50)
    end_m = map_.shape[1] * map_.resolution
    return request.param, planned(request.param, map_, SE2(0.7, 1.6, 0.0), SE2(end_m - 0.7, 1.6, 0.0))


def test_nothing_stops_between_start_and_goal(through: tuple[float, Path]):
    _, path = through
    assert len(path.pieces) > GATES
    assert path.jumps == 0
    assert path.cusps == ()


def test_bound_and_goal_are_kept_over_all_windows(through: tuple[float, Path]):
    phi, path = through
    assert path.certificate.curvature_bound_rad_m <= phi
    assert path.certificate.end_error_m <= 1e-9
    assert path.certificate.end_error_rad <= 1e-9
    rows = path.sample(0.002)
    turned, driven = np.diff(rows[:, 2]), np.hypot(*np.diff(rows[:, :2], axis=0).T)
    assert np.all(np.abs(turned) <= phi * driven * (1.0 + 1e-4) + 1e-9)


def test_position_heading_and_curvature_run_on_at_joints(through: tuple[float, Path]):
    _, path = through
    for before, after in zip(path.pieces, path.pieces[1:]):
        assert before.end.distance_to(after.start) < 1e-9
        assert before.table[-1, 3] == pytest.approx(after.table[0, 3], abs=1e-9)
        assert before.table[-1, 4] == pytest.approx(after.table[0, 4], abs=1e-6)


def test_speed_runs_on_at_joints(through: tuple[float, Path]):
    _, path = through
    drive = time_scale(path, LIMITS)
    inside = (drive.times_s > 1.0) & (drive.times_s < drive.duration_s - 1.0)
    assert drive.v[inside].min() > 0.05
    assert np.abs(np.diff(drive.v) / np.diff(drive.times_s)).max() <= LIMITS.a_m_s2 * 1.001
    assert drive.duration_s == pytest.approx(estimated_s(path, LIMITS), rel=0.25)


@pytest.mark.parametrize("limit_m", [0.5, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_legs_in_reverse_are_bounded_in_the_fit(seed: int, limit_m: float):
    draw = np.random.default_rng(seed)
    start = SE2(0.7, float(draw.uniform(0.7, 2.4)), float(draw.uniform(2.0, 4.2)))  # it has to turn round first
    map_ = course()
    path = planned(1.0, map_, start, SE2(8.5, 1.6, float(draw.uniform(2.0, 4.2))), max_reverse_m=limit_m)
    assert path.cusps
    assert path.longest_reverse_m <= limit_m + 1e-6
    assert path.jumps == 0


def two_gaps(far_m: float) -> tuple[OccupancyGrid, SE2, SE2]:
    """A wall with a gap of 0.55 m, too narrow for the preferred clearance, and one of 1.2 m beside it."""
    data = np.full((200, 120), FREE, np.int8)
    data[:2], data[-2:], data[:, :2], data[:, -2:] = OCCUPIED, OCCUPIED, OCCUPIED, OCCUPIED
    data[:, 58:61] = OCCUPIED
    data[20:31, 58:61] = FREE
    wide = 25 + round(far_m / 0.05)
    data[wide - 12 : wide + 12, 58:61] = FREE
    return OccupancyGrid(data, 0.05, 0.0, 0.0), SE2(1.0, 1.275, 0.0), SE2(5.0, 1.275, 0.0)


@pytest.mark.parametrize(("far_m", "wide"), [(1.2, True), (6.0, False)])
def test_the_wide_way_is_taken_unless_its_drive_takes_much_longer(far_m: float, wide: bool):
    path = planned(1.0, *two_gaps(far_m))
    assert (path.certificate.min_clearance_m > 0.3) is wide
    assert (float(path.sample(0.01)[:, 1].max()) > 1.275 + 0.3 * far_m) is wide


def test_the_estimated_time_counts_bends_stops_and_turns():
    straight = planned(1.0, course(), SE2(0.7, 1.6, 0.0), SE2(2.2, 1.6, 0.0))
    assert estimated_s(straight, LIMITS) == pytest.approx(time_scale(straight, LIMITS).duration_s, rel=0.1)
    round_ = planned(1.0, course(), SE2(1.2, 1.6, 0.0), SE2(1.2, 1.6, math.pi))
    assert round_.cusps
    assert estimated_s(round_, LIMITS) == pytest.approx(time_scale(round_, LIMITS).duration_s, rel=0.25)
