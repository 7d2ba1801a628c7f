"""The operator is heard by a robot that explores: emergency stop, teleop and goals of others, live."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from mission_listener import MissionListener
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_srvs.srv import SetBool
from waiting import PATIENCE_S

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import EMERGENCY_STOP
from vsx_ros.ros import convert, topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

HELD_S = 12.0  # longer than any goal takes to fail


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
    goal = convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), pose())
    client.send_goal(MoveBaseGoal(goal))
    stack.wait(lambda: mission.status["state"] == "user goal", "the explorer to step back")
    assert client.wait_for_result(rospy.Duration(PATIENCE_S))
    assert "cancelled" not in client.get_goal_status_text()
    assert client.get_state() in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED)
    stack.wait_until_driving()
    assert any("the goal of /observer is" in event["reason"] for event in mission.events)
    assert mission.blamed() == []


def test_an_arrow_of_rviz_is_driven_to_while_exploring(stack: Stack, mission: MissionListener) -> None:
    arrow = rospy.Publisher(f"/{topics.SIMPLE_GOAL}", PoseStamped, queue_size=1)
    stack.wait(arrow.get_num_connections, "move_base to listen")
    arrow.publish(convert.pose_stamped(topics.MAP_FRAME, time.time_ns(), pose()))
    stack.wait(lambda: mission.status["state"] == "user goal", "the explorer to step back")
    assert "/observer" in mission.status["reason"]
    stack.wait(lambda: mission.status["state"] != "user goal", "the end of the goal")
    stack.wait_until_driving()


def test_vsx_go_waits_for_the_end(stack: Stack, mission: MissionListener) -> None:
    here = pose()
    words = [sys.executable, "-m", "vsx_ros.cli.main", "go", f"{here.x:.2f},{here.y:.2f},{here.theta * 57.3:.0f}"]
    done = subprocess.run(words, env=stack.environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert "reached" in done.stdout + done.stderr
    assert (done.returncode == 0) == done.stdout.startswith("reached")
    stack.wait_until_driving()
