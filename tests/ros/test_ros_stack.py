"""The live stack: who talks to whom, and that the wheels stop whoever dies."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import numpy as np
import rosgraph
import rospy
from actionlib_msgs.msg import GoalID
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseWithCovarianceStamped, TransformStamped, Twist
from last_images import LastImages
from mission_listener import MissionListener
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import decode_report
from vsx_ros.ros import convert, topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

NODES = set(topics.PUBLISHED) - {"teleop", "emulator", "dashboard", "run_folder"}
STOP_WITHIN_S = 0.5
ATTEMPTS = 5
AT_ONCE = {  # what stops the wheels at once: silence of others, which a busy machine may keep waiting
    "no word from vslam, which may have no images", "no odometry that can be used", "move_base is silent",
}  # fmt: skip


def graph() -> tuple[dict[str, set[str]], dict[str, set[str]], dict[str, set[str]]]:
    """Topic -> publishers, topic -> subscribers, service -> providers, as the master has them."""
    published, subscribed, services = rosgraph.Master("/observer").getSystemState()
    by_name = [{name: set(nodes) for name, nodes in part} for part in (published, subscribed, services)]
    return by_name[0], by_name[1], by_name[2]


def absolute(name: str) -> str:
    return name if name.startswith("/") else f"/{name}"


def heard(topic: str, kind: Any, seconds: float = 30.0) -> Any:
    return rospy.wait_for_message(absolute(topic), kind, timeout=seconds)


def test_every_node_advertises_what_the_table_says(stack: Stack) -> None:
    wanted = {(absolute(t), f"/{node}") for node in NODES for t in topics.PUBLISHED[node]}
    offered = {(absolute(s), f"/{node}") for node in NODES for s in topics.SERVICES.get(node, {})}

    def complete() -> bool:
        published, _, services = graph()
        topics_there = all(node in published.get(topic, ()) for topic, node in wanted)
        return topics_there and all(node in services.get(service, ()) for service, node in offered)

    stack.wait(complete, "all topics and services of the table", 90.0)
    kinds = dict(rosgraph.Master("/observer").getTopicTypes())
    for node in NODES:
        for topic, kind in topics.PUBLISHED[node].items():
            assert kinds[absolute(topic)] == kind, topic


def test_nobody_listens_to_the_ground_truth(stack: Stack) -> None:
    stack.wait(lambda: len(graph()[1]) > 10, "subscribers", 60.0)
    _, subscribed, _ = graph()
    truth = absolute(topics.TRUTH_CAMERA).rpartition("/")[0]
    assert not [topic for topic in subscribed if topic.startswith(truth)]


def test_pictures_become_a_pose_a_map_and_a_tf_tree(stack: Stack) -> None:
    stack.wait_until_driving()
    transforms: list[TransformStamped] = []
    poses: list[PoseWithCovarianceStamped] = []
    subscribers = [
        rospy.Subscriber(topics.TF, TFMessage, lambda msg: transforms.extend(msg.transforms)),
        rospy.Subscriber(topics.POSE, PoseWithCovarianceStamped, poses.append),
    ]

    def stamps(child: str) -> list[rospy.Time]:
        return [t.header.stamp for t in transforms if t.child_frame_id == child]

    def within_the_tree() -> list[PoseWithCovarianceStamped]:
        if not (bases := stamps(topics.BASE_FRAME)):
            return []
        return [pose for pose in poses if min(bases) <= pose.header.stamp <= max(bases)]

    stack.wait(
        lambda: len(transforms) >= 60 and stamps(topics.ODOM_FRAME) and within_the_tree(), "poses and transforms"
    )
    for subscriber in subscribers:
        subscriber.unregister()
    pose = within_the_tree()[-1]
    assert pose.header.frame_id == topics.MAP_FRAME
    stack.wait(lambda: heard(topics.MAP_POINTS, PointCloud2).width > 100, "map points", 30.0)
    edges = {(t.header.frame_id, t.child_frame_id) for t in transforms}
    static = {(t.header.frame_id, t.child_frame_id) for t in heard(topics.TF_STATIC, TFMessage).transforms}
    assert edges == {(topics.MAP_FRAME, topics.ODOM_FRAME), (topics.ODOM_FRAME, topics.BASE_FRAME)}

    def transform(child: str) -> SE2:
        """At the time of the pose."""
        of_child = (t for t in transforms if t.child_frame_id == child)
        nearest = min(of_child, key=lambda t: abs(t.header.stamp - pose.header.stamp)).transform
        return convert.se2(Pose(Point(nearest.translation.x, nearest.translation.y, 0.0), nearest.rotation))

    T_map_base = convert.se2(pose.pose.pose)
    assert (transform(topics.ODOM_FRAME) @ transform(topics.BASE_FRAME)).distance_to(T_map_base) < 0.1
    assert (topics.BASE_FRAME, topics.BODY_FRAME) in static
    assert (topics.CAMERA_FRAME, topics.OPTICAL_FRAME) in static
    grid = convert.grid(heard(topics.MAP, OccupancyGrid))
    assert grid.value_at(T_map_base.x, T_map_base.y) == 0  # nothing is where the robot stands
    served = convert.grid(rospy.ServiceProxy(absolute(topics.STATIC_MAP), GetMap)().map)
    assert served.resolution == grid.resolution


def test_diagnostics_name_their_node(stack: Stack) -> None:
    seen: set[str] = set()

    def listen(msg: DiagnosticArray) -> None:
        seen.update(status.name.split(":")[0] for status in msg.status)

    subscriber = rospy.Subscriber(topics.DIAGNOSTICS, DiagnosticArray, listen)
    stack.wait(lambda: seen >= NODES, f"diagnostics of {NODES}")
    subscriber.unregister()


def test_a_cancelled_goal_is_braked_for_on_the_way(stack: Stack) -> None:
    speeds: list[float] = []
    ended: list[str] = []

    def note_end(msg: String) -> None:
        report = decode_report(msg.data)
        if report.status is FollowStatus.STOPPED or report.reason in AT_ONCE:
            ended.append(report.reason)

    subscribers = [
        rospy.Subscriber(topics.FOLLOWER_STATUS, String, note_end),
        rospy.Subscriber(topics.COMMAND_NAVI, Twist, lambda msg: speeds.append(abs(msg.linear.x))),
    ]
    mission = MissionListener()
    cancel = rospy.Publisher(f"{topics.MOVE_BASE_ACTION}/cancel", GoalID, queue_size=1)
    stack.wait(lambda: cancel.get_num_connections() > 0, "move_base to hear of cancelling", 20.0)
    for _ in range(ATTEMPTS):
        stack.wait_until_driving()
        stack.wait(lambda: len(speeds) > 5 and min(speeds[-5:]) > 0.15, "a fast drive", 90.0)
        ended.clear()
        del speeds[:-1]
        cancel.publish(GoalID())
        stack.wait(lambda: 0.0 in speeds and ended, "the stop", 20.0)
        paused = lambda: mission.status.get("state") == "paused" or ended[0] in AT_ONCE  # noqa: E731
        stack.wait(paused, "the exploration to pause", 20.0)
        time.sleep(1.0)  # a cancellation may come after a stop at once
        assert rospy.ServiceProxy(topics.EXPLORE_RESUME, Trigger)().success
        if ended[0] not in AT_ONCE:  # a message was late on a busy machine: that stop came before this one
            break
    mission.close()
    for subscriber in subscribers:
        subscriber.unregister()
    assert ended[0] == "stopped on the way"
    braking = speeds[: speeds.index(0.0)]
    assert len([v for v in braking if 0.02 < v < 0.14]) >= 2
    assert max(np.abs(np.diff(braking))) < 0.1


@pytest.mark.parametrize(
    ("name", "end"),
    [(name, signal.SIGKILL) for name in ("camera", "follower", "move_base", "explore", "vslam")]
    + [("explore", signal.SIGINT)],
)
def test_the_wheels_stop_when_a_node_ends(
    stack: Stack, name: str, end: signal.Signals, record_property: Callable[[str, object], None]
) -> None:
    images = LastImages(stack) if name == "camera" else None
    stack.wait_until_driving()
    last_s = time.monotonic()
    stack.kill(name, end)
    killed_ns = time.time_ns()
    stack.wait(lambda: not stack.plant.moving, f"the wheels to stop without {name}")
    time.sleep(2.0)
    assert not stack.plant.moving, f"{name} is dead and the robot drives on"
    within_s = STOP_WITHIN_S
    if images is not None:
        last_s, within_s = images.last_s(last_s, killed_ns), images.stop_within_s
    stopped_s = stack.plant.stopped_s
    assert stopped_s - last_s < within_s + stack.lateness.between(last_s, stopped_s)
    record_property("stopped_after_s", round(stopped_s - last_s, 3))
    stack.start(name)
