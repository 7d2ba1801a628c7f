"""Missing images are not blamed on views: the mission waits for them, and in the end names a device, not the map."""

import pytest
from missions import SECOND, euclid, mapping_mission, situation

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Outcome
from vsx_ros.exploration.mission import Mission
from vsx_ros.robot import OperatorHold, UserGoal
from vsx_ros.runs.process import HARDWARE
from vsx_ros.runs.report import EXIT_CODES
from vsx_ros.slam.state import TrackingState

SILENT = {"navigation": NavigationState.ABORTED, "navigation_reason": "vslam is silent"}


@pytest.mark.parametrize("state", [TrackingState.GOOD, TrackingState.DUBIOUS, TrackingState.LOST])
def test_half_a_minute_without_images_costs_no_goal_and_no_view(state):
    mission = mapping_mission()
    first = mission.decide(2 * SECOND, situation(slam_state=state, navigation=NavigationState.ACTIVE, blind_s=1.2))
    assert (first.action, mission.state) == (Action.CANCEL, MissionState.BLIND)
    assert "waiting for images" in first.reason
    for k in range(1, 30):
        blind = situation(slam_state=state, blind_s=1.2 + k, **SILENT)
        assert mission.decide((2 + k) * SECOND, blind).action is Action.WAIT
    assert mission.decide(32 * SECOND, situation(**SILENT)).action is Action.WAIT
    assert mission.state is MissionState.MAPPING
    assert mission.decide(34 * SECOND, situation(**SILENT)).action is Action.GO
    assert mission.view_selector.blacklist.left(34 * SECOND) == []


def test_what_failed_since_the_last_image_is_withdrawn():
    mission = mapping_mission()
    mission.decide(2 * SECOND, situation(blind_s=0.9, **SILENT))
    assert len(mission.view_selector.blacklist.left(2 * SECOND)) == 1
    mission.decide(3 * SECOND, situation(blind_s=1.9, **SILENT))
    assert mission.view_selector.blacklist.left(3 * SECOND) == []


def test_slow_images_are_images():
    mission = mapping_mission()
    under_way = mission.decide(2 * SECOND, situation(navigation=NavigationState.ACTIVE, blind_s=0.9))
    assert under_way.reason.startswith("on the way")


def test_a_minute_without_images_is_the_fault_of_a_device():
    mission = mapping_mission()
    for k in range(100):
        mission.decide((2 + k) * SECOND, situation(blind_s=0.1 + k, **SILENT))
    assert mission.outcome is Outcome.BLIND
    assert EXIT_CODES[Outcome.BLIND] == HARDWARE


def test_a_start_drive_without_images_is_no_attempt():
    mission = Mission(Config(), euclid)
    start = situation(slam_state=TrackingState.NOT_INITIALISED, grid=None)
    for k in range(30):
        now_ns = 10 * k * SECOND
        assert mission.decide(now_ns, start).action is Action.GO, k
        mission.decide(now_ns + 2 * SECOND, start._replace(blind_s=2.0, **SILENT))
        mission.decide(now_ns + 5 * SECOND, start._replace(**SILENT))
        assert mission.state is MissionState.STARTING


@pytest.mark.parametrize("claim", [{"held": OperatorHold("teleop", 2)}, {"user_goal": UserGoal("a-1", "a", 2)}])
def test_the_operator_comes_before_the_images(claim):
    mission = mapping_mission()
    mission.decide(2 * SECOND, situation(blind_s=100.0, **claim))
    assert mission.state is not MissionState.BLIND
    assert mission.outcome is None
