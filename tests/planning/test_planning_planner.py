"""In a map: what is planned is free, exact and bounded; what is refused is refused for the right reason."""

import math

import numpy as np
import pytest
from walled_rooms import grid, room, with_wall

from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.planning.corridor import Corridor, build_corridor
from vsx_ros.planning.path import Path, Plan, Refusal, RefusalKind
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import PaperPlanner, UnconstrainedPlanner
from vsx_ros.planning.time_scaling import time_scale

ROBOT, CONFIG = RobotConfig(), PlannerConfig()
NEED = ROBOT.radius_m + CONFIG.clearance_m


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def check(path: Path, grid_: OccupancyGrid, phi: float) -> None:
    """Dense and independent of the planner: bound, exact end, and distance to every cell that is not free."""
    blocked = grid_.centres(np.argwhere(grid_.data != FREE))
    rows = path.sample(0.01)
    assert np.abs(rows[:, 3]).max() <= phi * (1 + 1e-6)
    assert path.certificate.end_error_m <= 1e-9
    assert path.certificate.end_error_rad <= 1e-9
    half = 0.5 * grid_.resolution
    for x, y in rows[::3, :2]:
        d = np.maximum(np.abs(blocked - (x, y)) - half, 0.0)
        assert np.hypot(d[:, 0], d[:, 1]).min() >= NEED - 0.011
    assert path.longest_reverse_m <= CONFIG.max_reverse_m + 1e-6


def test_through_a_gap_and_turning_round_behind_it():
    map_ = with_wall(slice(30, 48))
    start, goal = SE2(0.5, -0.3, 2.0), SE2(3.5, 2.0, math.pi)
    plan = Planner(CONFIG, ROBOT).plan(start, goal, map_, rng())
    assert isinstance(plan, Plan)
    check(plan.path, map_, CONFIG.phi_rad_m)
    assert plan.path.start == start
    assert plan.goal == goal
    assert plan.path.certificate.min_clearance_m == pytest.approx(NEED, abs=0.25)
    assert plan.path.certificate.curvature_bound_rad_m <= CONFIG.phi_rad_m


@pytest.mark.parametrize("seed", range(6))
def test_among_boxes(seed):
    draw = np.random.default_rng(seed)
    data = room(161, 121)
    for _ in range(7):
        r, c = draw.integers(10, 95), draw.integers(10, 135)
        data[r : r + 12, c : c + 14] = OCCUPIED
    map_ = grid(data)
    field = clearance_field(map_)
    free = []
    while len(free) < 2:
        pose = SE2(*(draw.uniform((-0.7, -0.7, -3.0), (6.8, 4.8, 3.0))))
        if field.at(np.array([[pose.x, pose.y]]))[0] > NEED:
            free.append(pose)
    plan = Planner(CONFIG, ROBOT).plan(free[0], free[1], map_, rng())
    generic = UnconstrainedPlanner(CONFIG, ROBOT).plan(free[0], free[1], map_, rng())
    if isinstance(plan, Refusal):
        assert plan.kind is RefusalKind.DISCONNECTED
        assert isinstance(generic, Refusal)
        return
    check(plan.path, map_, CONFIG.phi_rad_m)
    assert isinstance(generic, Plan)
    again = Planner(CONFIG, ROBOT).plan(free[0], free[1], map_, rng())
    assert isinstance(again, Plan)
    assert plan.path.sample(0.01).tobytes() == again.path.sample(0.01).tobytes()


def test_refusals_name_their_reason():
    planner = Planner(CONFIG, ROBOT)
    closed = with_wall(slice(0, 0))
    start, goal = SE2(0.5, 1.0, 0.0), SE2(3.5, 1.0, 0.0)
    split = planner.plan(start, goal, closed, rng())
    assert isinstance(split, Refusal)
    assert split.kind is RefusalKind.DISCONNECTED
    in_wall = planner.plan(start, SE2(1.98, 1.0, 0.0), closed, rng())
    assert isinstance(in_wall, Refusal)
    assert in_wall.kind is RefusalKind.GOAL_BLOCKED
    assert "0.07 m inside ground that is not known to be free" in in_wall.reason
    near_wall = planner.plan(start, SE2(1.82, 1.0, 0.0), closed, rng())
    assert isinstance(near_wall, Refusal)
    assert near_wall.kind is RefusalKind.GOAL_BLOCKED
    assert near_wall.reason.endswith("m to ground that is not known to be free; the base needs 0.18 m")
    hardly = planner.plan(start, SE2(1.724, 1.0, 0.0), closed, rng())
    assert isinstance(hardly, Refusal)
    assert "has 0.17 m to ground" in hardly.reason  # 0.176 m: less than what the base needs
    outside = planner.plan(SE2(30.0, 1.0, 0.0), goal, closed, rng())
    assert isinstance(outside, Refusal)
    assert outside.kind is RefusalKind.START_BLOCKED
    beyond = planner.plan(start, SE2(-40.0, 1.0, 0.0), closed, rng())
    assert isinstance(beyond, Refusal)
    assert beyond.kind is RefusalKind.GOAL_BLOCKED


def test_a_goal_no_manoeuvre_reaches_is_refused_by_the_budget():
    data = np.full((80, 80), OCCUPIED, np.int8)
    data[20:31, 5:75] = FREE  # a lane too narrow to turn round in, entered the wrong way
    lane = OccupancyGrid(data, 0.05, 0.0, 0.0)
    start, goal = SE2(0.8, 1.275, 0.0), SE2(2.8, 1.275, math.pi)
    plan = Planner(PlannerConfig(phi_rad_m=0.5), ROBOT).plan(start, goal, lane, rng())
    assert isinstance(plan, Refusal)
    assert plan.kind is RefusalKind.BUDGET
    assert "phi 0.5" in plan.reason
    assert "1.5 m" in plan.reason
    again = Planner(PlannerConfig(phi_rad_m=0.5), ROBOT).plan(start, goal, lane, rng())
    assert again == plan


@pytest.mark.parametrize("phi", [0.5, 1.0, 2.0])
def test_long_ways_are_smooth_but_for_a_few_stops(phi):
    map_ = with_wall(slice(55, 75))
    plan = Planner(PlannerConfig(phi_rad_m=phi), ROBOT).plan(SE2(0.5, 0.0, 0.0), SE2(3.5, 0.0, 3.0), map_, rng())
    assert isinstance(plan, Plan)
    check(plan.path, map_, phi)
    assert plan.path.jumps == 0
    assert plan.path.cost_m(CONFIG) == pytest.approx(plan.path.length_m + CONFIG.cusp_cost_m * len(plan.path.cusps))


def test_clearance_along_a_path_is_a_lower_bound_near_the_truth():
    map_ = with_wall(slice(55, 75))
    start, goal = SE2(0.5, 0.0, 0.0), SE2(3.5, 0.0, 3.0)
    plan = Planner(CONFIG, ROBOT).plan(start, goal, map_, rng())
    corridor = build_corridor(map_, start, goal, CONFIG, ROBOT)
    assert isinstance(plan, Plan)
    assert isinstance(corridor, Corridor)
    dense = corridor.clearance.at(plan.path.sample(0.001)[:, :2]).min()
    assert corridor.measured(plan.path).certificate.min_clearance_m <= dense
    assert corridor.measured(plan.path).certificate.min_clearance_m == pytest.approx(dense, abs=0.004)


def test_unknown_ground_is_not_free():
    data = room()
    data[:, 50:70] = UNKNOWN
    plan = Planner(CONFIG, ROBOT).plan(SE2(0.5, 1.0, 0.0), SE2(3.9, 1.0, 0.0), grid(data), rng())
    assert isinstance(plan, Refusal)
    assert plan.kind is RefusalKind.DISCONNECTED


def test_a_start_too_near_a_wall_may_leave_it():
    map_ = grid(room())
    start = SE2(-0.9 + 0.12, 1.0, math.pi)  # 12 cm from the wall, facing it
    plan = Planner(CONFIG, ROBOT).plan(start, SE2(2.5, 1.5, 0.0), map_, rng())
    assert isinstance(plan, Plan)
    clearance = clearance_field(map_).at(plan.path.sample(0.01)[:, :2])
    assert clearance.min() >= 0.12 - 0.025
    assert clearance[-50:].min() >= NEED


def test_exactly_straight_ahead_straight_behind_and_nowhere():
    planner = Planner(CONFIG, ROBOT)
    for distance in (0.6, -0.6, 0.0):
        start = SE2(1.0, 1.0, 0.4)
        goal = start @ SE2(distance, 0.0, 0.0)
        for plan in (planner.plan(start, goal, grid(room()), rng()), planner.plan_blind(start, goal)):
            assert isinstance(plan, Plan)
            assert plan.path.length_m == pytest.approx(abs(distance), abs=1e-6)


def test_reverse_legs_are_short():
    planner = Planner(CONFIG, ROBOT)
    mapped = planner.plan(SE2(4.0, 1.0, 0.0), SE2(0.0, 1.0, 0.0), grid(room()), rng())
    assert isinstance(mapped, Plan)
    check(mapped.path, grid(room()), CONFIG.phi_rad_m)


@pytest.mark.parametrize(
    ("limit_m", "goal", "reverse_m"),
    [
        (1.5, SE2(-0.4, 0.0, 0.0), 0.4),
        (0.3, SE2(-0.4, 0.0, 0.0), None),
        (0.2, SE2(0.4, 0.2, 0.0), 0.14),
        (0.1, SE2(0.4, 0.2, 0.0), None),
        (0.0, SE2(0.1, 0.1, 1.0), None),
        (0.0, SE2(0.8, 0.3, 0.7), 0.0),
    ],
)
def test_without_a_map_a_reverse_leg_too_long_is_infeasible(limit_m, goal, reverse_m):
    plan = Planner(PlannerConfig(phi_rad_m=1.0, max_reverse_m=limit_m), ROBOT).plan_blind(SE2(), goal)
    if reverse_m is None:
        assert isinstance(plan, Refusal)
        assert plan.kind is RefusalKind.INFEASIBLE
        assert f"longer than {limit_m:g} m" in plan.reason
    else:
        assert isinstance(plan, Plan)
        assert plan.path.longest_reverse_m == pytest.approx(reverse_m, abs=0.02)
        assert plan.path.longest_reverse_m <= limit_m + 1e-6
        assert plan.path.certificate.end_error_m <= 1e-9


@pytest.mark.parametrize("angle", [3.0, -0.4])
def test_without_a_map_a_goal_that_is_only_turned_is_turned_to_on_the_spot(angle):
    start = SE2(1.0, 2.0, 0.5)
    plan = Planner(CONFIG, ROBOT).plan_blind(start, start @ SE2(0.005, 0.0, angle))
    assert isinstance(plan, Plan)
    assert plan.path.length_m == 0.0
    assert plan.path.turn_on_spot_rad == pytest.approx(abs(angle))
    assert plan.path.certificate.end_error_m == pytest.approx(0.005)
    assert plan.path.certificate.end_error_rad < 1e-9
    trajectory = time_scale(plan.path, LimitsConfig())
    assert trajectory.at(trajectory.duration_s)[0].angle_to(plan.goal) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("goal", [SE2(-1.6, 0.0, 0.0), SE2(5.0, 3.0, 0.0), SE2(0.1, 0.0, 3.0), SE2(1e300, 0.0, 0.0)])
def test_without_a_map_nobody_drives_far(goal):
    plan = Planner(PlannerConfig(phi_rad_m=1.0), ROBOT).plan_blind(SE2(), goal)
    assert isinstance(plan, Refusal)
    assert plan.kind is RefusalKind.INFEASIBLE
    assert "at most 1.5 m" in plan.reason


def test_the_generic_planner_turns_on_the_spot():
    map_ = with_wall(slice(55, 75))
    plan = UnconstrainedPlanner(CONFIG, ROBOT).plan(SE2(0.5, 0.0, 0.0), SE2(3.5, 0.0, 3.0), map_, rng())
    assert isinstance(plan, Plan)
    assert plan.path.turn_on_spot_rad > 2.0
    assert plan.path.reverse_m == 0.0
    assert plan.path.certificate.end_error_m <= 1e-9
    assert plan.path.certificate.end_error_rad <= 1e-9
    assert abs(wrap_angle(plan.path.end.theta - 3.0)) <= 1e-9
    assert clearance_field(map_).at(plan.path.sample(0.01)[:, :2]).min() >= NEED - 0.01
    assert math.isinf(plan.path.certificate.curvature_bound_rad_m)


def test_the_papers_planner_uses_primitives_where_one_segment_cannot():
    map_ = grid(room(161, 161))
    start, goal = SE2(1.0, 1.0, 0.0), SE2(4.0, 4.0, 0.3)
    plan = PaperPlanner(CONFIG, ROBOT).plan(start, goal, map_, rng())
    assert isinstance(plan, Plan)
    check(plan.path, map_, CONFIG.phi_rad_m * 1.001)
    assert len(plan.path.pieces) > 1


@pytest.mark.parametrize("kind", [Planner, UnconstrainedPlanner, PaperPlanner])
def test_nan_is_an_error_and_start_equal_goal_is_not(kind):
    planner = kind(CONFIG, ROBOT)
    with pytest.raises(PlanningError, match="start pose"):
        planner.plan(SE2(math.nan, 0.0, 0.0), SE2(1.0, 1.0, 0.0), grid(room()), rng())
    plan = planner.plan(SE2(1.0, 1.0, 0.5), SE2(1.0, 1.0, 0.5), grid(room()), rng())
    assert isinstance(plan, Plan)
    assert plan.path.length_m == 0.0
    with pytest.raises(PlanningError, match="drop it"):
        Planner(CONFIG, ROBOT).travel_costs(SE2(1.0, 1.0, 0.0), grid(room()), 0.1, np.full((1, 3), np.nan))


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (40, 1)])
def test_maps_too_small_for_anything(shape):
    tiny = OccupancyGrid(np.zeros(shape, np.int8), 0.05, 0.0, 0.0)
    plan = Planner(CONFIG, ROBOT).plan(SE2(0.02, 0.02, 0.0), SE2(0.03, 0.02, 0.0), tiny, rng())
    assert isinstance(plan, Refusal)
    assert plan.kind is RefusalKind.GOAL_BLOCKED
