"""The operator is heard: held wheels and goals of the user's hold the mission, and nothing is blamed for them."""

import numpy as np
import pytest
from missions import SECOND, euclid, mapping_mission, situation

from vsx_ros.config import Config, overridden
from vsx_ros.exploration.decision import DOCK, OPERATOR, Action, MissionState, NavigationState, Outcome
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.user_goals import GoalState, UserGoals
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import EMERGENCY_STOP, OperatorHold, UserGoal
from vsx_ros.slam.state import TrackingState

FAILED = NavigationState.ABORTED
STOPPED = OperatorHold(EMERGENCY_STOP, 2 * SECOND)
TELEOP = OperatorHold("teleop", 2 * SECOND)
GOAL = UserGoal("/rviz-1", "/rviz", 2 * SECOND)


def blamed(mission: Mission, now_ns: int) -> int:
    return len(mission.view_selector.blacklist.left(now_ns))


@pytest.mark.parametrize("hold", [STOPPED, TELEOP])
def test_five_minutes_of_held_wheels_cost_no_goal_and_no_view(hold):
    mission = mapping_mission()
    first = mission.decide(2 * SECOND, situation(navigation=NavigationState.ACTIVE, held=hold))
    assert (first.action, mission.state) == (Action.CANCEL, MissionState.HELD)
    assert hold.by in first.reason
    for k in range(1, 5 * 60 * 5):
        decision = mission.decide(2 * SECOND + k * SECOND // 5, situation(navigation=FAILED, held=hold))
        assert decision.action is Action.WAIT
    now_ns = 303 * SECOND
    assert mission.decide(now_ns, situation(navigation=FAILED)).action is Action.WAIT
    assert mission.state is MissionState.MAPPING
    again = mission.decide(now_ns + SECOND, situation(navigation=FAILED))
    assert again.action is Action.GO
    assert blamed(mission, now_ns) == 0
    told = [event.reason for event in mission.drain_events() if event.state == "held"]
    assert told == [hold.words()], "one event for the whole hold"


def test_a_failure_told_before_the_hold_that_caused_it_is_withdrawn():
    mission = mapping_mission()
    mission.decide(2 * SECOND + SECOND // 10, situation(navigation=FAILED, navigation_reason="heading 15 deg off"))
    assert blamed(mission, 2 * SECOND) == 1
    mission.decide(3 * SECOND, situation(navigation=FAILED, held=STOPPED))
    assert blamed(mission, 3 * SECOND) == 0


def test_drives_home_that_the_operator_ended_are_no_tries():
    """Each is told as failed just before the hold."""
    mission = mapping_mission()
    mission.home(2 * SECOND)
    for k in range(1, 11):
        begin_ns = 20 * k * SECOND
        assert mission.decide(begin_ns, situation()).reason == "driving home", k
        mission.decide(begin_ns + SECOND, situation(navigation=FAILED, navigation_reason="the drive was ended"))
        hold = OperatorHold(EMERGENCY_STOP, begin_ns + SECOND + SECOND // 5)
        mission.decide(hold.since_ns, situation(navigation=FAILED, held=hold))
        mission.decide(begin_ns + 5 * SECOND, situation(navigation=FAILED))
    assert mission.outcome is None


def test_drives_home_count_as_tries_only_while_the_robot_comes_no_nearer():
    mission, far_m, tries = mapping_mission(), 8.0, 0
    mission.home(2 * SECOND)
    for k in range(3, 400, 10):
        here = SE2(max(far_m - 1.0 * tries, 1.0), 0.0, 0.0)
        decision = mission.decide(k * SECOND, situation(T_map_base=here, T_odom_base=here))
        tries += decision.action is Action.GO
        mission.decide((k + 1) * SECOND, situation(T_map_base=here, T_odom_base=here, navigation=FAILED))
    assert mission.outcome is Outcome.STRANDED
    assert tries == 7 + 5, "each of seven came nearer, and five did not"


def test_an_older_failure_stays_one():
    mission = mapping_mission()
    mission.decide(2 * SECOND, situation(navigation=FAILED, navigation_reason="goal blocked"))
    mission.decide(9 * SECOND, situation(navigation=FAILED, held=OperatorHold("teleop", 9 * SECOND)))
    assert blamed(mission, 9 * SECOND) == 1


def test_a_held_start_drive_is_no_attempt():
    mission = Mission(Config(), euclid)
    blind = situation(slam_state=TrackingState.NOT_INITIALISED, grid=None)
    for k in range(30):
        now_ns = 10 * k * SECOND
        assert mission.decide(now_ns, blind).action is Action.GO, k
        mission.decide(now_ns + SECOND, blind._replace(navigation=NavigationState.ACTIVE, held=TELEOP))
        mission.decide(now_ns + 5 * SECOND, blind._replace(navigation=FAILED))
        assert mission.state is MissionState.STARTING


@pytest.mark.parametrize("by", [OPERATOR, DOCK])
def test_a_paused_start_drive_is_no_attempt(by):
    mission, drive_m = Mission(Config(), euclid), Config().exploration.init_drive_m
    begin = situation(slam_state=TrackingState.NOT_INITIALISED, T_map_base=None, grid=None)
    assert mission.decide(0, begin).goal.x == pytest.approx(drive_m)
    mission.pause(SECOND, by)
    cut = begin._replace(T_odom_base=SE2(0.05, 0.0, 0.0))
    for k in range(3):
        mission.decide((1 + k) * SECOND, cut._replace(navigation=NavigationState.ACTIVE))
    elsewhere = cut._replace(T_odom_base=SE2(-0.45, 0.0, np.pi), navigation=NavigationState.ABORTED)
    mission.decide(9 * SECOND, elsewhere)
    mission.resume(10 * SECOND, by)
    assert mission.decide(10 * SECOND, elsewhere).goal.x == pytest.approx(-0.45 - drive_m), (
        "ahead, from where it is now"
    )
    there = elsewhere._replace(T_odom_base=SE2(-0.45 - drive_m, 0.0, np.pi), navigation=NavigationState.SUCCEEDED)
    assert mission.decide(20 * SECOND, there).goal.x == pytest.approx(-0.45)


def test_a_goal_of_the_user_before_the_first_drive_has_begun_is_no_attempt():
    mission, drive_m = Mission(Config(), euclid), Config().exploration.init_drive_m
    begin = situation(slam_state=TrackingState.NOT_INITIALISED, T_map_base=None, grid=None)
    mission.decide(0, begin)
    assert mission.decide(0, begin._replace(user_goal=UserGoal("a-1", "a", 0))).action is Action.WAIT
    for k in range(1, 9):
        decision = mission.decide(k * SECOND, begin)
    assert decision.goal is None or decision.goal.x == pytest.approx(drive_m)


def test_driving_by_hand_makes_the_trail_longer():
    """Lost afterwards, the robot backs along the ground that the operator drove it over."""
    mission = mapping_mission()
    for k in range(41):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), held=TELEOP))
    lost = situation(slam_state=TrackingState.LOST, T_odom_base=SE2(2.0, 0, 0))
    decisions = [mission.decide(3 * SECOND + k * SECOND // 2, lost) for k in range(8)]
    back = next(decision for decision in decisions if decision.action is Action.GO)
    assert back.goal.x == pytest.approx(2.0 - Config().exploration.backtrack_step_m, abs=0.06)


def test_the_way_back_does_not_jump_over_ground_driven_by_hand_while_a_step_back_was_paused():
    mission, bumper = mapping_mission(), "bumper left pressed"
    for k in range(20):
        mission.decide(2 * SECOND + k, situation(T_odom_base=SE2(0.05 * k, 0, 0), navigation=NavigationState.ACTIVE))
    for k in (3, 5):
        hit = mission.decide(k * SECOND, situation(T_odom_base=SE2(0.95, 0, 0), hazard=bumper, navigation=FAILED))
    assert hit.reason == f"backing off: {bumper}"
    mission.pause(7 * SECOND)
    for k in range(41):
        by_hand = situation(T_odom_base=SE2(0.95, 0.03 * k, 0), held=TELEOP, navigation=FAILED)
        mission.decide(8 * SECOND + k, by_hand)
    mission.resume(9 * SECOND)
    lost = by_hand._replace(slam_state=TrackingState.LOST, held=None)
    decisions = [mission.decide(10 * SECOND + k * SECOND // 2, lost) for k in range(8)]
    back = next(decision for decision in decisions if decision.action is Action.GO)
    assert (back.goal.x, back.goal.y) == pytest.approx((0.95, 1.2 - Config().exploration.backtrack_step_m), abs=0.06)


def test_a_pause_within_a_hold_stays_a_pause_and_resumes_where_it_was():
    mission = mapping_mission()
    mission.decide(2 * SECOND, situation(held=STOPPED))
    mission.pause(3 * SECOND)
    mission.drain_events()
    for k in range(5):
        assert STOPPED.words() in mission.decide(3 * SECOND + k, situation(held=STOPPED)).reason
    assert [event.state for event in mission.drain_events()] == ["paused"], "told once"
    assert mission.decide(4 * SECOND, situation()).reason == "paused"
    mission.resume(5 * SECOND)
    assert mission.state is MissionState.MAPPING


def test_who_paused_resumes_and_nobody_for_another():
    mission = mapping_mission()
    mission.pause(2 * SECOND, DOCK)
    assert mission.decide(2 * SECOND, situation()).reason == "paused by the dock"
    mission.pause(3 * SECOND)
    mission.resume(4 * SECOND, DOCK)
    assert mission.decide(4 * SECOND, situation()).reason == "paused"
    mission.pause(5 * SECOND, DOCK)
    mission.resume(6 * SECOND)
    assert mission.decide(6 * SECOND, situation()).action is Action.WAIT, "it charges"
    mission.resume(7 * SECOND, DOCK)
    assert mission.state is MissionState.MAPPING


def test_a_goal_of_the_user_is_driven_to_and_the_exploration_goes_on_after_it():
    mission = mapping_mission()
    for k in range(50):
        decision = mission.decide(2 * SECOND + k * SECOND, situation(navigation=FAILED, user_goal=GOAL))
        assert decision.action is Action.WAIT, "neither another goal nor a cancellation"
        assert mission.state is MissionState.USER_GOAL
    assert "/rviz" in decision.reason
    mission.decide(60 * SECOND, situation(navigation=FAILED, user_goal_end="the goal of /rviz is reached"))
    assert mission.decide(61 * SECOND, situation(navigation=FAILED)).action is Action.GO
    assert blamed(mission, 61 * SECOND) == 0
    assert any("the goal of /rviz is reached" in event.reason for event in mission.drain_events())


def test_it_stays_at_the_goal_when_it_is_told_to():
    config = overridden(Config(), {"exploration.stay_at_user_goal": True})
    mission = Mission(config, euclid)
    mission.decide(0, situation(slam_state=TrackingState.NOT_INITIALISED, grid=None))
    mission.decide(SECOND, situation())
    mission.decide(2 * SECOND, situation(user_goal=GOAL))
    for k in range(3, 60):
        assert mission.decide(k * SECOND, situation(navigation=FAILED)).action is Action.WAIT
    assert mission.state is MissionState.PAUSED
    mission.resume(60 * SECOND)
    assert mission.decide(61 * SECOND, situation(navigation=FAILED)).action is Action.GO


def test_held_wheels_come_before_a_goal_of_the_user():
    mission = mapping_mission()
    mission.decide(2 * SECOND, situation(user_goal=GOAL))
    mission.decide(3 * SECOND, situation(user_goal=GOAL, held=STOPPED))
    assert mission.state is MissionState.HELD
    mission.decide(4 * SECOND, situation(user_goal=GOAL))
    assert mission.state is MissionState.USER_GOAL
    mission.decide(5 * SECOND, situation(user_goal_end="reached"))
    assert mission.state is MissionState.MAPPING


CANCELLED = {"navigation": NavigationState.CANCELLED, "navigation_reason": "cancelled by the client"}


@pytest.mark.parametrize("slam_state", [TrackingState.GOOD, TrackingState.NOT_INITIALISED, TrackingState.LOST])
def test_a_drive_that_somebody_has_cancelled_pauses_the_exploration_and_blames_nobody(slam_state):
    mission = mapping_mission() if slam_state is TrackingState.GOOD else Mission(Config(), euclid)
    known = situation(slam_state=slam_state)
    mission.decide(2 * SECOND, known)
    state, _ = mission.state, mission.drain_events()
    for k in range(3, 60):
        decision = mission.decide(k * SECOND, known._replace(**CANCELLED))
        assert decision.action is Action.WAIT
        assert decision.reason.startswith("paused: somebody has cancelled the drive (cancelled by the client)")
    assert (mission.state, mission.paused_by) == (MissionState.PAUSED, {OPERATOR})
    assert [event.state for event in mission.drain_events()] == ["paused"], "told once"
    mission.resume(60 * SECOND)
    assert mission.state is state
    again = [mission.decide((60 + k) * SECOND, known._replace(**CANCELLED)).action for k in range(9)]
    assert Action.GO in again, "it goes on, with the cancelled goal still the last one"
    assert blamed(mission, 70 * SECOND) == 0


def test_every_cancellation_pauses_it_and_none_makes_a_view_worse():
    mission, goals = mapping_mission(), []
    for k in range(5):
        mission.decide((20 * k + 3) * SECOND, situation(navigation=NavigationState.ACTIVE))
        mission.decide((20 * k + 4) * SECOND, situation(**CANCELLED))
        assert mission.state is MissionState.PAUSED
        mission.resume((20 * k + 5) * SECOND)
        goals += [mission.decide((20 * k + 6) * SECOND, situation(**CANCELLED)).goal]
    assert goals == goals[:1] * 5


def test_a_drive_that_another_goal_has_replaced_blames_nobody_and_it_goes_on():
    mission = mapping_mission()
    replaced = situation(navigation=NavigationState.REPLACED, navigation_reason="replaced by another goal")
    assert mission.decide(2 * SECOND, replaced).action is Action.WAIT
    assert mission.decide(3 * SECOND, replaced).action is Action.GO
    assert blamed(mission, 3 * SECOND) == 0


def test_a_cancellation_while_the_wheels_are_held_or_by_a_user_s_goal_is_no_pause():
    for claim in ({"held": STOPPED}, {"user_goal": GOAL}):
        mission = mapping_mission()
        mission.decide(2 * SECOND, situation(**CANCELLED, **claim))
        mission.decide(3 * SECOND, situation(**CANCELLED))
        assert mission.state is MissionState.MAPPING
        assert blamed(mission, 3 * SECOND) == 0


def test_goals_of_others_are_told_from_ours():
    goals = UserGoals("/explore-")
    goals.sent(0, "/explore-1-2.5")
    assert goals.current is None
    goals.sent(1, "/rviz_7-1-2.5")
    assert goals.current == UserGoal("/rviz_7-1-2.5", "/rviz_7", 1)
    ours = {"/explore-1-2.5": GoalState(live=False, reached=False, reason="replaced")}
    goals.told(2, ours)
    assert goals.current is not None, "move_base has not listed it yet"
    goals.told(3, {**ours, "/rviz_7-1-2.5": GoalState(live=True, reached=False, reason="")})
    assert goals.current is not None
    goals.told(4, {"/rviz_7-1-2.5": GoalState(live=False, reached=False, reason="blocked")})
    assert (goals.current, goals.last_end) == (None, "the goal of /rviz_7 is not reached (blocked)")


@pytest.mark.parametrize(
    ("states", "end"),
    [
        ({"/me-1": GoalState(live=False, reached=True, reason="arrived")}, "the goal of /me is reached"),
        ({}, "move_base does not know the goal of /me any more"),
    ],
)
def test_how_a_goal_of_the_user_ends(states, end):
    goals = UserGoals("/explore-")
    goals.told(0, {"/me-1": GoalState(live=True, reached=False, reason="")})
    goals.told(1, {"/me-1": GoalState(live=True, reached=False, reason="")})
    assert goals.current is not None
    goals.told(2, states)
    assert (goals.current, goals.last_end) == (None, end)


def test_a_goal_that_was_lost_on_its_way_does_not_hold_the_mission():
    goals = UserGoals("/explore-")
    goals.sent(0, "/me-1")
    goals.told(2 * SECOND, {})
    assert goals.current is not None
    goals.told(2 * SECOND + 1, {})
    assert goals.current is None


def test_the_newer_of_two_goals_counts():
    goals = UserGoals("/explore-")
    goals.sent(0, "/me-1")
    goals.sent(1, "/you-1")
    live, over = GoalState(live=True, reached=False, reason=""), GoalState(live=False, reached=False, reason="replaced")
    goals.told(2, {"/me-1": over, "/you-1": live})
    assert goals.current is not None
    assert goals.current.client == "/you"
