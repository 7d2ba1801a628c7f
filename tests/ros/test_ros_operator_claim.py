"""A goal of somebody else that comes while the explorer ranks views is not ended by the explorer's own, without a
master."""

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import actionlib

from vsx_ros.exploration.decision import Action, NavigationState, Situation
from vsx_ros.exploration.user_goals import UserGoals
from vsx_ros.robot import OperatorHold
from vsx_ros.ros import headers
from vsx_ros.ros.mission_output import GoalSender
from vsx_ros.ros.nodes.explore import ExploreNode
from vsx_ros.ros.situation import HeardSituation

CLAIMS = [lambda heard: heard._user_goals.sent(2, "/rviz-1", "map"), lambda heard: heard._on_hold(OperatorHold("a", 2))]


class Exploring(HeardSituation):
    """What is heard, without subscribers; ``ranking`` happens during the first decision."""

    def __init__(self, ranking: Any) -> None:
        self.grid = self.where = self._held = None
        self._user_goals, self._ranking = UserGoals("/explore-"), ranking

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        known: Any = dict.fromkeys(Situation._fields)
        return Situation(**{**known, "held": self._held, "user_goal": self._user_goals.current})

    def decide(self, now_ns: int, situation: Situation) -> Any:
        if situation.held is not None or situation.user_goal is not None:
            return SimpleNamespace(action=Action.WAIT, state="", reason="")
        self._ranking(self)
        return SimpleNamespace(action=Action.GO, state="", reason="")


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 1)


def sent(heard: Exploring) -> Any:
    """The action that the node carries out."""
    node: Any = ExploreNode.__new__(ExploreNode)
    acts: list[Action] = []
    node._heard, node._lock = heard, nullcontext()
    node._lease = SimpleNamespace(promise=lambda seconds: None)
    node._slam = SimpleNamespace(is_known=lambda name: True)
    node._goals = SimpleNamespace(
        is_served=True,
        state=lambda: (NavigationState.IDLE, ""),
        give_up=lambda identity: None,
        act=lambda now_ns, decision: acts.append(decision.action),
    )
    claim = SimpleNamespace(given_up="")
    node._mission = SimpleNamespace(decide=heard.decide, drain_events=list, outcome=None, claim=claim)
    node._writer = SimpleNamespace(restore=lambda *_: None)
    node._topics = SimpleNamespace(events=lambda events: None, report=lambda *_: False)
    node._decide()
    return acts


@pytest.mark.parametrize("claim", CLAIMS)
def test_what_comes_while_views_are_ranked_is_not_overruled(claim: Any) -> None:
    assert sent(Exploring(claim)) == [Action.WAIT]


def test_without_it_the_robot_drives() -> None:
    assert sent(Exploring(lambda heard: None)) == [Action.GO]


def test_a_goal_that_is_given_up_ends_for_move_base_too(monkeypatch: pytest.MonkeyPatch) -> None:
    cancelled: list[str] = []
    client = SimpleNamespace(pub_cancel=SimpleNamespace(publish=lambda goal: cancelled.append(goal.id)))
    monkeypatch.setattr(actionlib, "ActionClient", lambda *_: client)
    goals = GoalSender()
    for identity in ("", "/rviz-1", "/rviz-1", "/rviz-2"):
        goals.give_up(identity)
    assert cancelled == ["/rviz-1", "/rviz-2"]
