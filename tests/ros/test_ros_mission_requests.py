"""Pause, resume, stop and home while the mission chooses a view on a slow machine, without a master."""

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from waiting import PATIENCE_S, wait_for

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import Action, Decision, MissionState, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import headers, mission_requests, topics
from vsx_ros.ros.mission_requests import MissionRequests
from vsx_ros.ros.nodes.explore import ExploreNode
from vsx_ros.slam.state import TrackingState

ME, DOCK = "/page", "/dock"


class Heard(SimpleNamespace):
    """What the node hears."""

    @property
    def has_seen(self) -> bool:
        return bool(self.ready())


class Explorer:
    """The node with a robot that has no map yet. done: what move_base is told. While ``chosen`` is clear, a decision is
    not finished."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.services: dict[str, Callable[[str], str]] = {}
        monkeypatch.setattr(mission_requests, "offer_trigger_by", self.services.__setitem__)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(headers, "now_ns", lambda: self.now_s * 10**9)
        self.now_s, self.ready = 0, True
        self.navigation, self.done = NavigationState.IDLE, list[str]()
        self.chooses, self.chosen = threading.Event(), threading.Event()
        self.chosen.set()
        self.mission = Mission(Config(), Any)
        self._decide, self.mission.decide = self.mission.decide, self._slowly  # type: ignore[method-assign]
        self.node: Any = ExploreNode.__new__(ExploreNode)
        self.node._mission, self.node._lock = self.mission, threading.Lock()
        self.node._charges = self.node._battery_empty = False
        self.node._requests = MissionRequests(self.mission, self._cancel)
        self.node._lease = SimpleNamespace(promise=lambda seconds: None)
        self.node._diagnostics = SimpleNamespace(set=lambda *_: None)
        self.node._goals = SimpleNamespace(
            is_served=True,
            state=lambda: (self.navigation, ""),
            act=self._act,
            is_cancelled_since=self._is_cancelled_since,
        )
        self.node._heard = heard = Heard(at=self._situation, is_claimed_since=lambda situation: False, grid=None)
        heard.ready = lambda: self.ready
        self.node._writer = SimpleNamespace(restore=lambda *_: None)
        self.node._topics = SimpleNamespace(events=lambda events: None, report=lambda *_: False)

    def _situation(self, now_ns: int, navigation: NavigationState, reason: str) -> Situation:
        known: Any = dict.fromkeys(Situation._fields)
        known |= {"slam_state": TrackingState.NOT_INITIALISED, "slam_reason": "", "T_odom_base": SE2(), "odom_epoch": 0}
        known["blind_s"] = 0.0
        return Situation(**{**known, "navigation": navigation, "navigation_reason": reason})

    def _slowly(self, now_ns: int, situation: Situation) -> Decision:
        decision = self._decide(now_ns, situation)
        self.chooses.set()
        self.chosen.wait(PATIENCE_S)
        return decision

    def _act(self, now_ns: int, decision: Decision) -> None:
        if decision.action is not Action.WAIT:
            self.done.append(decision.action.value)
        if decision.action is Action.GO:
            self.navigation = NavigationState.ACTIVE

    def _is_cancelled_since(self, before: NavigationState) -> bool:
        return before is NavigationState.ACTIVE and self.navigation is NavigationState.CANCELLED

    def _cancel(self) -> None:
        self.done.append("stand")
        self.navigation = NavigationState.ABORTED if self.navigation is NavigationState.ACTIVE else self.navigation

    def decide(self) -> None:
        self.now_s += 1
        self.node._decide()

    def choose(self, *asked: Callable[[], object]) -> None:
        """A decision in the middle of which all this is asked and answered."""
        self.chosen.clear()
        self.chooses.clear()
        deciding = threading.Thread(target=self.decide, daemon=True)
        deciding.start()
        self.chooses.wait(PATIENCE_S)
        answers = [threading.Thread(target=question, daemon=True) for question in asked]
        for answer in answers:
            answer.start()
        try:
            wait_for(lambda: not any(answer.is_alive() for answer in answers), "the answers")
        finally:
            self.chosen.set()
            deciding.join()

    def ask(self, service: str, by: str = ME) -> str:
        return self.services[service](by)


@pytest.fixture
def explorer(monkeypatch: pytest.MonkeyPatch) -> Explorer:
    return Explorer(monkeypatch)


@pytest.mark.parametrize(
    ("service", "state", "end"),
    [(topics.EXPLORE_PAUSE, MissionState.PAUSED, []), (topics.EXPLORE_STOP, MissionState.DONE, ["finish"])],
)
def test_the_base_stands_from_the_answer_on_though_a_view_is_still_chosen(
    explorer: Explorer, service: str, state: MissionState, end: list[str]
) -> None:
    explorer.choose(lambda: explorer.ask(service))
    assert explorer.done == ["stand"], "and the goal that was chosen is not sent"
    explorer.decide()
    assert explorer.mission.state is state
    assert explorer.done == ["stand", *end]


def test_all_requests_are_answered_while_a_view_is_chosen_and_heard_afterwards(explorer: Explorer) -> None:
    battery = SimpleNamespace(voltage=11.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vsx_ros.ros.energy_messages.is_nearly_empty", lambda msg: True)
        explorer.choose(lambda: explorer.ask(topics.EXPLORE_HOME), lambda: explorer.node._on_battery(battery))
    assert explorer.done == ["go"], "which does not make it stand"
    explorer.decide()
    explorer.decide()
    told = [event.reason for event in explorer.mission.drain_events()]
    assert explorer.mission.to_save(1, SE2(), 0).going_home, told


def test_a_drive_that_a_short_pause_has_ended_is_nobodys_failure(explorer: Explorer) -> None:
    explorer.decide()
    assert explorer.done == ["go"]
    explorer.choose(lambda: [explorer.ask(name) for name in (topics.EXPLORE_PAUSE, topics.EXPLORE_RESUME)])
    for _ in range(4):
        explorer.decide()
    assert explorer.mission.state is MissionState.STARTING
    assert explorer.done.count("go") == 2
    assert explorer.mission._start_drives._given == 1, "the first drive is given again"


def test_a_drive_that_somebody_cancels_while_the_next_view_is_chosen_is_the_last_one(explorer: Explorer) -> None:
    explorer.decide()
    assert explorer.navigation is NavigationState.ACTIVE
    decide, joined = explorer._decide, Decision(Action.GO, SE2(1.0, 0.0, 0.0), "map", "", "")
    explorer._decide = lambda now_ns, situation: joined
    explorer.choose(lambda: setattr(explorer, "navigation", NavigationState.CANCELLED))
    explorer._decide = decide
    explorer.decide()
    explorer.decide()
    assert explorer.done == ["go"], "the view that was chosen meanwhile is not driven to"
    assert explorer.mission.state is MissionState.PAUSED


def test_an_answer_knows_what_was_asked_before(explorer: Explorer) -> None:
    stands = "the robot stands until the exploration is resumed"
    assert explorer.ask(topics.EXPLORE_PAUSE, DOCK) == stands
    assert explorer.ask(topics.EXPLORE_PAUSE) == f"{stands}; the dock has paused it, too"
    assert explorer.ask(topics.EXPLORE_RESUME) == "the exploration goes on; the dock has paused it, too"
    assert explorer.ask(topics.EXPLORE_RESUME, DOCK) == "the exploration goes on"
    explorer.ask(topics.EXPLORE_STOP)
    with pytest.raises(InputError, match="the exploration is over: stopped"):
        explorer.ask(topics.EXPLORE_HOME)
    for _ in range(5):
        explorer.decide()
    assert explorer.mission.state is MissionState.DONE
    with pytest.raises(InputError, match="the exploration is over: stopped"):
        explorer.ask(topics.EXPLORE_PAUSE)


def test_an_exploration_that_waits_for_the_camera_hears_requests(explorer: Explorer) -> None:
    explorer.ready = False
    explorer.ask(topics.EXPLORE_STOP)
    explorer.decide()
    assert explorer.done == ["stand", "finish"]
