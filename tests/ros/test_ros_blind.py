"""A camera that falls silent, seen by the node explore, without a master."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_ros_operator_claim import Exploring, exploring

from vsx_ros.config import Config
from vsx_ros.control.localization import UNLOCALIZED
from vsx_ros.exploration.decision import Action, MissionState, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.user_goals import UserGoals
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.ros import headers
from vsx_ros.ros.situation import HeardSituation
from vsx_ros.slam.state import TrackingState

DECIDE_NS = 200_000_000


def closed_room() -> OccupancyGrid:
    """A room with one door, behind which the ground is unknown."""
    cells = np.full((160, 240), UNKNOWN, np.int8)
    cells[20:121, 20:141] = OCCUPIED
    cells[21:120, 21:140] = FREE
    cells[60:80, 140:150] = FREE
    return OccupancyGrid(cells, 0.05, -2.0, -2.0)


class InARoom(Exploring):
    """A robot in that room, whose camera was good until it fell silent."""

    blind_s = 0.0

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        here = SE2(1.0, 1.5, 0.0)
        return Situation(
            TrackingState.GOOD, "", here, here, closed_room(), navigation, navigation_reason, None,
            np.random.default_rng(0).uniform([-1.0, -1.0, 0.0], [5.0, 4.0, 1.0], (400, 3)),
            blind_s=self.blind_s,
        )  # fmt: skip


def euclid(start: SE2, grid: OccupancyGrid, clearance_m: float, poses: Any) -> Any:
    return np.hypot(poses[:, 0] - start.x, poses[:, 1] - start.y)


def test_fifteen_minutes_of_a_silent_vslam_blacklist_and_end_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns, acts = [10**18], list[Any]()
    monkeypatch.setattr(headers, "now_ns", lambda: now_ns[0])
    mission = Mission(Config(), euclid)
    node = exploring(InARoom(None), mission, lambda: (NavigationState.ABORTED, "vslam is silent"), acts)
    node._decide()
    assert acts.pop().action is Action.GO, "while there were images"
    node._heard.blind_s = 5.0
    for _ in range(15 * 60 * 5):
        now_ns[0] += DECIDE_NS
        node._decide()
    assert [decision for decision in acts if decision.action is Action.GO] == []
    assert mission.view_selector.blacklist.left(now_ns[0]) == []
    assert (mission.state, mission.outcome) == (MissionState.BLIND, None)


def test_what_is_heard_tells_for_how_long_the_camera_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 1)
    ages = dict[str, float]()
    heard: Any = HeardSituation.__new__(HeardSituation)
    heard.where, heard.grid = SimpleNamespace(at=lambda now_ns: UNLOCALIZED), None
    heard._hazards, heard._landmarks, heard._held = 0, np.zeros((0, 3)), None
    heard._user_goals, heard._keyframes = UserGoals("/explore-"), None
    heard._leases = SimpleNamespace(is_known=lambda name: name in ages, age_s=lambda name: ages.get(name, math.inf))
    assert (heard.has_seen, heard.at(1, NavigationState.IDLE, "").blind_s) == (False, 0.0)
    ages["vslam"] = 5.0
    assert (heard.has_seen, heard.at(1, NavigationState.IDLE, "").blind_s) == (True, 5.0)
