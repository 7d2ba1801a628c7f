"""What a mission remembers of an interrupted run: nothing that the interruption should not change is changed by it."""

import json
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Outcome, SavedMission, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.view_selector import GoalBlacklist
from vsx_ros.geometry.se2 import SE2
from vsx_ros.slam.state import TrackingState

SECOND = 1_000_000_000
PATH = Path("runs/lab/resume")
LOST = Situation(TrackingState.LOST, "dark", None, SE2(), None, NavigationState.IDLE, "", None, np.zeros((0, 3)))
SAVED = SavedMission(
    looked_from=[SE2(1.0, 2.0, 0.5)],
    blacklist=[(SE2(3.0, 0.0, 1.0), 480.0, 3), (SE2(4.0, 0.0, 1.0), 0.0, 1)],
    trail=[SE2(-0.2, 0.0, 0.0), SE2(-0.1, 0.0, 0.0)],
    going_home=True,
    home=SE2(0.1, 0.0, 0.0),
    paused=True,
    elapsed_s=61.5,
    driven_m=4.25,
)


def mission_of(saved: SavedMission) -> Mission:
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.zeros(len(poses)))
    mission.restore(SECOND, saved, SE2())
    return mission


def test_a_memory_is_read_back_from_a_file() -> None:
    assert SavedMission.of(json.loads(json.dumps(SAVED.tree())), PATH) == SAVED


def test_a_memory_of_an_older_version_is_read() -> None:
    tree = SAVED.tree()
    for name in ("paused", "elapsed_s", "driven_m"):
        del tree[name]
    tree["given_up"] = [row[:4] for row in tree.pop("blacklist")]
    once = [(pose, seconds, 1) for pose, seconds, _ in SAVED.blacklist]
    assert SavedMission.of(tree, PATH) == SAVED._replace(blacklist=once, paused=False, elapsed_s=0.0, driven_m=0.0)


@pytest.mark.parametrize(
    "blacklist", [[[1.0, 2.0]], [[1.0, 2.0, 0.0, "long", 1]], [7], [[1.0, float("nan"), 0.0, 9.0]]]
)
def test_a_damaged_memory_is_told(blacklist: list[object]) -> None:
    with pytest.raises(InputError, match="runs/lab/resume holds no memory of a mission .*; start a new run"):
        SavedMission.of({**SAVED.tree(), "blacklist": blacklist}, PATH)


@pytest.mark.parametrize("failed", [(-5.0, 1), (float("nan"), 1), (float("inf"), 1), (1e12, 1), (9.0, 0), (9.0, 10**7)])
def test_a_failed_goal_that_no_run_could_remember_is_told(failed: tuple[float, int]) -> None:
    with pytest.raises(InputError, match="runs/lab/resume holds no memory of a mission .*; start a new run"):
        SavedMission.of({**SAVED.tree(), "blacklist": [[1.0, 2.0, 0.0, *failed]]}, PATH)


@pytest.mark.parametrize("name", ["elapsed_s", "driven_m"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), 1e12, "long", None, [1.0]])
def test_a_time_or_way_of_no_run_is_told(name: str, value: object) -> None:
    with pytest.raises(InputError, match="runs/lab/resume holds no memory of a mission .*; start a new run"):
        SavedMission.of({**SAVED.tree(), name: value}, PATH)


def test_a_goal_that_failed_before_the_interruption_fails_once_more_and_not_for_the_first_time() -> None:
    goal, before, again = SE2(1.0, 0.0, 0.0), GoalBlacklist(0.4, 120.0), GoalBlacklist(0.4, 120.0)
    assert [before.add(0, goal) for _ in range(3)] == [120.0, 240.0, 480.0]
    again.restore(0, before.left(200 * SECOND))
    assert again.release(0) == 1, "the second time alone lasts still and is forgiven; a third failure never is"
    assert again.near(279 * SECOND, goal.as_array()[None]).all()
    assert again.add(900 * SECOND, goal) == 960.0


def test_a_paused_mission_stands_until_it_is_told_to_go_on() -> None:
    mission = mission_of(SAVED)
    assert {mission.decide(k * SECOND, LOST).action for k in range(2, 30)} == {Action.WAIT}
    assert mission.to_save(30 * SECOND, SE2(), 0).paused
    mission.resume(30 * SECOND)
    assert mission.decide(31 * SECOND, LOST).action is Action.GO


def test_a_pause_while_a_resumed_mission_waits_for_the_wheels_is_kept() -> None:
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.zeros(len(poses)))
    mission.pause(0)
    mission.restore(SECOND, SAVED._replace(paused=False), SE2())
    assert mission.state is MissionState.PAUSED
    assert mission_of(SAVED._replace(paused=False)).state is MissionState.RECOVERING


def test_a_robot_that_was_moved_does_not_back_along_the_way_it_came() -> None:
    stands, was_moved = (mission_of(saved._replace(paused=False)) for saved in (SAVED, SAVED.moved()))
    drives = [mission.decide(8 * SECOND, LOST) for mission in (stands, was_moved)]
    assert "back along the trail" in drives[0].reason
    assert "looking around" in drives[1].reason


def test_a_trail_is_not_told_relative_to_a_pose_of_another_odometry() -> None:
    """The base restarted its counting after the last decision."""
    mission = mission_of(SAVED)
    for k in range(5):
        mission.decide((2 + k) * SECOND, LOST._replace(T_odom_base=SE2(0.1 * k, 0.0, 0.0), odom_epoch=1))
    here = SE2(0.4, 0.0, 0.0)
    assert len(mission.to_save(8 * SECOND, here, 1).trail) == len(SAVED.trail) + 5
    restarted = mission.to_save(8 * SECOND, SE2(), 2)
    assert (restarted.trail, restarted.home) == ([], SAVED.home)


def test_a_mission_stopped_before_it_was_recalled_stays_ended() -> None:
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.zeros(len(poses)))
    mission.stop(0)
    mission.restore(SECOND, SAVED, SE2())
    assert mission.outcome is Outcome.STOPPED
    kept = mission.to_save(2 * SECOND, SE2(), 0)
    assert (kept.looked_from, kept.home, kept.trail) == (SAVED.looked_from, SAVED.home, SAVED.trail)
    assert mission.decide(9 * SECOND, LOST).action is Action.FINISH


def test_a_robot_sent_home_before_it_was_recalled_goes_home() -> None:
    mission = Mission(Config(), lambda start, grid, clearance_m, poses: np.zeros(len(poses)))
    mission.home(0)
    mission.restore(SECOND, SAVED._replace(going_home=False, paused=False), SE2())
    assert mission.to_save(2 * SECOND, SE2(), 0).going_home


def test_a_mission_that_has_ended_at_home_remembers_no_wish_to_go_there() -> None:
    mission = mission_of(SAVED._replace(going_home=True))
    assert mission.to_save(2 * SECOND, SE2(), 0).going_home
    mission.stop(3 * SECOND)
    assert not mission.to_save(4 * SECOND, SE2(), 0).going_home
