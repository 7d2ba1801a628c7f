"""Who comes late hears the last word of every latched topic, while nothing new happens."""

from __future__ import annotations

import ast
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import roslib.message
import rospy
from std_srvs.srv import Trigger

from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

ROOM = Path(__file__).resolve().parents[2] / "src" / "vsx_ros" / "ros"
KINDS = {topic: kind for node in topics.PUBLISHED.values() for topic, kind in node.items()}
LATCHED = {
    topics.TF_STATIC, topics.SHUTTER, topics.ODOM_FACTORS, topics.HAZARDS, topics.BUTTONS, topics.MUX_ACTIVE,
    topics.OPERATOR_HOLD, topics.SLAM_STATE, topics.MAP, topics.MAP_METADATA, topics.MAP_POINTS, topics.KEYFRAMES,
    topics.SLAM_PATH, topics.KEYFRAME_PLACES,
    topics.GLOBAL_PLAN, topics.TRAJECTORY, topics.PLAN_MS, topics.FOLLOWER_STATUS,
    topics.FRONTIERS, topics.EXPLORE_STATUS, topics.COVERAGE, topics.ZONES, topics.ZONE_MARKERS, topics.ROOMS,
    topics.ROOM_MARKERS, topics.DOCKED, topics.DOCK_POSE, topics.DOCK_STATUS,
}  # fmt: skip
WITHOUT_A_WORD = {topics.DOCK_POSE}
"""There is no dock in the world of the live stack."""
NOT_ON_A_ROBOT = {"nodes/emulator.py", "emulated_truth.py", "player.py"}
"""They stand in for a robot's devices; of what they latch nothing is in the live stack of the tests."""


def latched() -> set[str]:
    """Topics whose publishers on a robot are latched, from the code that makes them."""
    found = set()
    for file in ROOM.rglob("*.py"):
        if str(file.relative_to(ROOM)) in NOT_ON_A_ROBOT:
            continue
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and any(option.arg == "latch" for option in call.keywords):
                found.add(str(getattr(topics, ast.unparse(call.args[0]).removeprefix("topics."))))
    return found


@pytest.fixture(scope="module")
def paused(stack: Stack) -> Iterator[Stack]:
    """A robot that has driven and stands now."""
    stack.wait_until_driving()
    rospy.wait_for_message(f"/{topics.FRONTIERS}", roslib.message.get_message_class(KINDS[topics.FRONTIERS]), 60.0)
    assert rospy.ServiceProxy(f"/{topics.EXPLORE_PAUSE}", Trigger)().success
    stack.wait(lambda: not stack.plant.moving, "the robot to stand", 30.0)
    time.sleep(0.5)
    yield stack
    assert rospy.ServiceProxy(f"/{topics.EXPLORE_RESUME}", Trigger)().success
    stack.wait_until_driving()


@pytest.mark.light
def test_the_table_is_complete() -> None:
    assert latched() == LATCHED


@pytest.mark.parametrize("topic", sorted(LATCHED - WITHOUT_A_WORD))
def test_who_comes_late_hears_the_last_word(paused: Stack, topic: str) -> None:
    message = rospy.wait_for_message(topic, roslib.message.get_message_class(KINDS[topic]), 20.0)
    assert message._connection_header["latching"] == "1", "its publisher forgets"
