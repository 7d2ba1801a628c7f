"""The drives of the paper's comparison: what they are asked, and how trackers are judged by them."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.experiments.drive import ARMS, DriveTask, _drive, limits_of, plan_of, question
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS, Tracked, _u2_readings
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.planning.path import Plan, Refusal, RefusalKind
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.runs.world import open_world
from vsx_ros.slam.state import TrackingResult, TrackingState

CONSTRAINED, FAST, SLOW, LITERAL = ARMS


@pytest.mark.parametrize(("dataset", "low_deg", "high_deg"), [(1, 60, 110), (2, 150, 180)])
def test_goals_look_elsewhere_and_every_planner_gets_there(dataset, low_deg, high_deg):
    task = DriveTask("lab", 2, 0, dataset)
    asked = question(task, open_world("lab", 2), Config())
    assert low_deg <= math.degrees(abs(asked.start.angle_to(asked.goal))) <= high_deg
    assert 1.5 <= asked.start.distance_to(asked.goal) <= 3.5
    constrained, unconstrained, slow, literal = (plan_of(arm, asked, Config()) for arm in ARMS)
    assert isinstance(constrained, Plan)
    assert isinstance(unconstrained, Plan)
    assert constrained.path.turn_on_spot_rad == 0.0
    assert isinstance(literal, Refusal) or (literal.planner, literal.path.turn_on_spot_rad) == ("paper", 0.0)
    assert unconstrained.path.turn_on_spot_rad > 0.1
    np.testing.assert_array_equal(unconstrained.path.sample(0.1), slow.path.sample(0.1))
    assert question(task, open_world("lab", 2), Config()).goal == asked.goal


def test_only_turns_differ_between_the_unconstrained_arms():
    fast, slow = (limits_of(arm, Config()) for arm in (FAST, SLOW))
    assert (fast.v_m_s, fast.a_m_s2) == (slow.v_m_s, slow.a_m_s2)
    assert math.degrees(fast.omega_rad_s) == pytest.approx(52, abs=1)
    assert math.degrees(slow.omega_rad_s) == pytest.approx(17, abs=1)
    assert limits_of(CONSTRAINED, Config()) == limits_of(LITERAL, Config()) == Config().limits


def test_a_drive_arrives_and_both_trackers_are_judged_by_it():
    task, world = DriveTask("lab", 1, 0, 1), open_world("lab", 1)
    asked = question(task, world, Config())
    drive = _drive(CONSTRAINED, asked, task, world, Config())
    assert drive["ended"] == "arrived"
    assert drive["collisions"] == 0
    assert math.dist(drive["driven"][-1][:2], (asked.goal.x, asked.goal.y)) < 0.15
    assert math.dist(drive["planned"][0][:2], (asked.start.x, asked.start.y)) < 1e-3
    for judged in (drive["trackers"][PAPER], drive["trackers"][FULL]):
        assert 0.5 < judged["u1"] <= 1.0
        assert judged["u2_searched"] > judged["u2_frames"] > judged["u2_made"] > judged["u2_drive"] > 10
        assert judged["u2_until_loss"] == judged["u2_made"]  # it was never lost
        assert not judged["broken"]
        assert judged["ate_m"] < 0.05
        end = judged["estimate"][-1]
        assert end is not None
        assert math.dist(end, drive["driven"][-1][:2]) < 0.25  # the camera sits 9 cm behind
    json.dumps(drive)


def test_u2_by_each_reading_of_its_sentence():
    """Three points, the last one made in the drive; the first two are found no more after the loss."""
    start, loss, end = (
        {"found": np.array(found), "searched": np.array(searched)}
        for found, searched in (([2, 0], [2, 3]), ([5, 0, 1], [6, 5, 2]), ([5, 0, 4], [8, 7, 4]))
    )
    assert _u2_readings((start, end), (start, loss)) == {
        "u2_frames": 4.5, "u2_made": 3.0, "u2_searched": 6.0, "u2_made_searched": pytest.approx(19 / 3),
        "u2_drive": pytest.approx(7 / 3), "u2_until_loss": 2.0, "u2_drive_until_loss": pytest.approx(4 / 3),
    }  # fmt: skip
    nothing = {"found": np.zeros(0), "searched": np.zeros(0)}
    assert _u2_readings((nothing, nothing), (nothing, nothing)) == dict.fromkeys(U2_READINGS)


def test_points_of_a_map_that_was_given_up_are_not_taken_from_those_of_the_next():
    """Two points before the drive; a loss, then another map of three points, or of one at the very end."""
    counts = [[5, 5], [6, 5, 1], [], [1, 1, 2]]
    states = [TrackingState.GOOD, TrackingState.LOST, TrackingState.NOT_INITIALISED, TrackingState.GOOD]
    for last in (counts[-1], [4]):
        slam = Told(states)
        slam.record = lambda last=last, slam=slam: {
            name: np.array([*counts[:-1], last][max(0, slam._seen - 1)]) for name in ("found", "searched")
        }
        tracked = Tracked(PAPER, slam, metric=False)
        tracked.track(0, None)
        tracked.begin()
        for k in (1, 2, 3):
            tracked.track(k, None)
        judged = tracked.judged([straight(k) for k in range(4)], [straight(k).T for k in range(4)])
        assert judged["u2_drive"] == judged["u2_made"] == np.mean(last)
        assert judged["u2_drive_until_loss"] == pytest.approx(2 / 3)
    ended = {name: np.array([3]) for name in ("found", "searched")}  # the last frame of all gave the map up
    before = {name: np.array([5, 5]) for name in ("found", "searched")}
    assert _u2_readings((before, ended), (before, ended))["u2_drive"] == 3.0


class Told:
    """A SLAM that returns the given states, with poses on a straight line."""

    def __init__(self, states: list[TrackingState]) -> None:
        self._states, self._seen = states, 0

    def track(self, k: int, odometry: None) -> TrackingResult:
        self._seen, state = k + 1, self._states[k]
        return TrackingResult(k, state, straight(k).T if state.tracked else None, searched=10, found=8)

    def record(self) -> dict:
        return {"found": np.array([self._seen]), "searched": np.array([self._seen])}

    def statistics(self) -> SimpleNamespace:
        return SimpleNamespace(initialized_at_s=None, u2_seconds=None)


def straight(k: int) -> StampedPose:
    return StampedPose(k, SE3(np.eye(3), np.array([0.01 * k, 0.0, 0.0])))


@pytest.mark.parametrize(
    ("first", "last", "held", "losses", "broken"),
    [
        (TrackingState.NOT_INITIALISED, TrackingState.NOT_INITIALISED, 0.0, 1, True),
        (TrackingState.NOT_INITIALISED, TrackingState.GOOD, 0.0, 1, False),
        (TrackingState.GOOD, TrackingState.NOT_INITIALISED, 0.5, 1, True),
        (TrackingState.GOOD, TrackingState.LOST, 0.5, 1, True),
        (TrackingState.GOOD, TrackingState.GOOD, 1.0, 0, False),
    ],
)
def test_what_has_no_map_holds_nothing(first, last, held, losses, broken):
    """The drive begins after ten frames, and half of its forty have the second state."""
    states = [TrackingState.NOT_INITIALISED] * 10 + [first] * 20 + [last] * 20
    tracker = Tracked(FULL, Told(states), metric=True)
    for k in range(50):
        tracker.begin() if k == 10 else None
        tracker.track(k, None)
    judged = tracker.judged([straight(k) for k in range(50)], [straight(k).T for k in range(50)])
    assert (judged["held_share"], judged["losses"], judged["broken"]) == (held, losses, broken)
    assert judged["u2_until_loss"] == 10 + (1 + 40 * held if held < 1.0 else 40)


def test_a_planner_without_a_path_is_told_and_does_not_drive(monkeypatch):
    class Nowhere:
        def __init__(self, config, robot):
            pass

        def plan(self, *question):
            return Refusal(RefusalKind.BUDGET, "not found")

    monkeypatch.setitem(PLANNERS, "paper", Nowhere)
    task, world = DriveTask("lab", 1, 0, 1), open_world("lab", 1)
    assert _drive(LITERAL, question(task, world, Config()), task, world, Config()) == {"refused": "not found"}
