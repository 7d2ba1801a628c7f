"""The next view is chosen while the base brakes for the last one."""

import numpy as np
from missions import SECOND, half_known, mapping_mission, situation

from vsx_ros.exploration.decision import Action, NavigationState
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OccupancyGrid

KNOWN = OccupancyGrid(np.full((80, 120), FREE, np.int8), 0.05, -1.5, -2.0)


def looks_from(mission: Mission, goal: SE2) -> int:
    """How often the goal itself counts as looked from."""
    return mission.view_selector.looked_from.count(goal)


def test_near_a_view_the_next_one_is_chosen_on_the_way_and_only_once() -> None:
    mission = mapping_mission()
    goal = mission.view_selector.ranking.views[0].pose
    driving = situation(navigation=NavigationState.ACTIVE)
    for before in (SE2(-0.4, 0.0, 0.0), SE2(-0.1, 0.0, 0.6), SE2(0.0, 0.3, 0.0)):
        far = driving._replace(T_map_base=goal @ before)
        assert mission.decide(2 * SECOND, far).action is Action.WAIT
        assert looks_from(mission, goal) == 0
    near = driving._replace(T_map_base=goal @ SE2(-0.15, 0.0, 0.2))
    decision = mission.decide(3 * SECOND, near)
    assert decision.action is Action.GO
    assert decision.goal.distance_to(goal) > 0.3 or abs(decision.goal.angle_to(goal)) > 0.3
    assert looks_from(mission, goal) == 1
    assert mission.decide(4 * SECOND, near).reason == f"on the way: {decision.reason}"
    mission.decide(5 * SECOND, situation(navigation=NavigationState.SUCCEEDED))
    assert (looks_from(mission, goal), looks_from(mission, decision.goal)) == (1, 1)


def test_a_next_view_that_fails_is_blamed_and_not_the_one_before() -> None:
    mission = mapping_mission()
    goal = mission.view_selector.ranking.views[0].pose
    decision = mission.decide(2 * SECOND, situation(navigation=NavigationState.ACTIVE, T_map_base=goal))
    failed = situation(navigation=NavigationState.ABORTED, navigation_reason="goal blocked")
    assert mission.decide(3 * SECOND, failed).reason == "coming to rest"
    assert [pose for pose, *_ in mission.view_selector.blacklist.left(3 * SECOND)] == [decision.goal]


def test_whether_no_view_is_left_is_judged_at_rest() -> None:
    mission = mapping_mission()
    goal = mission.view_selector.ranking.views[0].pose
    here = goal @ SE2(-0.1, 0.0, 0.0)
    near = situation(navigation=NavigationState.ACTIVE, T_map_base=here, grid=KNOWN)
    before = mission.view_selector.ranking
    assert mission.decide(2 * SECOND, near).action is Action.WAIT
    ranked = mission.view_selector.ranking
    assert ranked is not before
    assert not ranked.views
    assert mission.decide(3 * SECOND, near._replace(grid=half_known())).action is Action.WAIT
    assert mission.view_selector.ranking is ranked
    stands = near._replace(navigation=NavigationState.SUCCEEDED, grid=half_known())
    assert mission.decide(4 * SECOND, stands).action is Action.GO
    assert looks_from(mission, goal) == 1


def test_sent_home_it_chooses_no_view_at_home() -> None:
    mission = mapping_mission()
    mission.home(2 * SECOND)
    mission.decide(3 * SECOND, situation(navigation=NavigationState.SUCCEEDED))
    ranked = mission.view_selector.ranking
    assert mission.decide(4 * SECOND, situation(navigation=NavigationState.ACTIVE)).action is Action.WAIT
    assert mission.view_selector.ranking is ranked
