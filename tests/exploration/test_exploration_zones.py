"""What a mission does about zones: it looks into them but does not drive there, leaves one drawn around it and says so,
and explores only where it is told."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, Decision, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import RankingInput, rank_views
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import with_view
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.keep_out import KeepOut
from vsx_ros.occupancy.zoned_grid import with_zones
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.planning.planner import Planner
from vsx_ros.robot import OperatorHold
from vsx_ros.slam.state import TrackingState

SECOND, CONFIG = 10**9, with_view(Config())
BODY_M, MARGIN_M = CONFIG.robot.radius_m, CONFIG.planner.zone_margin_m
LANDMARKS = np.random.default_rng(0).uniform([-3.0, -2.0, 0.0], [3.0, 2.0, 1.0], (2000, 3))


def floor() -> OccupancyGrid:
    """Known for |x| < 2 m and |y| < 2 m, unknown beyond."""
    data = np.full((120, 160), UNKNOWN, np.int8)
    data[20:100, 40:120] = FREE
    return OccupancyGrid(data, 0.05, -4.0, -3.0)


def box(x0: float, y0: float, x1: float, y1: float, kind: ZoneKind = ZoneKind.NO_GO) -> Zone:
    return Zone("rug", kind, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def zoned(*zones: Zone) -> OccupancyGrid:
    return with_zones(floor(), zones, MARGIN_M, BODY_M, version=1)


def euclid(start, grid, clearance_m, poses):
    return np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)


def situation(grid: OccupancyGrid, **changes) -> Situation:
    default = Situation(
        slam_state=TrackingState.GOOD, slam_reason="", T_map_base=SE2(), T_odom_base=SE2(), grid=grid,
        navigation=NavigationState.IDLE, navigation_reason="", hazard=None, landmarks_world=LANDMARKS,
    )  # fmt: skip
    return default._replace(**changes)


def under_way() -> tuple[Mission, Decision]:
    mission = Mission(CONFIG, euclid)
    mission.decide(0, situation(floor(), slam_state=TrackingState.NOT_INITIALISED))
    return mission, mission.decide(SECOND, situation(floor()))


def ranked(grid: OccupancyGrid) -> list[SE2]:
    asked = RankingInput(
        grid=grid, radius_m=BODY_M + CONFIG.planner.clearance_m, landmarks_world=LANDMARKS,
        looked_from=np.zeros((0, 3)), travel_costs=partial(euclid, SE2(), grid, 0.1),
        blacklist=lambda poses: np.zeros(len(poses), np.bool_), config=CONFIG.exploration,
    )  # fmt: skip
    return [view.pose for view in rank_views(asked).views]


def test_views_stand_outside_a_zone_but_may_look_across_it() -> None:
    grid = zoned(box(0.5, -2.5, 4.0, 2.5))
    poses = ranked(grid)
    keep_out = KeepOut(grid, BODY_M)
    assert all(keep_out.zone_at(pose.x, pose.y) == "" for pose in poses)
    assert any(pose.x > 0.5 for pose in ranked(floor()))
    assert any(pose.x > 0.0 and abs(pose.theta) < 0.5 for pose in poses)


def test_only_unknown_ground_in_a_zone_to_look_into_is_worth_a_drive() -> None:
    poses = ranked(zoned(box(2.0, -2.0, 4.0, 2.0, ZoneKind.LOOK)))
    assert poses
    assert all(np.cos(pose.theta) > 0.0 for pose in poses)
    assert any(np.cos(pose.theta) < 0.0 for pose in ranked(floor()))


def test_a_zone_drawn_around_the_robot_stops_it_and_it_drives_out_and_says_so() -> None:
    mission, _ = under_way()
    grid = zoned(box(-0.6, -1.0, 0.9, 1.0))
    stop = mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    assert stop.action is Action.CANCEL
    assert "stands in the zone 'rug'" in stop.reason
    mission.decide(2 * SECOND + 1, situation(grid, navigation=NavigationState.ACTIVE))
    out = mission.decide(4 * SECOND, situation(grid, navigation=NavigationState.ABORTED))
    assert out.action is Action.GO
    assert "driving out of the zone 'rug'" in out.reason
    assert -1.1 < out.goal.x < -0.6 - BODY_M
    assert abs(out.goal.y) < 0.4
    waiting = mission.decide(5 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    assert waiting.action is Action.WAIT
    arrived = situation(grid, navigation=NavigationState.SUCCEEDED, T_map_base=out.goal, T_odom_base=out.goal)
    onwards = mission.decide(9 * SECOND, arrived)
    assert onwards.action is Action.GO
    assert "view" in onwards.reason
    assert not mission.view_selector.blacklist.left(9 * SECOND)
    reasons = [event.reason for event in mission.drain_events()]
    assert sum("driving out of the zone" in reason for reason in reasons) == 1
    assert sum("stands in the zone" in reason for reason in reasons) == 1


def test_wheels_held_on_the_way_out_of_a_zone_are_no_failure() -> None:
    mission, _ = under_way()
    grid = zoned(box(-0.6, -1.0, 0.9, 1.0))
    mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    assert mission.decide(4 * SECOND, situation(grid, navigation=NavigationState.ABORTED)).action is Action.GO
    held = OperatorHold("teleop", 5 * SECOND)
    mission.decide(5 * SECOND, situation(grid, navigation=NavigationState.ACTIVE)._replace(held=held))
    again = [mission.decide(k * SECOND, situation(grid, navigation=NavigationState.ABORTED)) for k in (9, 10)]
    assert "driving out of the zone 'rug'" in again[-1].reason
    assert not any("still in the zone" in event.reason for event in mission.drain_events())


def test_an_exit_whose_drive_the_operator_ended_is_tried_again() -> None:
    mission, _ = under_way()
    grid = zoned(box(-0.6, -1.0, 0.9, 1.0))
    mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    first = mission.decide(3 * SECOND, situation(grid))
    failed, held = situation(grid, navigation=NavigationState.ABORTED), OperatorHold("teleop", 5 * SECOND)
    mission.decide(5 * SECOND - SECOND // 5, failed)
    mission.decide(5 * SECOND, failed._replace(held=held))
    again = [mission.decide(k * SECOND, failed) for k in (9, 10)][-1]
    assert "driving out of the zone 'rug'" in first.reason
    assert again.goal == first.goal


def test_an_exit_that_cannot_be_driven_to_is_not_tried_again_and_again() -> None:
    mission, _ = under_way()
    grid = zoned(box(-0.6, -1.0, 0.9, 1.0))
    mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    exits = []
    for k in range(4, 30):
        refused = situation(grid, navigation=NavigationState.ABORTED, navigation_reason="the way leads into the zone")
        decision = mission.decide(k * SECOND, refused)
        if decision.action is Action.GO:
            exits.append(decision.goal)
    assert len(exits) > 5
    places = {(round(pose.x, 2), round(pose.y, 2)) for pose in exits}
    assert len(places) >= len(exits) // 2, "other places, not only other headings"
    assert max(pose.x for pose in exits) > 0.9 + BODY_M, "also on the far side"
    assert not mission.view_selector.blacklist.left(30 * SECOND), "no view is blamed for it"


def test_without_a_way_out_it_waits_and_says_so_once() -> None:
    mission, _ = under_way()
    grid = zoned(box(-9.0, -9.0, 9.0, 9.0))
    mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE))
    later = [mission.decide(k * SECOND, situation(grid, navigation=NavigationState.ABORTED)) for k in range(4, 14)]
    assert {decision.action for decision in later} == {Action.WAIT}
    reasons = [event.reason for event in mission.drain_events()]
    assert sum("no way leads out" in reason for reason in reasons) == 1


@pytest.mark.parametrize("gap_cells", [0, 1, 2, 4])
def test_the_way_out_is_found_though_more_ground_is_nearer_behind_a_wall(gap_cells: int) -> None:
    cells = floor().data.copy()
    cells[:, 118:120], cells[20:100, 120:158] = OCCUPIED, FREE  # a wall 1.9 m ahead, and the next room
    cells[58 : 58 + gap_cells, 118:120] = FREE  # narrower than the body
    grid = with_zones(replace(floor(), data=cells), [box(-1.0, -2.0, 1.9, 2.0)], MARGIN_M, BODY_M, version=1)
    ways = Planner(CONFIG.planner, CONFIG.robot)
    selector = ViewSelector(CONFIG, ways.travel_costs)
    out = selector.exit_pose(0, grid, SE2(1.5, 0.0, math.pi))
    assert out is not None
    assert out.x < -1.0 - BODY_M


def test_a_goal_that_a_zone_covers_is_left_without_blame() -> None:
    mission, goal = under_way()
    pose = goal.goal
    grid = zoned(box(pose.x - 0.3, pose.y - 0.3, pose.x + 0.3, pose.y + 0.3))
    elsewhere = pose @ SE2(-1.5, 0.0, 0.0)
    left = mission.decide(2 * SECOND, situation(grid, navigation=NavigationState.ACTIVE, T_map_base=elsewhere))
    assert left.action is Action.CANCEL
    assert "the goal now lies in the zone 'rug'" in left.reason
    mission.decide(3 * SECOND, situation(grid, navigation=NavigationState.ABORTED, T_map_base=elsewhere))
    assert not mission.view_selector.blacklist.left(3 * SECOND)


def test_a_robot_that_teleop_drove_into_a_zone_drives_out_when_the_operator_lets_go() -> None:
    mission, _ = under_way()
    grid, inside = zoned(box(-0.6, -1.0, 0.9, 1.0)), SE2(0.2, 0.0, 0.0)
    for k in range(2, 8):
        held = situation(grid, T_map_base=inside, T_odom_base=inside, held=OperatorHold("teleop", 2 * SECOND))
        yielded = mission.decide(k * SECOND, held)
        assert yielded.action is Action.WAIT
        assert yielded.state == "held"
    free = situation(grid, T_map_base=inside, T_odom_base=inside)
    decided = [mission.decide(k * SECOND, free) for k in range(8, 12)]
    (out,) = [decision for decision in decided if decision.action is Action.GO][:1]
    assert "driving out of the zone 'rug'" in out.reason
    assert not mission.view_selector.blacklist.left(12 * SECOND)
