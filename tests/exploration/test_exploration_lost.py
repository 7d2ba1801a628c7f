"""A mission that has lost its camera: back along its trail, then a look elsewhere; and missions that begin lost."""

import numpy as np
import pytest
from missions import LANDMARKS, SECOND, euclid, mapping_mission, situation, wheels_driven

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Outcome, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.recovery import Trail, escape_arc
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.slam.state import TrackingState

OPEN = OccupancyGrid(np.full((120, 240), FREE, np.int8), 0.05, -6.0, -3.0)


def test_lost_cancels_waits_backs_along_the_trail_and_comes_back():
    mission = mapping_mission()
    for k in range(40):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    lost = situation(slam_state=TrackingState.LOST, slam_reason="blurred", T_odom_base=SE2(1.95, 0, 0))
    assert mission.decide(3 * SECOND, lost).action is Action.CANCEL
    assert mission.decide(3 * SECOND + SECOND // 2, lost).action is Action.WAIT
    back = mission.decide(6 * SECOND, lost)
    assert back.action is Action.GO
    assert back.frame == "odom"
    assert back.goal.x == pytest.approx(1.95 - Config().exploration.backtrack_step_m, abs=0.06)
    found = situation(T_odom_base=SE2(1.6, 0, 0))
    assert mission.decide(7 * SECOND, found._replace(navigation=NavigationState.ACTIVE)).action is Action.WAIT
    mission.decide(7 * SECOND + SECOND // 2, lost)
    mission.decide(8 * SECOND, found)
    mission.decide(9 * SECOND - 1, found)
    assert mission.state is MissionState.RECOVERING
    mission.decide(9 * SECOND, found)
    assert mission.state is MissionState.MAPPING


def test_lost_again_at_once_it_goes_on_backing_although_the_camera_is_tracked():
    mission, step_m = mapping_mission(), Config().exploration.backtrack_step_m
    for k in range(60):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    here, now_ns, backed = SE2(2.95, 0, 0), 3 * SECOND, []
    for _ in range(3):
        lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", T_odom_base=here)
        mission.decide(now_ns, lost)
        for k in range(1, 9):
            tracked = lost._replace(slam_state=TrackingState.GOOD)
            decision = mission.decide(now_ns + k * SECOND // 4, lost if not backed and k < 6 else tracked)
            if decision.frame == "odom" and decision.action is Action.GO:
                backed.append(decision.goal.x)
                here = decision.goal
                break
        found = situation(T_odom_base=here)
        mission.decide(now_ns + 3 * SECOND, found)
        mission.decide(now_ns + 4 * SECOND, found)
        assert mission.state is MissionState.MAPPING
        now_ns += 5 * SECOND
    assert np.diff(backed) == pytest.approx([-step_m] * 2, abs=0.06)


def drives_while_lost(mission: Mission, trail_m: float, landmarks=LANDMARKS):
    """The goals of a robot that is lost after trail_m [m] straight ahead and goes wherever it is sent."""
    for k in range(round(trail_m / 0.05) + 1):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    pose, goals, now_ns = SE2(trail_m, 0, 0), [], 3 * SECOND
    while mission.outcome is None:
        lost = situation(
            slam_state=TrackingState.LOST, slam_reason="dark", grid=OPEN, landmarks_world=landmarks, T_odom_base=pose,
            T_map_base=pose,
        )  # fmt: skip
        decision = mission.decide(now_ns, lost)
        now_ns += 3 * SECOND
        if decision.action is not Action.GO:
            continue
        goals.append(decision.goal)
        for share in np.linspace(0.0, 1.0, 8):
            way = SE2(*((1 - share) * pose.as_array() + share * decision.goal.as_array()))
            mission.decide(now_ns, lost._replace(T_odom_base=way, navigation=NavigationState.ACTIVE))
        pose = decision.goal
        assert len(goals) < 50
    return goals


def test_lost_for_good_it_backs_goes_on_to_where_most_is_known_looks_to_the_sides_and_ends():
    mission, config = mapping_mission(), Config().exploration
    goals = drives_while_lost(mission, 4.0, LANDMARKS + [1.0, 0.0, 0.0])
    straight = [goal.x for goal in goals if goal.y == 0.0]
    assert (np.diff([4.0, *straight]) < 0.0).all()
    assert np.diff([4.0, *straight]).min() > -config.backtrack_step_m - 0.11
    backed_m = config.backtrack_step_m * int(np.ceil(config.backtrack_max_m / config.backtrack_step_m))
    assert straight[-1] < 4.0 - backed_m - 0.3
    arcs, turns = goals[len(straight) : -8], goals[-8:]
    assert 2 <= len(arcs) <= 4
    assert all(abs(goal.theta) > 0.2 for goal in arcs)
    assert {(goal.x, goal.y) for goal in turns} == {(arcs[-1].x, arcs[-1].y)}
    headings = [arcs[-1].theta, *(goal.theta for goal in turns)]
    assert np.diff(np.unwrap(headings)) == pytest.approx([np.pi / 4] * 8)
    assert mission.outcome is Outcome.LOST
    reasons = [event.reason for event in mission.drain_events()]
    assert any("most known landmarks" in reason for reason in reasons)
    assert "dark" in reasons[-1]


def test_lost_where_most_is_known_it_goes_no_further_back_than_it_must():
    behind = LANDMARKS + [-20.0, 0.0, 0.0]
    config = Config().exploration
    goals = drives_while_lost(mapping_mission(), 4.0, behind)
    backed_m = config.backtrack_step_m * int(np.ceil(config.backtrack_max_m / config.backtrack_step_m))
    assert min(goal.x for goal in goals if goal.y == 0.0) == pytest.approx(4.0 - backed_m, abs=0.3)


def test_the_trail_gives_back_the_way_it_was_driven():
    trail = Trail(spacing_m=0.125)
    for k in range(9):
        trail.add(SE2(0.125 * k, 0.0, 0.0))
        trail.add(SE2(0.125 * k + 0.0625, 0.0, 0.0))
    assert trail.back(0.5) == SE2(0.5, 0.0, 0.0)
    assert trail.length_m == 1.0
    trail.driven_back_to(SE2(0.7, 0.02, 0.0))
    assert trail.poses[-1].x == 0.75
    assert trail.back(0.5) == SE2(0.25, 0.0, 0.0)
    assert Trail(spacing_m=0.1).back(0.5) is None


def test_the_way_back_does_not_cut_the_corner_where_the_robot_turned_over():
    trail = Trail(spacing_m=0.125)
    for k in range(9):
        trail.add(SE2(0.125 * k, 0.0, 0.0))
    for k in range(4):
        trail.add(SE2(1.0, 0.0, 0.0) @ SE2(-0.125 * k, 0.02 * k, -0.1 * k))
    assert trail.back(1.0) == SE2(1.0, 0.0, 0.0)
    trail.driven_back_to(SE2(0.99, 0.0, 0.0))
    assert trail.length_m == 1.0
    assert trail.back(0.5) == SE2(0.5, 0.0, 0.0)


def test_the_way_back_turns_where_the_robot_had_turned_on_the_spot():
    trail = Trail(spacing_m=0.125)
    corner, gone = SE2(1.0, 0.0, 0.0), [SE2(1.0, 0.0, 0.3 * k) for k in range(6)]
    for pose in [*(SE2(0.125 * k, 0.0, 0.0) for k in range(9)), *gone]:
        trail.add(pose)
    assert trail.length_m == 1.0
    assert trail.back(0.5) == corner
    beyond = [gone[-1] @ SE2(0.125 * k, 0.0, 0.0) for k in (1, 2)]
    for pose in beyond:
        trail.add(pose)
    assert trail.back(0.5) == gone[-1]
    trail.driven_back_to(gone[-1])
    assert trail.poses[-1] == gone[-1]
    trail.driven_back_to(corner @ SE2(0.0, 0.0, 2.0))  # looked around on the spot: the way is still the way
    assert trail.length_m == 1.0
    trail.driven_back_to(corner)
    assert trail.back(0.5) == SE2(0.5, 0.0, 0.0)


def test_a_swing_stays_on_free_ground_and_turns():
    data = np.full((60, 60), FREE, np.int8)
    grid = OccupancyGrid(data, 0.05, -1.5, -1.5)
    ahead = escape_arc(grid, SE2(), 0.2, 1.0, 0.3, ahead=True)
    assert (ahead.x, ahead.theta) == pytest.approx((np.sin(0.3), 0.3))
    back = escape_arc(grid, SE2(), 0.2, 1.0, 0.3, ahead=False)
    assert (back.x, back.theta) == pytest.approx((-np.sin(0.3), 0.3))
    data[:, 36:] = UNKNOWN
    assert escape_arc(OccupancyGrid(data, 0.05, -1.5, -1.5), SE2(), 0.2, 1.0, 0.3, ahead=True).x < 0.0
    data[:, :24] = UNKNOWN
    assert escape_arc(OccupancyGrid(data, 0.05, -1.5, -1.5), SE2(), 0.2, 1.0, 0.3, ahead=True) is None


def test_the_way_back_after_a_look_elsewhere_is_the_way_that_was_driven():
    """Lost, it swings to the sides and turns; found, it drives on; lost again, it does not cut across."""
    mission, here, driven = mapping_mission(), SE2(), [SE2()]
    lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", grid=OPEN)

    def drive(seconds: float, seen: Situation, goal: SE2) -> SE2:
        for share in np.linspace(0.0, 1.0, 9)[1:]:
            at = here.interpolate(goal, share)
            driven.append(at)
            active = seen._replace(T_odom_base=at, T_map_base=at, navigation=NavigationState.ACTIVE)
            mission.decide(round((seconds + share) * SECOND), active)
        return goal

    for k in range(2, 20):
        decision = mission.decide(3 * k * SECOND, lost._replace(T_odom_base=here, T_map_base=here))
        if decision.action is Action.GO:
            assert decision.reason.startswith("lost: turning") or decision.reason.startswith("lost: looking around")
            here = drive(3 * k + 1, lost, decision.goal)
        if len(driven) > 40:
            break
    found = situation(grid=OPEN, T_odom_base=here, T_map_base=here)
    for k in range(62, 65):
        mission.decide(k * SECOND, found)
    assert mission.state is MissionState.MAPPING
    here = drive(65.0, found, here @ SE2(0.3, 0.0, 0.0))
    for k in range(30, 36):
        decision = mission.decide(3 * k * SECOND, lost._replace(T_odom_base=here, T_map_base=here))
        if decision.goal is not None and "back along the trail" in decision.reason:
            assert here.distance_to(decision.goal) < 0.5
            assert abs(here.angle_to(decision.goal)) < 1.0
            assert min(decision.goal.distance_to(pose) for pose in driven) < 0.02
            here = drive(3.0 * k + 1.0, lost, decision.goal)


@pytest.mark.parametrize("state", [TrackingState.GOOD, TrackingState.LOST])
def test_odometry_that_restarts_ends_the_drive_and_nobody_goes_back_to_before(state):
    mission = mapping_mission()
    wheels_driven(mission, 2.0, SE2(3.0, 3.0, 0.5))
    restarted = situation(slam_state=state, T_odom_base=SE2(), odom_epoch=1, hazard="bumper left pressed")
    decision = mission.decide(3 * SECOND, restarted._replace(navigation=NavigationState.ACTIVE))
    assert decision.action is Action.CANCEL
    assert "restarted" in decision.reason
    for k in range(1, 8):
        goal = mission.decide((3 + k) * SECOND, restarted._replace(navigation=NavigationState.ABORTED)).goal
        assert goal is None or goal.distance_to(SE2()) < 0.5
    assert not any("blacklisted" in event.reason for event in mission.drain_events())


def test_the_way_back_begins_where_odometry_restarted():
    mission = mapping_mission()
    wheels_driven(mission, 2.0, SE2(3.0, 3.0, 0.5))
    restarted = situation(T_odom_base=SE2(), odom_epoch=1)
    active = restarted._replace(navigation=NavigationState.ACTIVE)
    mission.decide(3 * SECOND, active)
    mission.decide(5 * SECOND, restarted)
    pose = SE2()
    for k in range(11):
        pose = SE2(0.05 * k, 0.0, 0.0)
        mission.decide(11 * SECOND + k, active._replace(T_odom_base=pose))
    back = mission.decide(13 * SECOND, restarted._replace(T_odom_base=pose, hazard="bumper left pressed"))
    assert back.frame == "odom"
    assert (back.goal.x, back.goal.y) == pytest.approx((0.15, 0.0))


def test_a_robot_that_was_carried_in_the_air_does_not_back_along_the_way_it_came():
    mission = mapping_mission()
    here = wheels_driven(mission, 2.0, SE2())
    held = situation(slam_state=TrackingState.LOST, slam_reason="dark", T_odom_base=here, hazard="wheel drop left")
    for k in range(3):
        mission.decide((3 + k) * SECOND, held._replace(lifted=True))
    drives = [mission.decide((7 + k) * SECOND, held._replace(hazard=None)) for k in range(3)]
    assert "looking around on the spot" in next(drive.reason for drive in drives if drive.action is Action.GO)


def test_a_robot_that_was_carried_in_the_air_trusts_the_map_no_more_until_it_knows_its_place():
    mission = mapping_mission()
    wheels_driven(mission, 1.0, SE2())
    lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", T_odom_base=SE2(1, 0, 0), grid=OPEN)
    mission.decide(3 * SECOND, lost._replace(lifted=True))
    goals = [mission.decide((4 + 2 * k) * SECOND, lost).goal for k in range(6)]
    driven = [goal for goal in goals if goal is not None]
    assert driven
    assert [goal.distance_to(SE2(1, 0, 0)) for goal in driven] == pytest.approx([0.0] * len(driven)), "on the spot"


def test_a_resumed_mission_goes_back_along_the_way_it_remembers_although_its_odometry_restarts():
    mission = mapping_mission()
    here = wheels_driven(mission, 2.0, SE2())
    saved = mission.to_save(3 * SECOND, here, 0)
    again = Mission(Config(), euclid)
    again.restore(4 * SECOND, saved, SE2())
    lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", odom_epoch=7)
    decisions = [again.decide((4 + k) * SECOND, lost) for k in range(12)]
    back = next(decision for decision in decisions if decision.action is Action.GO)
    assert -0.5 < back.goal.x < -0.25


def test_a_resumed_mission_that_knows_neither_place_nor_way_looks_around_on_the_spot():
    saved = mapping_mission().to_save(3 * SECOND, SE2(), 0)
    again = Mission(Config(), euclid)
    again.restore(4 * SECOND, saved._replace(trail=[]), SE2())
    goals, pose = [], SE2(1.0, 2.0, 0.3)
    for k in range(60):
        lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", T_map_base=None, grid=None)
        decision = again.decide((4 + k) * SECOND, lost._replace(T_odom_base=pose))
        if decision.action is Action.GO:
            goals.append(decision.goal)
            pose = decision.goal
    assert len(goals) == 8
    assert all(goal.distance_to(pose) < 1e-9 for goal in goals)
    assert again.outcome is Outcome.LOST


def test_found_at_the_last_thing_to_try_and_lost_for_a_moment_it_explores_on():
    mission = Mission(Config(), euclid)
    lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", T_map_base=None, grid=None)
    turns, now_ns = 0, SECOND
    while turns < 8:
        turns += mission.decide(now_ns, lost).action is Action.GO
        now_ns += 2 * SECOND
    for k in range(3):
        mission.decide(now_ns + k * SECOND, situation(grid=None))
    assert mission.state is MissionState.MAPPING
    mission.decide(now_ns + 4 * SECOND, situation(slam_state=TrackingState.LOST, slam_reason="dark", grid=None))
    for k in range(5, 9):
        mission.decide(now_ns + k * SECOND, situation(grid=None))
    assert mission.outcome is None
    assert mission.state is MissionState.MAPPING


def test_in_a_map_made_before_it_first_looks_for_its_place_and_then_explores():
    mission = Mission(Config(), euclid)
    lost = situation(slam_state=TrackingState.LOST, slam_reason="not yet recognised", T_map_base=None, grid=None)
    assert mission.decide(SECOND, lost).action is Action.WAIT
    assert mission.state is MissionState.RECOVERING
    assert mission.decide(3 * SECOND, lost).action is Action.WAIT
    turn = mission.decide(7 * SECOND, lost)
    assert turn.action is Action.GO
    assert "looking around" in turn.reason
    for k in range(2):
        mission.decide((9 + 2 * k) * SECOND, situation())
    assert mission.state is MissionState.MAPPING
