"""The mission's state machine, driven by hand through every box of its diagram."""

from pathlib import Path

import numpy as np
import pytest
from missions import SECOND, euclid, half_known, mapping_mission, situation

from vsx_ros.config import Config
from vsx_ros.exploration import view_selector
from vsx_ros.exploration.decision import Action, NavigationState, Outcome, SavedMission
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.view import with_view
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.slam.state import TrackingState


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


LOST_GOAL = {"navigation": NavigationState.LOST, "navigation_reason": "move_base has lost the goal"}


def test_a_goal_that_move_base_has_lost_is_sent_again_and_counts_as_nothing():
    mission = mapping_mission()
    first = mission.view_selector.ranking.views[0].pose
    seen_from = list(mission.view_selector.looked_from)
    assert mission.decide(2 * SECOND, situation(**LOST_GOAL)).reason == "move_base has lost the goal"
    again = mission.decide(3 * SECOND, situation(**LOST_GOAL))
    assert (again.action, again.goal) == (Action.GO, first)
    assert mission.view_selector.blacklist.left(3 * SECOND) == []
    assert mission.view_selector.looked_from == seen_from


def test_a_lost_goal_of_the_way_home_is_not_home():
    mission = mapping_mission()
    mission.home(2 * SECOND)
    for k in range(3, 30, 2):
        assert mission.decide(k * SECOND, situation()).reason == "driving home"
        mission.decide((k + 1) * SECOND, situation(**LOST_GOAL))
        assert mission.outcome is None


def test_a_lost_start_drive_is_no_attempt():
    mission = Mission(Config(), euclid)
    start = situation(slam_state=TrackingState.NOT_INITIALISED, grid=None)
    ahead = mission.decide(0, start)
    for k in range(1, 30):
        assert mission.decide(2 * k * SECOND, start._replace(**LOST_GOAL)).goal == ahead.goal, k


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
    config = with_view(Config()).exploration
    expected = view_selector.ExpectedGain(SE2(0.5, 0.0, 0.0), before, 0.2, np.zeros((0, 3)), config)
    told = [expected.why_obsolete(grid) for grid in after]
    assert told[:3] == ["", "", ""]
    assert told[3].startswith("seen on the way: 0.0 of")
    assert max(max(shape) for shape in judged) < 200


def test_where_every_view_is_out_of_reach_it_steps_back_then_turns_and_only_then_gives_up():
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.full(len(poses), np.inf))
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
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.full(len(poses), np.inf))
    stands = situation(T_map_base=SE2(1.45, 0.0, 0.0))
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    decisions = [mission.decide((2 + 3 * k) * SECOND, stands) for k in range(14)]
    goals = [decision.goal for decision in decisions if decision.action is Action.GO]
    assert len(goals) == 8
    assert all(goal.distance_to(SE2()) == 0.0 and abs(goal.theta) == pytest.approx(np.pi / 4) for goal in goals)


def test_a_mission_that_begins_boxed_in_and_turns_looks_all_around() -> None:
    """The way back along a trail of turns on the spot would turn it back again."""
    mission, at = Mission(Config(), lambda start, grid, clearance_m, poses: np.full(len(poses), np.inf)), SE2()
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    headings = []
    for k in range(60):
        stands = situation(T_map_base=SE2(1.45, 0.0, at.theta), T_odom_base=at)
        decision = mission.decide((2 + 3 * k) * SECOND, stands)
        if decision.action is Action.GO:
            half = SE2(at.x, at.y, 0.5 * (at.theta + decision.goal.theta))
            mission.decide((3 + 3 * k) * SECOND, stands._replace(T_odom_base=half, navigation=NavigationState.ACTIVE))
            at = decision.goal
            headings.append(at.theta)
    assert np.diff(headings) == pytest.approx([np.pi / 4] * 7)
    assert mission.outcome is Outcome.BOXED_IN


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
    assert not stopped.to_save(10 * SECOND, SE2(), 0).going_home


def test_on_the_way_to_a_view_it_turns_home_at_once_when_asked():
    mission, driving = mapping_mission(), situation(navigation=NavigationState.ACTIVE)
    mission.home(2 * SECOND)
    assert mission.decide(2 * SECOND, driving).action is Action.CANCEL
    stopped = situation(navigation=NavigationState.ABORTED, navigation_reason="cancelled")
    assert mission.decide(3 * SECOND, stopped).reason == "driving home"
    assert mission.decide(4 * SECOND, driving).reason == "on the way: driving home"


def test_without_odometry_it_waits():
    assert Mission(Config(), euclid).decide(0, situation(T_odom_base=None)).action is Action.WAIT


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
    resumed.restore(
        3 * SECOND, SavedMission.of(mission.to_save(2 * SECOND, here, 0).tree(), Path("mission.json")), SE2()
    )
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
