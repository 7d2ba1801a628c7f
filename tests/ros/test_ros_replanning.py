"""In the live stack: a base that left its path, or whose way is no longer free, gets another plan to the same goal; one
without images waits on its path."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from last_images import LastImages
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.navigation.follower import decode_report
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.ros import convert, driving, topics

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
        report = decode_report(msg.data)
        self.told.append((report.status.value, report.trajectory, self._goal))

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
    stack.wait(lambda: watching.told and watching.told[-1][2], "a goal that is pursued", 20.0)
    yield watching
    watching.close()


def veer(stack: Stack, drive: Drive) -> tuple[str, int, str]:
    """Block a wheel of the driving base until the follower gives its trajectory up; what it said."""
    stack.wait_until_driving()
    before, blocked_s = len(drive.told), time.monotonic()
    stack.plant.left_blocked = True
    try:
        stack.wait(lambda: drive.since(before, "diverged", "stopped", "arrived"), "the end of the trajectory", 20.0)
    finally:
        stack.plant.left_blocked = False
    said_s = time.monotonic()
    stack.wait(lambda: not stack.plant.moving or stack.plant.stopped_s > blocked_s, "the wheels to stop")
    stopped_s = stack.plant.stopped_s
    assert stopped_s - said_s < STOP_WITHIN_S + stack.lateness.between(said_s, stopped_s)
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
            "another trajectory",
        )
        again = next(said for said in drive.told[before:] if said[0] == "following" and said[1] > given_up)
        if word == "diverged" and again[2] == goal != "":
            break
    else:
        pytest.fail(f"{TRIES} times the base left its path, and never was a plan made again: {drive.told[-20:]}")
    stack.wait_until_driving()
    assert not stack.dead()


def blocked_ahead(ways: list[MultiDOFJointTrajectory], grid: OccupancyGrid) -> OccupancyGrid | None:
    """The map with a post on the way, two seconds ahead of the base; None where it does not follow a way that long."""
    report = decode_report(rospy.wait_for_message(topics.FOLLOWER_STATUS, String, 5.0).data)
    way = next((msg for msg in reversed(ways) if msg.header.stamp.to_nsec() == report.trajectory), None)
    if way is None or way.header.frame_id != topics.MAP_FRAME or report.status is not FollowStatus.FOLLOWING:
        return None
    trajectory = driving.wanted(way)
    if isinstance(trajectory, float) or trajectory.duration_s < report.at_s + 4.0:
        return None
    post = trajectory.at(report.at_s + 2.0)[0]
    data = grid.data.copy()
    row, column = grid.cells([[post.x, post.y]])[0]
    data[row : row + 2, column : column + 2] = OCCUPIED
    return OccupancyGrid(data, grid.resolution, grid.origin_x, grid.origin_y)


@pytest.mark.usefixtures("drive")
def test_an_obstacle_that_comes_to_light_on_the_way_is_planned_around(stack: Stack) -> None:
    maps: list[OccupancyGridMsg] = []
    ways: list[MultiDOFJointTrajectory] = []
    listeners = [
        rospy.Subscriber(topics.MAP, OccupancyGridMsg, maps.append, queue_size=1),
        rospy.Subscriber(topics.TRAJECTORY, MultiDOFJointTrajectory, ways.append, queue_size=5),
    ]
    hand = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1)
    told = "planning again: an obstacle has come to light"
    try:
        stack.wait(lambda: maps and ways and hand.get_num_connections() >= 3, "a map, a way and their readers", 20.0)
        for _ in range(10 * TRIES):
            stack.wait_until_driving()
            blocked, before = blocked_ahead(ways, convert.grid(maps[-1])), stack.logs().count(told)
            if blocked is None:
                time.sleep(1.0)
                continue
            hand.publish(convert.grid_msg(blocked, topics.MAP_FRAME, time.time_ns()))
            time.sleep(1.5)
            if stack.logs().count(told) > before:
                break
        else:
            pytest.fail("the base never planned around what came to light on its way")
    finally:
        for listener in listeners:
            listener.unregister()
        hand.unregister()
    stack.wait_until_driving()


def test_a_base_without_images_for_a_moment_waits_on_its_path_and_drives_on(stack: Stack, drive: Drive) -> None:
    assert stack._camera is not None
    for _ in range(TRIES):
        images = LastImages(stack)
        stack.wait_until_driving()
        before, last_s = len(drive.told), time.monotonic()
        stack._camera.send_signal(signal.SIGSTOP)
        silent_ns = time.time_ns()
        try:
            stack.wait(lambda before=before: drive.since(before, "stale"), "the follower to miss the camera", 2.0)
            stack.wait(lambda: not stack.plant.moving, "the wheels to stop", images.stop_within_s)
            last_s, stopped_s = images.last_s(last_s, silent_ns), stack.plant.stopped_s
            assert stopped_s - last_s < images.stop_within_s + stack.lateness.between(last_s, stopped_s)
        finally:
            stack._camera.send_signal(signal.SIGCONT)
        waiting = drive.since(before, "stale")
        at = len(drive.told)
        stack.wait(lambda at=at: drive.since(at, "following", "diverged"), "the way to go on", 60.0)
        resumed = drive.since(at, "following", "stopped", "diverged")
        assert waiting is not None
        assert resumed is not None
        if resumed[:2] == ("following", waiting[1]):
            break
    else:
        pytest.fail(f"{TRIES} times the images were back at once, and never went the base on: {drive.told[-20:]}")
    stack.wait_until_driving()
