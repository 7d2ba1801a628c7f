"""Goals that failed: left alone for a while, tried again, given up."""

import numpy as np
from missions import LANDMARKS, SECOND, mapping_mission, situation

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, NavigationState, Outcome
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import near_poses
from vsx_ros.exploration.view_selector import GoalBlacklist
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, UNKNOWN, OccupancyGrid
from vsx_ros.slam.state import TrackingState


def test_a_failed_goal_is_not_chosen_again_at_once():
    mission = mapping_mission()
    first = mission.view_selector.ranking.views[0].pose
    failed = situation(navigation=NavigationState.ABORTED, navigation_reason="goal blocked")
    assert mission.decide(2 * SECOND, failed).reason == "coming to rest"
    decision = mission.decide(4 * SECOND, failed)
    assert decision.action is Action.GO
    assert decision.goal.distance_to(first) > 0.3 or abs(decision.goal.angle_to(first)) > 0.7
    assert any("goal blocked" in event.reason for event in mission.drain_events())


def test_what_failed_is_tried_again_when_nothing_else_is_left_but_not_for_ever():
    config = Config()
    only = SE2(1.0, 0.0, 0.0)

    def one_place(start, grid, clearance_m, poses):
        return np.where(near_poses(poses, only.as_array()[None], 0.15, 0.2), 1.0, np.inf)

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


def test_a_region_whose_views_all_fail_is_given_up_soon_and_is_not_explored():
    mission, chosen = mapping_mission(), 0
    for k in range(60):
        refused = situation(navigation=NavigationState.ABORTED, navigation_reason="a shut door")
        decision = mission.decide((2 + 2 * k) * SECOND, refused)
        chosen += decision.action is Action.GO
        if decision.action is Action.FINISH:
            break
    assert mission.outcome is Outcome.BOXED_IN
    assert "blacklisted" in decision.reason
    assert 4 <= chosen <= 10


def test_one_region_whose_views_fail_after_many_others_were_seen_ends_explored():
    mission = mapping_mission()
    mission.view_selector.looked_from += [SE2(-1.0, 0.02 * k, 3.0) for k in range(20)]
    for k in range(60):
        mission.decide((2 + 2 * k) * SECOND, situation(navigation=NavigationState.ABORTED))
    assert mission.outcome is Outcome.EXPLORED


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


def test_a_robot_that_only_gets_refusals_soon_chooses_elsewhere():
    """Each of the many views of a room is refused, say for its dark door: another room comes soon, not after all."""
    data = np.full((80, 400), UNKNOWN, np.int8)
    data[:, :60] = data[:, 340:] = FREE
    two_rooms = OccupancyGrid(data, 0.05, -1.5, -2.0)
    far = LANDMARKS + [13.0, 0.0, 0.0]
    mission, refused, now_ns = mapping_mission(), 0, 2 * SECOND
    both = situation(grid=two_rooms, landmarks_world=np.vstack([LANDMARKS, far]), navigation=NavigationState.ABORTED)
    while (decision := mission.decide(now_ns, both)).goal is None or decision.goal.x < 5.0:
        refused += decision.action is Action.GO
        now_ns += SECOND
        assert refused < 10
    near, room = np.array([[0.8, 0.5, 0.0]]), mission.view_selector.blacklist
    assert room.near(now_ns, near).all()
    room.choose_at(decision.goal)
    assert not room.near(now_ns + 60 * SECOND, near).any()


def test_a_view_near_refused_ones_is_tried_when_nothing_else_is_left():
    blacklist, near = GoalBlacklist(radius_m=0.4, first_s=10.0), np.array([[2.0, 1.0, 0.0]])
    blacklist.choose_at(SE2())
    for k in range(5):
        for _ in range(3):
            blacklist.add(0, SE2(0.5 * k, 0.0, 0.0))
    assert blacklist.near(SECOND, near).all()
    assert blacklist.release(SECOND) > 0
    assert not blacklist.near(SECOND, near).any()
    assert blacklist.near(SECOND, np.zeros((1, 3))).all(), "failed too often"
    assert blacklist.release(SECOND) == 0


def test_a_goal_that_fails_for_ever_is_left_alone_for_hours_at_most():
    blacklist = GoalBlacklist(radius_m=0.4, first_s=10.0)
    for _ in range(1100):
        seconds = blacklist.add(0, SE2(1.0, 0.0, 0.0))
    assert 600.0 < seconds < 36000.0
