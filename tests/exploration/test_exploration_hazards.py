"""What the mission does with a bumper, wheels that are stuck and a hazard that stays."""

import numpy as np
import pytest
from missions import SECOND, mapping_mission, situation, wheels_driven

from vsx_ros.exploration.decision import Action, NavigationState, Outcome
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import UNKNOWN, OccupancyGrid


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


@pytest.mark.parametrize("after", [NavigationState.ACTIVE, NavigationState.ABORTED])
def test_what_is_touched_at_a_view_that_was_reached_does_not_blame_it(after: NavigationState):
    """The step away is neither given up for another view nor a failure of the one that was reached."""
    mission = mapping_mission()
    goal = mission.view_selector.ranking.views[0].pose
    pose = wheels_driven(mission, 1.0, SE2())
    touched = situation(T_odom_base=pose, T_map_base=goal, hazard="bumper left pressed")
    step = mission.decide(4 * SECOND, touched._replace(navigation=NavigationState.SUCCEEDED))
    assert (step.action, step.frame) == (Action.GO, "odom")
    then = mission.decide(5 * SECOND, touched._replace(navigation=after, navigation_reason="cancelled"))
    assert then.action is Action.WAIT
    assert mission.view_selector.blacklist.left(5 * SECOND) == []


def test_what_is_touched_at_home_does_not_make_it_unreached():
    mission = mapping_mission()
    mission.home(2 * SECOND)
    assert mission.decide(3 * SECOND, situation()).reason == "driving home"
    touched = situation(navigation=NavigationState.SUCCEEDED, hazard="bumper left pressed")
    assert mission.decide(4 * SECOND, touched).action is Action.FINISH
    assert mission.outcome is Outcome.HOME
