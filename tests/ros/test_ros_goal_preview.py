"""Goals that are planned for nobody to drive: what a text must say, and what is answered; without a master."""

import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
from diagnostic_msgs.srv import AddDiagnosticsRequest

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.ros import goal_preview
from vsx_ros.ros.goal_preview import GoalPreview, asked_goal

HERE = SE2(1.0, 1.0, 0.0)


def hall() -> OccupancyGrid:
    cells = np.full((80, 120), FREE, np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.05, 0.0, 0.0)


class Asked:
    """The service, over a planner with a hall of 6 m x 4 m."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, here: SE2 | None = HERE) -> None:
        offered: list[Any] = []
        monkeypatch.setattr(rospy, "Service", lambda name, kind, answer: offered.append(answer))
        monkeypatch.setattr(goal_preview.headers, "now_ns", lambda: 0)
        planner = GoalPlanner(Config(), "fov", 0)
        planner.take_grid(hall(), 0)
        way = SimpleNamespace(way=lambda start, goal: planner.timed(start, goal, "map"))
        where = SimpleNamespace(at=lambda _: SimpleNamespace(pose=lambda frame: here if frame == "map" else None))
        GoalPreview(way, where)  # type: ignore[arg-type]  # stand-ins
        (self._service,) = offered

    def answer(self, text: str) -> Any:
        return self._service(AddDiagnosticsRequest(load_namespace=text))


def test_a_goal_without_a_heading_looks_the_way_the_robot_comes() -> None:
    assert asked_goal('{"x": 1, "y": 3}', HERE) == SE2(1.0, 3.0, math.pi / 2)
    assert asked_goal('{"x": 1, "y": 3, "heading_rad": -1}', HERE).theta == -1.0


@pytest.mark.parametrize(
    "text",
    [
        "", "null", "[1, 2]", '{"x": 1}', '{"x": "1", "y": 2}', '{"x": true, "y": 2}', '{"x": NaN, "y": 2}',
        '{"x": 1e9, "y": 2}', '{"x": -Infinity, "y": 2}', '{"x": 1, "y": 2, "heading_rad": NaN}',
        '{"x": 1, "y": 2, "heading_rad": "north"}', "[" * 5000,
    ],
)  # fmt: skip
def test_a_text_that_is_no_goal_is_refused_in_one_sentence(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError) as refused:
        asked_goal(text, HERE)
    answer = Asked(monkeypatch).answer(text)
    assert (answer.success, answer.message) == (False, str(refused.value))
    assert "\n" not in answer.message


def test_the_way_is_told_with_its_length_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = Asked(monkeypatch).answer('{"x": 4, "y": 3}')
    assert answer.success, answer.message
    way = json.loads(answer.message)
    assert way["goal"] == pytest.approx([4.0, 3.0, math.atan2(2.0, 3.0)])
    assert way["points"][0] == pytest.approx([1.0, 1.0], abs=1e-3)
    assert way["points"][-1] == pytest.approx([4.0, 3.0], abs=1e-3)
    least_m = math.hypot(3.0, 2.0)
    assert least_m <= way["length_m"] <= 1.6 * least_m
    assert 2 <= len(way["points"]) <= 402
    assert way["seconds"] >= way["length_m"] / Config().limits.v_m_s


@pytest.mark.parametrize(
    ("text", "why"), [('{"x": 40, "y": 3}', "outside the map"), ('{"x": 0, "y": 2}', "0.00, 2.00")]
)
def test_where_there_is_no_way_the_reason_is_told(text: str, why: str, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = Asked(monkeypatch).answer(text)
    assert not answer.success
    assert why in answer.message


def test_a_robot_that_does_not_know_where_it_is_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = Asked(monkeypatch, here=None).answer('{"x": 4, "y": 3}')
    assert not answer.success
    assert "where it is" in answer.message
