"""In the live stack: a base that left its path gets another plan to the same goal, one without images waits on it."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from std_msgs.msg import String

from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

STOP_WITHIN_S = 0.5
TRIES = 4
"""The mission may choose another goal in the meantime, or the veering base touch a wall; then it is tried again."""


class Drive:
    """The follower's word on every trajectory, with the goal that move_base pursued then."""

    def __init__(self) -> None:
        self.told: list[tuple[str, int, str]] = []
        self._goal = ""
        self._subscribers = [
            rospy.Subscriber(f"{topics.MOVE_BASE_ACTION}/status", GoalStatusArray, self._on_goals),
            rospy.Subscriber(topics.FOLLOWER_STATUS, String, self._on_status),
        ]

    def _on_goals(self, msg: GoalStatusArray) -> None:
        active = [status.goal_id.id for status in msg.status_list if status.status == GoalStatus.ACTIVE]
        self._goal = active[-1] if active else ""

    def _on_status(self, msg: String) -> None:
        status = json.loads(msg.data)
        self.told.append((status["status"], status["trajectory"], self._goal))

    def since(self, begin: int, *words: str) -> tuple[str, int, str] | None:
        """The first word of these that was said after so many."""
        return next((said for said in self.told[begin:] if said[0] in words), None)

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()


@pytest.fixture
def drive(stack: Stack) -> Iterator[Drive]:
    watching = Drive()
    stack.wait_until_driving()
    stack.wait(lambda: watching.told and watching.told[-1][2], 20.0, "a goal that is pursued")
    yield watching
    watching.close()


def veer(stack: Stack, drive: Drive) -> tuple[str, int, str]:
    """Block a wheel of the driving base until the follower gives its trajectory up; what it said."""
    stack.wait_until_driving()
    before = len(drive.told)
    stack.plant.left_blocked = True
    try:
        stack.wait(lambda: drive.since(before, "diverged", "stopped", "arrived"), 20.0, "the end of the trajectory")
    finally:
        stack.plant.left_blocked = False
    stack.wait(lambda: not stack.plant.moving, STOP_WITHIN_S, "the wheels to stop")
    said = drive.since(before, "diverged", "stopped", "arrived")
    assert said is not None
    return said


def test_a_base_that_leaves_its_path_gets_another_plan_to_the_same_goal(stack: Stack, drive: Drive) -> None:
    for _ in range(TRIES):
        before = len(drive.told)
        word, given_up, goal = veer(stack, drive)
        stack.wait(
            lambda before=before, given_up=given_up: any(
                said[0] == "following" and said[1] > given_up for said in drive.told[before:]
            ),
            60.0,
            "another trajectory",
        )
        again = next(said for said in drive.told[before:] if said[0] == "following" and said[1] > given_up)
        if word == "diverged" and again[2] == goal != "":
            break
    else:
        pytest.fail(f"{TRIES} times the base left its path, and never was a plan made anew: {drive.told[-20:]}")
    stack.wait_until_driving()
    assert not stack.dead()


def test_a_base_without_images_for_a_moment_waits_on_its_path_and_drives_on(stack: Stack, drive: Drive) -> None:
    assert stack._camera is not None
    for _ in range(TRIES):
        stack.wait_until_driving()
        before = len(drive.told)
        stack._camera.send_signal(signal.SIGSTOP)
        silent_s = time.monotonic()
        try:
            stack.wait(lambda before=before: drive.since(before, "stale"), 2.0, "the follower to miss the camera")
            stack.wait(lambda: not stack.plant.moving, STOP_WITHIN_S, "the wheels to stop")
            assert stack.plant.stopped_s - silent_s < 2.0 * STOP_WITHIN_S
        finally:
            stack._camera.send_signal(signal.SIGCONT)
        waiting = drive.since(before, "stale")
        at = len(drive.told)
        stack.wait(lambda at=at: drive.since(at, "following", "diverged"), 60.0, "the way to go on")
        resumed = drive.since(at, "following", "stopped", "diverged")
        assert waiting is not None
        assert resumed is not None
        if resumed[:2] == ("following", waiting[1]):
            break
    else:
        pytest.fail(f"{TRIES} times the images were back at once, and never went the base on: {drive.told[-20:]}")
    stack.wait_until_driving()
