"""Zones drawn while a base drives at full speed: it never reaches into one, drives around or out, and slows down."""

import math
from dataclasses import replace

import numpy as np
import pytest
from driving import CONFIG, LockStep, open_floor

from vsx_ros.control.localization import UNLOCALIZED
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.navigation.way_watch import WayWatch
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.zoned_grid import ZonedGrid, with_zones
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.planning.path import Plan, Refusal, RefusalKind, Trajectory
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import TrackingState

BODY_M, MARGIN_M = CONFIG.robot.radius_m, CONFIG.planner.zone_margin_m
GOAL = SE2(3.0, 0.5, 0.2)
NEAREST_M = 0.15  # ahead of the body: no brake at 0.3 m/s stops before something nearer


def zoned(*zones: Zone) -> ZonedGrid:
    grid = with_zones(open_floor(), zones, MARGIN_M, BODY_M, version=len(zones))
    assert isinstance(grid, ZonedGrid)
    return grid


def box(x: float, y: float, half_m: float, kind: ZoneKind = ZoneKind.NO_GO, v_m_s: float | None = None) -> Zone:
    corners = ((x - half_m, y - half_m), (x + half_m, y - half_m), (x + half_m, y + half_m), (x - half_m, y + half_m))
    return Zone("rug", kind, corners, v_m_s)


def gap_m(run: LockStep, zone: Zone, since_s: float) -> float:
    """Least distance of the outline to the zone's border from then on, exact; negative inside."""
    rows = np.array(run.base.rows)
    places = rows[rows[:, 0] >= since_s, 1:3]
    corners = np.array(zone.points)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    dx = np.maximum(np.maximum(x0 - places[:, 0], places[:, 0] - x1), 0.0)
    dy = np.maximum(np.maximum(y0 - places[:, 1], places[:, 1] - y1), 0.0)
    return float(np.hypot(dx, dy).min()) - BODY_M


def under_way(seconds: float) -> LockStep:
    run = LockStep()
    run.go(GOAL)
    run.drive(seconds)
    return run


@pytest.mark.parametrize("seed", range(8))
def test_a_zone_drawn_on_the_way_at_full_speed_is_never_entered(seed: int) -> None:
    rng = np.random.default_rng(seed)
    run = under_way(float(rng.uniform(2.5, 5.0)))
    pose, half_m = run.base.pose, float(rng.uniform(0.15, 0.5))
    assert run.base.rows[-1][3] > 0.28
    ahead = pose @ SE2(BODY_M + NEAREST_M + half_m * math.sqrt(2.0), float(rng.uniform(-0.3, 0.3)), 0.0)
    zone, drawn_s = box(ahead.x, ahead.y, half_m), 1e-9 * run.base.now_ns
    run.planner.take_grid(zoned(zone), run.base.now_ns)
    run.drive(30.0)
    assert gap_m(run, zone, drawn_s) >= 0.0
    if run.navigator.state is NavigationState.SUCCEEDED:
        assert run.base.pose.distance_to(GOAL) < 0.03
    else:
        assert "rug" in run.navigator.reason or "no way" in run.navigator.reason


def test_the_way_leads_around_a_zone_and_not_through_a_wall() -> None:
    run = LockStep()
    zone = box(1.5, 0.3, 0.4)
    run.planner.take_grid(zoned(zone), run.base.now_ns)
    run.go(GOAL)
    run.drive(30.0)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert 0.0 < gap_m(run, zone, 0.0) < 0.5
    wall = Zone("door", ZoneKind.WALL, ((2.0, -9.0), (2.0, 9.0)))
    run.planner.take_grid(zoned(wall), run.base.now_ns)
    run.go(SE2())
    run.drive(3.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert run.base.pose.distance_to(GOAL) < 0.03


def test_a_goal_in_a_zone_is_refused_by_the_zones_name() -> None:
    run = LockStep()
    run.planner.take_grid(zoned(box(3.0, 0.5, 0.4)), run.base.now_ns)
    run.go(GOAL)
    run.drive(1.0)
    assert run.navigator.state is NavigationState.ABORTED
    assert "the zone 'rug'" in run.navigator.reason


def test_a_slow_zone_is_driven_slowly_even_when_drawn_on_the_way() -> None:
    zone = box(2.2, 0.3, 0.4, ZoneKind.SLOW, 0.12)
    early, meanwhile, late = LockStep(), under_way(1.0 / 15.0), under_way(3.0)
    early.planner.take_grid(zoned(zone), early.base.now_ns)
    early.go(GOAL)
    early.drive(40.0)
    for run in (meanwhile, late):  # the first plans when the zone is drawn, the other drives
        run.planner.take_grid(zoned(zone), run.base.now_ns)
        run.drive(40.0)
    for run in (early, meanwhile, late):
        assert run.navigator.state is NavigationState.SUCCEEDED
        rows = np.array(run.base.rows)
        inside = (np.abs(rows[:, 1] - 2.2) < 0.4 + BODY_M) & (np.abs(rows[:, 2] - 0.3) < 0.4 + BODY_M)
        assert 0.1 < rows[inside, 3].max() < 0.14
        assert rows[~inside, 3].max() > 0.25


def test_backing_by_odometry_stops_before_a_zone_too() -> None:
    run = under_way(6.0)
    pose = run.base.pose
    zone = box(pose.x - 0.75, pose.y, 0.4)
    run.navigator.cancel(run.base.now_ns)
    run.drive(3.0)
    run.planner.take_grid(zoned(zone), run.base.now_ns)
    began_s = 1e-9 * run.base.now_ns
    run.go(run.base.pose @ SE2(-0.5, 0.0, 0.0), "odom")
    run.drive(5.0, TrackingState.LOST)
    assert run.navigator.state is NavigationState.ABORTED
    assert "the zone 'rug'" in run.navigator.reason
    assert gap_m(run, zone, began_s) > 0.0


def test_a_zone_on_the_way_counts_as_soon_as_the_place_is_recognised() -> None:
    """A robot that looks for a place of a loaded map drives by odometry; the map does not change when it finds one."""
    grid = zoned(box(1.2, 0.0, 0.4))
    watch = WayWatch(CONFIG)
    way = time_scale(GoalPlanner(CONFIG, "fov", 0).blind.plan_blind(SE2(), SE2(1.0, 0.0, 0.0)).path, CONFIG.limits)
    watch.begin(grid, None)
    lost = UNLOCALIZED._replace(odometry=Odometry(1, SE2()), slam_state=TrackingState.LOST)
    assert watch.hindrance(way, "odom", 0.0, grid, lost) is None
    found = watch.hindrance(way, "odom", 0.0, grid, lost._replace(T_map_base=SE2()))
    assert found is not None
    assert "the zone 'rug'" in found.reason
    assert watch.hindrance(way, "odom", 0.0, grid, lost._replace(T_map_base=SE2())) is None, "judged once"


def test_what_stands_farther_on_is_seen_on_the_same_map_as_the_base_comes_nearer() -> None:
    cells = np.zeros((80, 160), np.int8)
    cells[38:42, 80:84] = 100  # 3 m ahead
    grid, watch, told = OccupancyGrid(cells, 0.05, -1.0, -2.0), WayWatch(CONFIG), list[float | None]()
    times_s = np.arange(0.0, 16.0, 0.1)
    x = 0.25 * times_s
    way = Trajectory(times_s, np.column_stack([x, 0.0 * x, 0.0 * x]), np.full(len(x), 0.25), 0.0 * x)
    watch.begin(None, None)
    for at_s in times_s.tolist():
        found = watch.hindrance(way, "map", at_s, grid, UNLOCALIZED._replace(T_map_base=SE2()))
        told += [found.ahead_m] if found is not None else []
    assert told
    assert told[0] is not None
    assert told[0] > 1.0


def driven_out(heading: float, within_s: float, *beside: Zone) -> np.ndarray:
    """The rows of a base that has left a zone, beside these, by the way that the mission chooses."""
    ways = Planner(CONFIG.planner, CONFIG.robot)
    selector = ViewSelector(CONFIG, ways.travel_costs)
    run = LockStep()
    run.base.pose = SE2(0.3, 0.0, heading)
    run.localization = type(run.localization)()
    run.drive(0.5)
    grid, pose = zoned(box(0.0, 0.0, 0.6), *beside), run.base.pose
    run.planner.take_grid(grid, run.base.now_ns)
    out = selector.exit_pose(run.base.now_ns, grid, pose)
    assert out is not None
    run.go(out)
    run.drive(within_s)
    assert run.navigator.state is NavigationState.SUCCEEDED
    assert run.base.pose.distance_to(out) < 0.03
    return np.array(run.base.rows)


@pytest.mark.parametrize("heading", [0.0, 1.5, 3.0, 4.5])
def test_out_of_a_zone_the_way_is_short_and_leads_nowhere_else(heading: float) -> None:
    rows = driven_out(heading, 15.0)
    driven_m = float(np.hypot(*np.diff(rows[:, 1:3], axis=0).T).sum())
    assert 0.3 + BODY_M < driven_m < 1.9


@pytest.mark.parametrize("crack_cells", [0, 1, 2, 4])
@pytest.mark.parametrize("strip_m", [0.0, 0.2, 0.3, 0.5])
@pytest.mark.parametrize("beyond", [OCCUPIED, UNKNOWN], ids=["wall", "unknown"])
def test_out_of_a_zone_the_way_leads_to_room_for_the_body(beyond: int, strip_m: float, crack_cells: int) -> None:
    """Nearer ground outside is a crack, a strip beside a wall, or unknown."""
    floor = open_floor()
    cells, wall = floor.data.copy(), floor.cells(np.array([[0.8 + strip_m, 0.0]]))[0, 1]
    cells[:, wall : wall + 4] = beyond
    cells[80 : 80 + crack_cells, wall : wall + 4] = FREE
    grid = with_zones(replace(floor, data=cells), [box(0.0, 0.0, 0.8)], MARGIN_M, BODY_M, version=1)
    run, pose, ways = LockStep(), SE2(0.5, 0.0, math.pi), Planner(CONFIG.planner, CONFIG.robot)
    selector = ViewSelector(CONFIG, ways.travel_costs)
    out = selector.exit_pose(0, grid, pose)
    assert out is not None
    run.planner.take_grid(grid, run.base.now_ns)
    plan = run.planner.plan(pose, out, "map")
    assert isinstance(plan, Plan), plan
    assert plan.path.length_m < 2.5


STAIRS = Zone("stairs", ZoneKind.WALL, ((0.65, -1.5), (0.65, 1.5)))


@pytest.mark.parametrize("heading", [0.0, 1.5, 3.0, 4.5])
def test_out_of_a_zone_the_way_never_leads_over_one_that_touches_it(heading: float) -> None:
    assert driven_out(heading, 20.0, STAIRS)[:, 1].max() + BODY_M < 0.65


def test_a_zone_that_is_drawn_beside_the_one_being_left_is_seen_on_the_way() -> None:
    rug, watch = box(0.0, 0.0, 0.6), WayWatch(CONFIG)
    way = time_scale(GoalPlanner(CONFIG, "fov", 0).blind.plan_blind(SE2(), SE2(1.0, 0.0, 0.0)).path, CONFIG.limits)
    watch.begin(zoned(rug), None)
    here = UNLOCALIZED._replace(odometry=Odometry(1, SE2()), T_map_base=SE2())
    assert watch.hindrance(way, "map", 0.0, zoned(rug), here) is None
    found = watch.hindrance(way, "map", 0.0, zoned(rug, STAIRS), here)
    assert found is not None
    assert "the zone 'stairs'" in found.reason


def test_from_within_a_zone_no_way_leads_across_it() -> None:
    run, pose = LockStep(), SE2(0.5, 0.0, math.pi)
    run.planner.take_grid(zoned(box(0.0, 0.0, 0.8)), run.base.now_ns)
    refused = run.planner.plan(pose, SE2(-2.0, 0.0, math.pi), "map")
    assert isinstance(refused, Refusal)
    assert refused.kind is RefusalKind.ZONE
    assert "'rug'" in refused.reason


def test_beside_a_zone_the_way_leads_around_it() -> None:
    """The body reaches into the margin of the zone: it is left, and not crossed because it is left."""
    run, rug = LockStep(), box(0.5, 0.0, 0.4)
    run.planner.take_grid(zoned(rug), run.base.now_ns)
    plan = run.planner.plan(SE2(-0.1, 0.0, 0.0), SE2(2.0, 0.0, 0.0), "map")
    assert isinstance(plan, Plan)
    places = plan.path.sample(0.01)[:, :2]
    assert 0.0 < np.hypot(*np.maximum(np.abs(places - [0.5, 0.0]) - 0.4, 0.0).T).min() - BODY_M + 0.001 < 0.03
    assert plan.path.length_m < 4.0
