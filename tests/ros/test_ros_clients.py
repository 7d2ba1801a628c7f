"""What users of ROS bring along: rostopic, rosbag, and their own actionlib clients beside a running robot."""

from __future__ import annotations

import itertools
import re
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

import actionlib
import bag_numbers
import rospy
from actionlib_msgs.msg import GoalStatus
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetPlan
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from waiting import PATIENCE_S

from vsx_ros.config import LimitsConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.bag import open_recording
from vsx_ros.ros import convert, topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

AHEAD_M = 0.25


def tool(stack: Stack, *words: str, until: str = "") -> str:
    """What a command line tool says until it ends or has said three times what it shall; then it gets a Ctrl-C."""
    environment = {**stack.environment, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as started:
        assert started.stdout is not None
        watchdog = threading.Timer(PATIENCE_S, started.kill)
        watchdog.start()
        said = ""
        for line in started.stdout:
            said += line
            if until and until in line and said.count(until) >= 3:
                started.send_signal(signal.SIGINT)
        watchdog.cancel()
    return said


def pause(stack: Stack) -> None:
    """Let the robot stand, once it has a map."""
    heard(topics.POSE, PoseWithCovarianceStamped)
    stack.wait_until_driving()
    call(topics.EXPLORE_PAUSE)


def call(service: str) -> None:
    answer = rospy.ServiceProxy(f"/{service}", Trigger)()
    assert answer.success, answer.message


def heard(topic: str, kind: type) -> object:
    return rospy.wait_for_message(f"/{topic}", kind, timeout=PATIENCE_S)


def base_in(frame: str) -> SE2:
    if frame == topics.ODOM_FRAME:
        return convert.odometry(heard(topics.ODOM, Odometry)).T_odom_base
    return convert.se2(heard(topics.POSE, PoseWithCovarianceStamped).pose.pose)


def wait_until_standing(stack: Stack) -> None:
    since_s = [time.monotonic()]

    def stands() -> bool:
        if stack.plant.moving:
            since_s[0] = time.monotonic()
        return time.monotonic() - since_s[0] > 0.7

    stack.wait(stands, "the robot to stand", 30.0)


def test_rostopic_echoes_and_measures(stack: Stack) -> None:
    stack.wait_until_driving()
    said = tool(stack, "rostopic", "echo", "-n", "1", "/odom")
    assert f'child_frame_id: "{topics.BASE_FRAME}"' in said
    rates = re.findall(r"average rate: ([\d.]+)", tool(stack, "rostopic", "hz", "/odom", until="average rate"))
    assert rates
    assert 20.0 < float(rates[-1]) < 60.0
    assert "nav_msgs/OccupancyGrid" in tool(stack, "rostopic", "type", "/map")


def test_a_bag_by_rosbag_replays(stack: Stack, tmp_path: Path) -> None:
    stack.wait_until_driving()
    bag = tmp_path / "drive.bag"
    wanted = [f"/{name}" for name in (topics.IMAGE, topics.CAMERA_INFO, topics.ODOM)]
    said = tool(stack, "rosbag", "record", "--duration=3", "-O", str(bag), *wanted)
    assert bag.exists(), said
    recording = open_recording(bag)
    frames = list(recording.frames())
    assert len(frames) > 5
    assert recording.camera is not None
    assert recording.damage == ""
    assert recording.odometry_at(frames[len(frames) // 2].stamp_ns) is not None


def test_every_number_worth_plotting_is_a_series_in_a_bag_by_rosbag(stack: Stack, tmp_path: Path) -> None:
    heard(topics.POSE, PoseWithCovarianceStamped)
    stack.wait_until_driving()
    bag = tmp_path / "numbers.bag"
    said = tool(stack, "rosbag", "record", "--duration=6", "-O", str(bag), *bag_numbers.NUMBERS)
    assert bag.exists(), said
    bag_numbers.check(bag_numbers.numbers(bag))


def test_a_number_is_echoed_as_a_table(stack: Stack) -> None:
    stack.wait_until_driving()
    said = tool(stack, "rostopic", "echo", "-p", "-n", "5", f"/{topics.STATS}/latency_ms")
    head, *rows = said.split()
    assert head == "%time,field.data"
    times_ns, latencies_ms = zip(*((int(t), float(ms)) for t, ms in (row.split(",") for row in rows)), strict=True)
    assert len(rows) == 5
    assert list(times_ns) == sorted(set(times_ns))
    assert all(0.0 < latency_ms < 1e5 for latency_ms in latencies_ms)


@pytest.mark.parametrize("frame", [topics.MAP_FRAME, f"/{topics.MAP_FRAME}", topics.ODOM_FRAME, topics.BODY_FRAME])
def test_a_client_of_move_base_is_driven_to_its_goal(stack: Stack, frame: str) -> None:
    """The robot stands while exploration pauses; ahead is what it was about to drive over, perhaps in an arc. All goals
    are planned in the map."""
    pause(stack)
    try:
        wait_until_standing(stack)
        told = topics.ODOM_FRAME if frame == topics.ODOM_FRAME else topics.MAP_FRAME
        start = base_in(told)
        origin = SE2() if frame == topics.BODY_FRAME else start
        client = actionlib.SimpleActionClient(f"/{topics.MOVE_BASE_ACTION}", MoveBaseAction)
        assert client.wait_for_server(rospy.Duration(PATIENCE_S))
        fed: list[float] = []
        paths: list[PathMsg] = []
        listener = rospy.Subscriber(f"/{topics.GLOBAL_PLAN}", PathMsg, paths.append, queue_size=5)
        stack.wait(lambda: paths, "the explorer's last plan", 20.0)
        paths.clear()
        for way_m, turn_rad in itertools.product((AHEAD_M, -AHEAD_M), (0.0, 0.4, -0.4)):
            goal = SE2.exp(way_m, turn_rad)
            target = convert.pose_stamped(frame, time.time_ns(), origin @ goal)
            client.send_goal(MoveBaseGoal(target), feedback_cb=lambda f: fed.append(f.base_position.pose.position.x))
            assert client.wait_for_result(rospy.Duration(PATIENCE_S)), "no result"
            if client.get_state() == GoalStatus.SUCCEEDED:
                break
        assert client.get_state() == GoalStatus.SUCCEEDED, client.get_goal_status_text()
        assert fed
        assert {paths.pop().header.frame_id for _ in range(len(paths))} == {topics.MAP_FRAME}
        reached = start.inverse() @ base_in(told)
        assert reached.x == pytest.approx(goal.x, abs=0.1)
        assert reached.y == pytest.approx(goal.y, abs=0.1)
        listener.unregister()
        left = heard(topics.TRAJECTORY, MultiDOFJointTrajectory)
        assert left.points == [], "a follower that starts again would drive there once more"
    finally:
        call(topics.EXPLORE_RESUME)
    stack.wait_until_driving()


def test_an_arrow_drawn_in_rviz_is_a_goal(stack: Stack) -> None:
    pause(stack)
    try:
        wait_until_standing(stack)
        paths: list[PathMsg] = []
        listener = rospy.Subscriber(f"/{topics.GLOBAL_PLAN}", PathMsg, paths.append, queue_size=5)
        arrow = rospy.Publisher(f"/{topics.SIMPLE_GOAL}", PoseStamped, queue_size=1)
        stack.wait(lambda: arrow.get_num_connections() and paths, "move_base to listen", 20.0)
        before = len(paths)
        arrow.publish(
            convert.pose_stamped(topics.ODOM_FRAME, time.time_ns(), base_in(topics.ODOM_FRAME) @ SE2(-0.1, 0.0, 0.0))
        )
        stack.wait(lambda: len(paths) > before, "a plan to the arrow", 20.0)
        wait_until_standing(stack)
        listener.unregister()
    finally:
        call(topics.EXPLORE_RESUME)
    stack.wait_until_driving()


def test_a_client_of_dynamic_reconfigure_slows_it_down(stack: Stack) -> None:
    client = Client(f"/{topics.MOVE_BASE_ACTION}", timeout=PATIENCE_S)
    limits = LimitsConfig()
    assert client.update_configuration({"v_m_s": 9.0})["v_m_s"] == limits.v_m_s
    assert client.update_configuration({"v_m_s": 0.1})["v_m_s"] == 0.1
    try:
        begun_ns = time.time_ns()
        drives: list[MultiDOFJointTrajectory] = []

        def new_drive() -> bool:
            """Of ten seconds at least: a shorter one may end before it is at full speed."""
            drives.append(heard(topics.TRAJECTORY, MultiDOFJointTrajectory))
            points = drives[-1].points
            return (
                drives[-1].header.stamp.to_nsec() > begun_ns and points and points[-1].time_from_start.to_sec() > 10.0
            )

        stack.wait(new_drive, "the next drive", 90.0)
        fastest = max(abs(point.velocities[0].linear.x) for point in drives[-1].points)
        assert fastest == pytest.approx(0.1, abs=0.02)
    finally:
        client.update_configuration({"v_m_s": limits.v_m_s})
        client.close()


def test_make_plan_answers_in_the_map_without_driving(stack: Stack) -> None:
    """From a start by odometry to a goal in the map."""
    pause(stack)
    try:
        wait_until_standing(stack)
        start, here = convert.pose_stamped(topics.ODOM_FRAME, 0, base_in(topics.ODOM_FRAME)), base_in(topics.MAP_FRAME)
        rospy.wait_for_service(f"/{topics.MAKE_PLAN}", PATIENCE_S)
        make_plan = rospy.ServiceProxy(f"/{topics.MAKE_PLAN}", GetPlan)
        for way_m, turn_rad in itertools.product((AHEAD_M, -AHEAD_M), (0.0, 0.4, -0.4)):
            goal = here @ SE2.exp(way_m, turn_rad)
            plan = make_plan(start, convert.pose_stamped(topics.MAP_FRAME, 0, goal), 0.1).plan
            if plan.poses:
                break
        first, last = (plan.poses[k].pose.position for k in (0, -1))
        assert (first.x, first.y) == pytest.approx((here.x, here.y), abs=0.05)
        assert (last.x, last.y) == pytest.approx((goal.x, goal.y), abs=1e-6)
        assert plan.header.frame_id == topics.MAP_FRAME
    finally:
        call(topics.EXPLORE_RESUME)
    stack.wait_until_driving()


def test_make_plan_refuses_a_frame_that_it_does_not_know(stack: Stack) -> None:
    start = convert.pose_stamped(topics.OPTICAL_FRAME, 0, SE2())
    goal = convert.pose_stamped(topics.MAP_FRAME, 0, SE2(0.1, 0.0, 0.0))
    rospy.wait_for_service(f"/{topics.MAKE_PLAN}", PATIENCE_S)
    assert rospy.ServiceProxy(f"/{topics.MAKE_PLAN}", GetPlan)(start, goal, 0.1).plan.poses == []
    assert "make_plan: goals are in map, odom, base_footprint or base_link, not in frame" in stack.logs()


def test_make_plan_refuses_a_goal_without_a_heading(stack: Stack) -> None:
    start = convert.pose_stamped(topics.ODOM_FRAME, 0, SE2())
    rospy.wait_for_service(f"/{topics.MAKE_PLAN}", PATIENCE_S)
    assert rospy.ServiceProxy(f"/{topics.MAKE_PLAN}", GetPlan)(start, PoseStamped(), 0.1).plan.poses == []
    assert "make_plan: pose message holds" in stack.logs()
    assert "Error processing request" not in stack.logs()
