"""The operator is heard by a robot that explores: emergency stop, teleop and goals of others, live."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import actionlib
import cv2
import numpy as np
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from mission_listener import MissionListener
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from waiting import PATIENCE_S

from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import FREE
from vsx_ros.robot import EMERGENCY_STOP
from vsx_ros.ros import convert, topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

HELD_S = 12.0  # longer than any goal takes to fail
TRIES = 3  # goals
GOAL_AHEAD_M, ROOM_M, ASIDE_RAD = (0.6, 0.9), 0.35, 1.0  # goals, free ground about all of the way, bearings tried


@pytest.fixture
def mission(stack: Stack) -> Any:
    rospy.wait_for_message(f"/{topics.POSE}", PoseWithCovarianceStamped, timeout=PATIENCE_S)
    stack.wait_until_driving()
    heard = MissionListener()
    stack.wait(lambda: heard.status and heard.held, "the explorer's status")
    yield heard
    heard.close()


def pose() -> SE2:
    return convert.se2(
        rospy.wait_for_message(f"/{topics.POSE}", PoseWithCovarianceStamped, timeout=PATIENCE_S).pose.pose
    )


def free_ahead() -> SE2 | None:
    """A place in the map in free known ground ahead, as is the way there; None if there is none."""
    here = pose()
    grid = convert.grid(rospy.wait_for_message(f"/{topics.MAP}", OccupancyGridMsg, timeout=PATIENCE_S))
    room_m = grid.resolution * cv2.distanceTransform((grid.data == FREE).astype(np.uint8), cv2.DIST_L2, 5)
    for ahead_m in GOAL_AHEAD_M[::-1]:
        for aside_rad in sorted(np.linspace(-ASIDE_RAD, ASIDE_RAD, 9), key=abs):
            goal = here @ SE2(0.0, 0.0, float(aside_rad)) @ SE2(ahead_m, 0.0, 0.0)
            cells = grid.cells(np.linspace([here.x, here.y], [goal.x, goal.y], 30))
            if grid.contains(cells).all() and room_m[cells[10:, 0], cells[10:, 1]].min() > ROOM_M:
                return goal
    return None


def some_way_ahead(stack: Stack, mission: MissionListener) -> SE2:
    """A goal that has to be driven to, while the robot explores."""
    found: list[SE2] = []

    def find() -> bool:
        goal = free_ahead()
        if goal is not None and mission.status["state"] == "mapping" and stack.plant.moving:
            found.append(goal)
        return bool(found)

    stack.wait(find, "free known ground ahead")
    return found[0]


def is_driven_to(stack: Stack, mission: MissionListener, send: Callable[[SE2], bool]) -> None:
    """send: whether the robot came to a goal. One that is refused, since the ground there has become known better
    meanwhile, is followed by another."""
    assert any(send(some_way_ahead(stack, mission)) for _ in range(TRIES)), [e["reason"] for e in mission.events]
    explores_on(stack, mission)


def explores_on(stack: Stack, mission: MissionListener) -> None:
    stack.wait(lambda: mission.status["state"] == "mapping", "the exploration to go on")
    stack.wait_until_driving()


def test_an_emergency_stop_holds_the_mission_and_blames_nobody(stack: Stack, mission: MissionListener) -> None:
    estop = rospy.ServiceProxy(f"/{topics.ESTOP}", SetBool)
    assert estop(True).success
    try:
        stack.wait(lambda: mission.status["state"] == "held", "the mission to be held")
        assert mission.held["by"] == EMERGENCY_STOP
        goals = sum("driving" in event["reason"] for event in mission.events)
        time.sleep(HELD_S)
        assert mission.status["state"] == "held"
        assert EMERGENCY_STOP in mission.status["reason"]
        assert sum("driving" in event["reason"] for event in mission.events) == goals, "goals while the wheels are held"
        assert [event["state"] for event in mission.events].count("held") == 1
    finally:
        assert estop(False).success
    stack.wait_until_driving()
    assert mission.blamed() == []


def test_teleop_holds_the_mission_and_it_goes_on_by_itself(stack: Stack, mission: MissionListener) -> None:
    keys = rospy.Publisher(f"/{topics.COMMAND_TELEOP}", Twist, queue_size=1)
    turning = Twist()
    turning.angular.z = 0.3
    until_s = time.monotonic() + HELD_S
    while time.monotonic() < until_s:
        keys.publish(turning)
        time.sleep(0.05)
    assert mission.status["state"] == "held"
    assert mission.held["by"] == "teleop"
    stack.wait(lambda: mission.status["state"] != "held", "the exploration to go on")
    stack.wait_until_driving()
    assert mission.blamed() == []


def test_a_goal_of_an_actionlib_client_is_driven_to_while_exploring(stack: Stack, mission: MissionListener) -> None:
    client = actionlib.SimpleActionClient(f"/{topics.MOVE_BASE_ACTION}", MoveBaseAction)
    assert client.wait_for_server(rospy.Duration(PATIENCE_S))

    poses: list[PoseWithCovarianceStamped] = []
    listener = rospy.Subscriber(f"/{topics.POSE}", PoseWithCovarianceStamped, poses.append)

    def send(goal: SE2) -> bool:
        ended: list[tuple[int, SE2]] = []  # with the pose at that time: the robot explores on
        client.send_goal(
            MoveBaseGoal(convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), goal)),
            done_cb=lambda status, _: ended.append((status, convert.se2(poses[-1].pose.pose))),
        )
        stack.wait(lambda: mission.status["state"] == "user goal", "the explorer to step back")
        stack.wait(lambda: ended, "the goal's end")
        [(status, there)] = ended
        assert status != GoalStatus.SUCCEEDED or there.distance_to(goal) < 0.25
        return bool(status == GoalStatus.SUCCEEDED)

    is_driven_to(stack, mission, send)
    listener.unregister()
    assert any("the goal of /observer is" in event["reason"] for event in mission.events)
    assert mission.blamed() == []


def test_an_arrow_of_rviz_is_driven_to_while_exploring(stack: Stack, mission: MissionListener) -> None:
    arrow = rospy.Publisher(f"/{topics.SIMPLE_GOAL}", PoseStamped, queue_size=1)
    stack.wait(arrow.get_num_connections, "move_base to listen")

    def send(goal: SE2) -> bool:
        said = len(mission.events)
        arrow.publish(convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), goal))
        stack.wait(lambda: mission.status["state"] == "user goal", "the explorer to step back")
        assert "/observer" in mission.status["reason"]
        ended = "the goal of /observer is "
        stack.wait(lambda: any(ended in event["reason"] for event in mission.events[said:]), "the goal's end")
        return any(f"{ended}reached" in event["reason"] for event in mission.events[said:])

    is_driven_to(stack, mission, send)


def test_vsx_go_waits_for_the_end(stack: Stack, mission: MissionListener) -> None:
    def send(goal: SE2) -> bool:
        place = f"{goal.x:.2f},{goal.y:.2f},{goal.theta * 57.3:.0f}"
        words = [sys.executable, "-m", "vsx_ros.cli.main", "go", place]
        done = subprocess.run(
            words, env=stack.environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
        assert done.stdout.startswith("reached") == (done.returncode == 0), done.stderr
        return done.returncode == 0

    is_driven_to(stack, mission, send)


@pytest.mark.parametrize("by", [topics.MOVE_BASE_CANCEL, topics.FOLLOWER_CANCEL])
def test_who_cancels_the_explorer_s_drive_makes_it_stand_and_blames_no_view(
    stack: Stack, mission: MissionListener, by: str
) -> None:
    everything = rospy.Publisher(f"/{topics.MOVE_BASE_CANCEL}", GoalID, queue_size=1)
    stack.wait(everything.get_num_connections, "move_base to listen")

    def paused() -> bool:
        """Cancel again where there was no drive between two goals."""
        if stack.plant.moving and by == topics.MOVE_BASE_CANCEL:
            everything.publish(GoalID())
        elif stack.plant.moving:
            assert rospy.ServiceProxy(f"/{by}", Trigger)().success
        time.sleep(0.5)
        return bool(mission.status["state"] == "paused")

    stack.wait(paused, "the exploration to pause")
    try:
        assert "somebody has cancelled the drive" in mission.status["reason"]
        time.sleep(2.0)
        assert not stack.plant.moving
        assert not [event["reason"] for event in mission.events if "blacklisted" in event["reason"]]
    finally:
        assert rospy.ServiceProxy(f"/{topics.EXPLORE_RESUME}", Trigger)().success
    explores_on(stack, mission)


def test_a_goal_of_a_client_ends_a_docking_and_is_driven_to(stack: Stack, mission: MissionListener) -> None:
    """There is no dock: it would look for one for a minute."""
    docking: list[dict[str, Any]] = []
    listener = rospy.Subscriber(f"/{topics.DOCK_STATUS}", String, lambda msg: docking.append(json.loads(msg.data)))
    client = actionlib.SimpleActionClient(f"/{topics.MOVE_BASE_ACTION}", MoveBaseAction)
    assert client.wait_for_server(rospy.Duration(PATIENCE_S))
    start = rospy.ServiceProxy(f"/{topics.DOCK_START}", AddDiagnostics)

    def send(goal: SE2) -> bool:
        seat = goal @ SE2(1.0, 0.0, 0.0)
        told = start(json.dumps({"at": [seat.x, seat.y, seat.theta]}))
        assert told.success, told.message
        stack.wait(lambda: mission.status["state"] == "paused", "the exploration to pause")
        docking.clear()
        client.send_goal(MoveBaseGoal(convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), goal)))
        stack.wait(lambda: docking and docking[-1]["state"] == "failed", "the docking to end")
        assert docking[-1]["reason"] == "/observer has sent a goal to move_base"
        assert client.wait_for_result(rospy.Duration(PATIENCE_S)), "no result"
        assert {told["state"] for told in docking[1:]} == {"failed"}
        return bool(client.get_state() == GoalStatus.SUCCEEDED)

    is_driven_to(stack, mission, send)
    listener.unregister()
    assert mission.blamed() == []
