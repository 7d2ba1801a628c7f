"""A goal of somebody else that comes while the explorer ranks views is not ended by the explorer's own, without a
master."""

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.user_goals import UserGoals
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import OperatorHold
from vsx_ros.ros import headers
from vsx_ros.ros.nodes.explore import ExploreNode
from vsx_ros.ros.situation import HeardSituation
from vsx_ros.slam.state import TrackingState

CLAIMS = [lambda heard: heard._user_goals.sent(2, "/rviz-1"), lambda heard: heard._on_hold(OperatorHold("a", 2))]


class Exploring(HeardSituation):
    """What is heard, without subscribers; ``ranking`` happens during the first decision."""

    has_seen = True

    def __init__(self, ranking: Any) -> None:
        self.grid = self.where = self._held = None
        self._user_goals, self._ranking = UserGoals("/explore-"), ranking

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        known: Any = dict.fromkeys(Situation._fields)
        return Situation(**{**known, "blind_s": 0.0, "held": self._held, "user_goal": self._user_goals.current})

    def decide(self, now_ns: int, situation: Situation) -> Any:
        if situation.held is not None or situation.user_goal is not None:
            return SimpleNamespace(action=Action.WAIT, state="", reason="")
        self._ranking(self)
        return SimpleNamespace(action=Action.GO, state="", reason="")


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 1)


def exploring(heard: Any, mission: Any, state: Any, acts: list[Any]) -> Any:
    """The node, without a master. state: of its last goal, and why. acts: the decisions that it carries out."""
    node: Any = ExploreNode.__new__(ExploreNode)
    node._heard, node._lock = heard, nullcontext()
    node._lease = SimpleNamespace(promise=lambda seconds: None)
    act, never = (lambda now_ns, decision: acts.append(decision)), (lambda before: False)
    node._goals = SimpleNamespace(is_served=True, state=state, act=act, is_cancelled_since=never)
    node._mission = mission
    node._requests = SimpleNamespace(tell_next=lambda now_ns: None, unless_to_stand=lambda act: act())
    node._writer = SimpleNamespace(restore=lambda *_: None)
    node._topics = SimpleNamespace(events=lambda events: None, report=lambda *_: False)
    return node


def sent(heard: Exploring) -> list[Action]:
    """The actions that the node carries out."""
    acts = list[Any]()
    mission = SimpleNamespace(decide=heard.decide, drain_events=list, outcome=None)
    exploring(heard, mission, lambda: (NavigationState.IDLE, ""), acts)._decide()
    return [decision.action for decision in acts]


@pytest.mark.parametrize("claim", CLAIMS)
def test_what_comes_while_views_are_ranked_is_not_overruled(claim: Any) -> None:
    assert sent(Exploring(claim)) == [Action.WAIT]


def test_without_it_the_robot_drives() -> None:
    assert sent(Exploring(lambda heard: None)) == [Action.GO]


class Starting(Exploring):
    """A robot without a map, at the origin."""

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        here = super().at(now_ns, navigation, navigation_reason)
        blind = here._replace(slam_state=TrackingState.NOT_INITIALISED, slam_reason="", T_odom_base=SE2(), odom_epoch=0)
        return blind._replace(navigation=navigation, navigation_reason=navigation_reason, user_goal_end="there")


@pytest.mark.parametrize("claim", CLAIMS)
def test_a_start_drive_that_was_not_sent_is_driven_afterwards(claim: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    heard, mission, acts, now_s = Starting(None), Mission(Config(), Any), list[Any](), [0]
    monkeypatch.setattr(headers, "now_ns", lambda: now_s[0] * 10**9)
    before = [NavigationState.IDLE]
    node = exploring(heard, mission, lambda: (before[0], ""), acts)
    decide, claims = mission.decide, list[Any]()

    def decided(now_ns: int, situation: Situation) -> Any:
        decision = decide(now_ns, situation)
        if claims:
            claims.pop()(heard)
        return decision

    mission.decide = decided  # type: ignore[method-assign]
    node._decide()
    before[0], now_s[0] = NavigationState.SUCCEEDED, 3
    claims.append(claim)
    node._decide()
    heard._held, heard._user_goals = None, UserGoals("/explore-")
    for now_s[0] in range(20, 24):
        node._decide()
    ahead, waits, *later = [decision.goal for decision in acts]
    back = next(goal for goal in later if goal is not None)
    assert waits is None
    assert (back.x, back.theta) == (-ahead.x, 0.0), "back, and not yet the quarter turn"
