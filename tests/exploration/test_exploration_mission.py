"""The mission's state machine, driven by hand through every box of its diagram."""

from pathlib import Path

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.exploration import view_selector
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Outcome, SavedMission, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.recovery import Trail, escape_arc
from vsx_ros.exploration.utility import near_poses
from vsx_ros.exploration.view_selector import GoalBlacklist
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.slam.state import TrackingState

SECOND = 1_000_000_000
LANDMARKS = np.random.default_rng(0).uniform([1.0, -2.0, 0.0], [3.0, 2.0, 1.0], (800, 3))


def half_known() -> OccupancyGrid:
    """Free for x < 1.5 m, unknown beyond."""
    data = np.full((80, 120), UNKNOWN, np.int8)
    data[:, :60] = FREE
    return OccupancyGrid(data, 0.05, -1.5, -2.0)


def euclid(start, grid):
    return lambda poses: np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)


def situation(**changes) -> Situation:
    default = Situation(TrackingState.GOOD, "", SE2(), SE2(), half_known(), NavigationState.IDLE, "", None, LANDMARKS)
    return default._replace(**changes)


def mapping_mission() -> Mission:
    mission = Mission(Config(), euclid)
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    assert mission.decide(SECOND, situation()).action is Action.GO
    assert mission.state is MissionState.MAPPING
    return mission


def test_it_begins_with_a_straight_drive_by_odometry():
    mission = Mission(Config(), euclid)
    decision = mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, T_odom_base=SE2(1, 2, np.pi / 2)))
    assert decision.action is Action.GO
    assert decision.frame == "odom"
    assert (decision.goal.x, decision.goal.y) == pytest.approx((1.0, 2.0 + Config().exploration.init_drive_m))


def test_it_gives_up_starting_when_all_headings_are_tried_and_says_why():
    mission = Mission(Config(), euclid)
    blind = situation(slam_state=TrackingState.NOT_INITIALISED, slam_reason="12 corners seen")
    decisions = [mission.decide(k * 2 * SECOND, blind) for k in range(12)]
    goals = [d.goal for d in decisions if d.action is Action.GO]
    turned = [round(float(np.degrees(abs(goal.theta)))) for goal in goals]
    assert turned == [0, 0, 90] * (Config().exploration.init_headings - 1) + [0, 0]
    drive_m = Config().exploration.init_drive_m
    assert [goal.x for goal in goals] == pytest.approx([drive_m, -drive_m, 0.0] * 3 + [drive_m, -drive_m])
    assert decisions[-1].action is Action.FINISH
    assert mission.outcome is Outcome.NOT_STARTED
    assert "12 corners seen" in decisions[-1].reason


def test_it_goes_to_a_view_of_the_unknown_and_says_its_utility():
    mission = Mission(Config(), euclid)
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED))
    decision = mission.decide(SECOND, situation())
    assert decision.action is Action.GO
    assert decision.frame == "map"
    assert "U = v/d" in decision.reason
    assert abs(decision.goal.theta) < 1.0 or abs(decision.goal.theta - 2 * np.pi) < 1.0
    under_way = mission.decide(2 * SECOND, situation(navigation=NavigationState.ACTIVE))
    assert under_way.reason == f"on the way: {decision.reason}"


def test_a_failed_goal_is_not_chosen_again_at_once():
    mission = mapping_mission()
    first = mission.view_selector.ranking.views[0].pose
    failed = situation(navigation=NavigationState.ABORTED, navigation_reason="goal blocked")
    assert mission.decide(2 * SECOND, failed).reason == "coming to rest"
    decision = mission.decide(4 * SECOND, failed)
    assert decision.action is Action.GO
    assert decision.goal.distance_to(first) > 0.3 or abs(decision.goal.angle_to(first)) > 0.7
    assert any("goal blocked" in event.reason for event in mission.drain_events())


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
    wide = OccupancyGrid(np.full((120, 240), FREE, np.int8), 0.05, -6.0, -3.0)
    pose, goals, now_ns = SE2(trail_m, 0, 0), [], 3 * SECOND
    while mission.outcome is None:
        lost = situation(
            slam_state=TrackingState.LOST, slam_reason="dark", grid=wide, landmarks_world=landmarks, T_odom_base=pose,
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


def test_it_ends_explored_when_nothing_is_left_and_counts_the_reasons():
    known = OccupancyGrid(np.full((80, 80), FREE, np.int8), 0.05, -2.0, -2.0)
    mission = mapping_mission()
    decision = None
    for k in range(20):
        decision = mission.decide((2 + 3 * k) * SECOND, situation(grid=known, navigation=NavigationState.SUCCEEDED))
        if decision.action is Action.FINISH:
            break
    assert mission.outcome is Outcome.EXPLORED
    assert "gain too small" in decision.reason


def test_a_goal_whose_view_was_seen_on_the_way_is_left_without_blame():
    mission = mapping_mission()
    goal = mission.view_selector.ranking.views[0].pose
    active = situation(navigation=NavigationState.ACTIVE)
    assert mission.decide(2 * SECOND, active._replace(grid=half_known())).action is Action.WAIT
    known = [OccupancyGrid(np.full((80, 120), FREE, np.int8), 0.05, -1.5, -2.0) for _ in range(5)]
    for now_ns, grid in enumerate([known[0], known[1], half_known(), known[2], known[3], known[3]], 2 * SECOND):
        assert mission.decide(now_ns, active._replace(grid=grid)).action is Action.WAIT
    decision = mission.decide(3 * SECOND, active._replace(grid=known[4]))
    assert decision.action is Action.CANCEL
    assert "seen on the way" in decision.reason
    stopped = situation(navigation=NavigationState.ABORTED, navigation_reason="cancelled", grid=half_known())
    assert mission.decide(3 * SECOND + SECOND // 4, stopped).action is Action.WAIT
    assert mission.decide(4 * SECOND, stopped).goal == goal
    assert not any("blacklisted" in event.reason for event in mission.drain_events())


def test_a_goal_is_judged_by_the_map_around_it(monkeypatch):
    """So that it costs the same in a building as in a room, at every map of every drive."""
    judged, gain_at = [], view_selector.gain_at

    def noted(grid, *args):
        judged.append(grid.shape)
        return gain_at(grid, *args)

    monkeypatch.setattr(view_selector, "gain_at", noted)
    seen, unseen = np.full((2000, 3000), FREE, np.int8), np.full((2000, 3000), FREE, np.int8)
    unseen[:, 1500:] = UNKNOWN
    before, *after = (OccupancyGrid(data, 0.05, -73.5, -50.0) for data in (unseen, unseen, seen, seen, seen))
    expected = view_selector.ExpectedGain(SE2(0.5, 0.0, 0.0), before, 0.2, np.zeros((0, 3)), Config().exploration)
    told = [expected.why_obsolete(grid) for grid in after]
    assert told[:3] == ["", "", ""]
    assert told[3].startswith("seen on the way: 0.0 of")
    assert max(max(shape) for shape in judged) < 200


def test_where_every_view_is_out_of_reach_it_steps_back_then_turns_and_only_then_gives_up():
    mission = Mission(Config(), lambda start, grid: lambda poses: np.full(len(poses), np.inf))
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    for k in range(1, 12):
        mission.decide(k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    decisions = [mission.decide((2 + 3 * k) * SECOND, situation(T_odom_base=SE2(0.5, 0, 0))) for k in range(14)]
    goals = [decision.goal for decision in decisions if decision.action is Action.GO]
    config = Config().exploration
    assert len(goals) == config.retries_boxed_in
    assert all(decision.frame == "odom" for decision in decisions if decision.action is Action.GO)
    turns = [abs(goal.theta) for goal in goals]
    assert max(turns[: config.retries_without_view]) == 0.0
    phi = Config().planner.phi_rad_m
    assert turns[config.retries_without_view :] == pytest.approx([config.backtrack_step_m * phi] * 8)
    assert mission.outcome is Outcome.BOXED_IN
    assert "unreachable" in decisions[-1].reason


def test_a_mission_that_begins_boxed_in_looks_around_on_the_spot():
    mission = Mission(Config(), lambda start, grid: lambda poses: np.full(len(poses), np.inf))
    stands = situation(T_map_base=SE2(1.45, 0.0, 0.0))
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    decisions = [mission.decide((2 + 3 * k) * SECOND, stands) for k in range(14)]
    goals = [decision.goal for decision in decisions if decision.action is Action.GO]
    assert len(goals) == 8
    assert all(goal.distance_to(SE2()) == 0.0 and abs(goal.theta) == pytest.approx(np.pi / 4) for goal in goals)


def test_what_failed_is_tried_again_when_nothing_else_is_left_but_not_for_ever():
    config = Config()
    only = SE2(1.0, 0.0, 0.0)

    def one_place(start, grid):
        return lambda poses: np.where(near_poses(poses, only.as_array()[None], 0.15, 0.2), 1.0, np.inf)

    mission = Mission(config, one_place)
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    chosen = 0
    for k in range(80):
        decision = mission.decide((1 + 3 * k) * SECOND, situation(navigation=NavigationState.ABORTED))
        chosen += decision.action is Action.GO and decision.frame == "map"
        if decision.action is Action.FINISH:
            break
    assert mission.outcome is Outcome.EXPLORED
    assert chosen == 3
    assert sum("tried again" in event.reason for event in mission.drain_events()) == 2


def test_a_bumper_stops_and_then_backs_off():
    mission = mapping_mission()
    for k in range(20):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    hit = situation(T_odom_base=SE2(0.95, 0, 0), hazard="bumper left pressed")
    assert mission.decide(3 * SECOND, hit._replace(navigation=NavigationState.ACTIVE)).action is Action.CANCEL
    aborted = hit._replace(navigation=NavigationState.ABORTED, navigation_reason="cancelled")
    assert mission.decide(4 * SECOND, aborted).action is Action.WAIT
    back = mission.decide(6 * SECOND, aborted)
    assert back.action is Action.GO
    assert back.frame == "odom"
    assert back.goal.x < 0.75
    reasons = [event.reason for event in mission.drain_events()]
    assert reasons.count("stopping: bumper left pressed") == 1
    assert any("blacklisted" in reason and reason.endswith("bumper left pressed") for reason in reasons)


def test_pause_resume_stop_and_home():
    mission = mapping_mission()
    mission.pause(2 * SECOND)
    assert mission.decide(2 * SECOND, situation(navigation=NavigationState.ACTIVE)).action is Action.CANCEL
    assert mission.decide(3 * SECOND, situation()).action is Action.WAIT
    mission.resume(4 * SECOND)
    assert mission.decide(5 * SECOND, situation()).action is Action.GO
    mission.home(6 * SECOND)
    home = mission.decide(7 * SECOND, situation(navigation=NavigationState.SUCCEEDED))
    assert (home.goal.x, home.goal.y) == (0.0, 0.0)
    assert mission.decide(8 * SECOND, situation(navigation=NavigationState.SUCCEEDED)).action is Action.FINISH
    assert mission.outcome is Outcome.HOME
    stopped = mapping_mission()
    stopped.stop(9 * SECOND)
    assert stopped.decide(9 * SECOND, situation()).action is Action.FINISH
    assert stopped.outcome is Outcome.STOPPED
    stopped.home(10 * SECOND)
    assert stopped.decide(10 * SECOND, situation()).reason == "stopped by the operator"
    assert not stopped.to_save(10 * SECOND, SE2()).going_home


def test_on_the_way_to_a_view_it_turns_home_at_once_when_asked():
    mission, driving = mapping_mission(), situation(navigation=NavigationState.ACTIVE)
    mission.home(2 * SECOND)
    assert mission.decide(2 * SECOND, driving).action is Action.CANCEL
    stopped = situation(navigation=NavigationState.ABORTED, navigation_reason="cancelled")
    assert mission.decide(3 * SECOND, stopped).reason == "driving home"
    assert mission.decide(4 * SECOND, driving).reason == "on the way: driving home"


def test_without_odometry_it_waits():
    assert Mission(Config(), euclid).decide(0, situation(T_odom_base=None)).action is Action.WAIT


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


def test_a_goal_that_fails_again_is_left_alone_twice_as_long():
    blacklist = GoalBlacklist(radius_m=0.4, first_s=10.0)
    here = np.array([[1.0, 0.0, 0.0]])
    assert blacklist.add(0, SE2(1.0, 0.0, 0.0)) == 10.0
    assert blacklist.near(9 * SECOND, here).all()
    assert not blacklist.near(11 * SECOND, here).any()
    assert blacklist.add(20 * SECOND, SE2(1.2, 0.0, 0.3)) == 20.0
    assert blacklist.add(20 * SECOND, SE2(3.0, 0.0, 0.0)) == 10.0
    assert not blacklist.near(25 * SECOND, np.array([[1.1, 0.0, 2.0], [2.0, 0.0, 0.0]])).any()
    assert [(left, times) for _, left, times in blacklist.left(25 * SECOND)] == [(0.0, 1), (15.0, 2), (5.0, 1)]
    again = GoalBlacklist(radius_m=0.4, first_s=10.0)
    again.restore(SECOND, blacklist.left(25 * SECOND))
    assert again.near(15 * SECOND, here).all()
    assert not again.near(17 * SECOND, here).any()


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


def wheels_driven(mission: Mission, way_m: float, start: SE2) -> SE2:
    """A drive straight ahead, in steps of 5 cm; where the wheels are then."""
    pose = start
    for k in range(round(way_m / 0.05) + 1):
        pose = start @ SE2(0.05 * k, 0.0, 0.0)
        mission.decide(2 * SECOND + k, situation(T_odom_base=pose, navigation=NavigationState.ACTIVE))
    return pose


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
    assert "turning to look elsewhere" in next(drive.reason for drive in drives if drive.action is Action.GO)


def test_a_resumed_mission_goes_back_along_the_way_it_remembers_although_its_odometry_restarts():
    mission = mapping_mission()
    here = wheels_driven(mission, 2.0, SE2())
    saved = mission.to_save(3 * SECOND, here)
    again = Mission(Config(), euclid)
    again.restore(4 * SECOND, saved, SE2())
    lost = situation(slam_state=TrackingState.LOST, slam_reason="dark", odom_epoch=7)
    decisions = [again.decide((4 + k) * SECOND, lost) for k in range(12)]
    back = next(decision for decision in decisions if decision.action is Action.GO)
    assert -0.5 < back.goal.x < -0.25


def test_a_resumed_mission_that_knows_neither_place_nor_way_looks_around_on_the_spot():
    saved = mapping_mission().to_save(3 * SECOND, SE2())
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


def test_home_is_where_the_exploration_began_although_the_wheels_counted_before():
    began = SE2(5.0, 1.0, 0.5)
    here = began @ SE2(0.4, 0.0, 0.0)
    mission = Mission(Config(), euclid)
    unstarted = situation(slam_state=TrackingState.NOT_INITIALISED, T_map_base=None, T_odom_base=began)
    assert mission.decide(0, unstarted).action is Action.GO
    T_map_odom = SE2(1.0, 0.0, 0.3)  # as of a map made before
    tracked = situation(T_map_base=T_map_odom @ here, T_odom_base=here)
    mission.decide(SECOND, tracked)
    mission.home(2 * SECOND)
    resumed = Mission(Config(), euclid)
    resumed.restore(3 * SECOND, SavedMission.of(mission.to_save(2 * SECOND, here).tree(), Path("mission.json")), SE2())
    elsewhere = situation(T_map_base=SE2(0.3, 0.2, 0.0))
    for now_s in (3, 4):
        resumed.decide(now_s * SECOND, elsewhere)
    for decision in (mission.decide(3 * SECOND, tracked), resumed.decide(5 * SECOND, elsewhere)):
        assert decision.reason == "driving home"
        assert decision.goal.as_array() == pytest.approx((T_map_odom @ began).as_array(), abs=1e-9)


def test_a_home_that_cannot_be_reached_ends_the_mission_with_the_reason():
    mission = mapping_mission()
    mission.home(2 * SECOND)
    tries = 0
    for k in range(40):
        failed = situation(navigation=NavigationState.ABORTED, navigation_reason="no way joins")
        decision = mission.decide((3 + k) * SECOND, failed)
        tries += decision.action is Action.GO
    assert decision.action is Action.FINISH
    assert mission.outcome is Outcome.STRANDED
    assert 3 <= tries <= 10
    assert "no way joins" in decision.reason


def test_a_goal_that_fails_for_ever_is_left_alone_for_hours_at_most():
    blacklist = GoalBlacklist(radius_m=0.4, first_s=10.0)
    for _ in range(1100):
        seconds = blacklist.add(0, SE2(1.0, 0.0, 0.0))
    assert 600.0 < seconds < 36000.0


def test_who_knows_no_way_back_leaves_a_hazard_by_an_arc_over_free_ground():
    mission = mapping_mission()
    stuck = situation(hazard="stuck: the wheels turned 0.06 m back")
    decision = mission.decide(4 * SECOND, stuck)
    assert decision.frame == "odom"
    assert 0.2 < decision.goal.distance_to(SE2()) < 0.4
    assert abs(decision.goal.theta) > 0.2
    under_way = mission.decide(5 * SECOND, stuck._replace(navigation=NavigationState.ACTIVE))
    assert under_way.action is Action.WAIT
    unknown = OccupancyGrid(np.full((80, 120), UNKNOWN, np.int8), 0.05, -1.5, -2.0)
    nowhere = mapping_mission().decide(4 * SECOND, stuck._replace(grid=unknown))
    assert nowhere.action is Action.WAIT


def test_where_backing_off_does_not_help_it_turns_away_over_free_ground():
    mission = mapping_mission()
    pose = wheels_driven(mission, 4.0, SE2())
    wedged = situation(T_odom_base=pose, hazard="bumper", navigation=NavigationState.ABORTED)
    decisions = [mission.decide((4 + 2 * k) * SECOND, wedged) for k in range(10)]
    goals = [decision.goal for decision in decisions if decision.action is Action.GO]
    assert len(goals) >= 4
    turns = [abs(pose.angle_to(goal)) > 0.2 for goal in goals]
    assert turns == [k % 2 == 1 for k in range(len(goals))]


@pytest.mark.parametrize("way_m", [0.0, 20.0])
def test_a_hazard_that_stays_ends_the_mission(way_m: float):
    mission = mapping_mission()
    end = pose = wheels_driven(mission, way_m, SE2())
    steps, far_m = 0, 0.0
    while mission.outcome is None:
        jammed = situation(T_odom_base=pose, hazard="bumper left pressed", navigation=NavigationState.SUCCEEDED)
        decision = mission.decide((4 + steps) * SECOND, jammed)
        steps += 1
        if decision.action is Action.GO:
            assert decision.frame == "odom", "no drive on the map while it lasts"
            pose = decision.goal
            far_m = max(far_m, pose.distance_to(end))
    assert mission.outcome is Outcome.BLOCKED
    assert "bumper left pressed" in decision.reason
    assert steps > 30
    assert min(way_m, 4.0) <= far_m < 9.0


def test_a_bumper_that_comes_free_each_time_is_no_hazard_that_stays():
    mission = mapping_mission()
    pose = wheels_driven(mission, 4.0, SE2())
    for k in range(100):
        mission.decide((4 + 4 * k) * SECOND, situation(T_odom_base=pose, hazard="bumper left pressed"))
        mission.decide((6 + 4 * k) * SECOND, situation(T_odom_base=pose))
    assert sum("backing off" in event.reason for event in mission.drain_events()) > 12, "too few to tell"
    assert mission.outcome is not Outcome.BLOCKED
