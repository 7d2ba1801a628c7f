"""What other packages of ROS, robot_localization first, expect: one tf tree for all frames, covariances that mean
something, and a say in who owns an edge of the tree."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import genpy
import roslib.message
import rospy
from lone_base import LoneBase
from std_msgs.msg import Header

from vsx_hw.readings import Hazard
from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

HEARD = {topics.TF, topics.TF_STATIC, topics.ODOM, topics.IMU, topics.BUMPER_CLOUD, topics.IMAGE, topics.CAMERA_INFO,
         topics.POSE, topics.MAP, topics.MAP_POINTS, topics.KEYFRAMES, topics.SLAM_PATH, topics.SCAN,
         topics.GLOBAL_PLAN, topics.TRAJECTORY, topics.FRONTIERS}  # fmt: skip
"""Whatever has a frame and comes without being asked for."""
NODES = set(topics.PUBLISHED) - {"teleop", "emulator", "dashboard", "run_folder"}
HUGE = 1e6

TF_OBSERVER = """
import json, sys
import rospy
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

rospy.init_node("observer", disable_signals=True)
moving, static, odometry = set(), set(), []
def remember(msg, edges):
    edges.update((t.header.frame_id, t.child_frame_id) for t in msg.transforms)
rospy.Subscriber("/tf", TFMessage, remember, moving, queue_size=100)
rospy.Subscriber("/tf_static", TFMessage, remember, static, queue_size=5)
rospy.Subscriber("odom", Odometry, odometry.append, queue_size=50)
def wait(condition, what):
    deadline = rospy.get_time() + 400.0
    while not condition():
        if rospy.get_time() > deadline:
            sys.exit(f"waited for {what}: {moving} {static} {len(odometry)}")
        rospy.sleep(0.05)
wait(lambda: static and odometry, "vslam and the base")
odometry.clear()
wait(lambda: len(odometry) > 100 and len(moving) >= int(sys.argv[1]), "odometry and the edges of tf")
print(json.dumps([sorted(moving), sorted(static)]))
"""

OTHER_DRIVER = """
import rospy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

rospy.init_node("robot", disable_signals=True)
odom_pub, tf_pub = (rospy.Publisher(*topic, queue_size=5) for topic in (("/odom", Odometry), ("/tf", TFMessage)))
while not rospy.is_shutdown():
    odometry, edge = Odometry(child_frame_id="base_footprint"), TransformStamped(child_frame_id="base_footprint")
    odometry.header.stamp, odometry.header.frame_id = rospy.Time.now(), "odom"
    edge.header = odometry.header
    odometry.pose.pose.orientation.w = edge.transform.rotation.w = 1.0
    odom_pub.publish(odometry)
    tf_pub.publish([edge])
    rospy.sleep(0.05)
"""


def parts(message: Any) -> Iterator[genpy.Message]:
    """The message and all messages within it."""
    if isinstance(message, genpy.Message):
        yield message
        for name in message.__slots__:
            yield from parts(getattr(message, name))
    elif isinstance(message, list) and message and isinstance(message[0], genpy.Message):
        for each in message:
            yield from parts(each)


def frames_of(message: genpy.Message) -> set[str]:
    named = {part.frame_id for part in parts(message) if isinstance(part, Header)}
    children = {part.child_frame_id for part in parts(message) if "child_frame_id" in part.__slots__}
    return (named | children) - {""}


def covariances_of(message: genpy.Message) -> dict[str, list[float]]:
    """Diagonals by the name of the entry; one that begins with -1 says that there is no such measurement (REP 145)."""
    found = {
        f"{type(part).__name__}.{name}": list(getattr(part, name))
        for part in parts(message)
        for name in part.__slots__
        if name.endswith("covariance") and not isinstance(getattr(part, name), genpy.Message)
    }
    return {name: flat[:: 4 if len(flat) == 9 else 7] for name, flat in found.items() if flat[0] != -1.0}


class Ears:
    """Hears everything that the stack says, until it is closed; the last message of each topic, and all edges of tf."""

    def __init__(self) -> None:
        self.last: dict[str, genpy.Message] = {}
        self.edges: set[tuple[str, str]] = set()
        kinds = {topic: kind for node in NODES for topic, kind in topics.PUBLISHED[node].items()}
        self._subscribers = [
            rospy.Subscriber(topic, roslib.message.get_message_class(kind), self._hear, topic, buff_size=2**24)
            for topic, kind in kinds.items()
        ]

    def _hear(self, message: genpy.Message, topic: str) -> None:
        self.last[topic] = message
        if topic in (topics.TF, topics.TF_STATIC):
            self.edges.update((t.header.frame_id, t.child_frame_id) for t in message.transforms)

    @property
    def with_frames(self) -> set[str]:
        return {topic for topic, message in dict(self.last).items() if frames_of(message)}

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()


@pytest.fixture
def ears(stack: Stack, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ears]:
    """They have heard every topic of ``HEARD``, and a stair beside the base."""
    stack.wait_until_driving()
    listening = Ears()
    stack.wait(lambda: listening.with_frames >= HEARD - {topics.BUMPER_CLOUD}, "every topic with a frame", 120.0)
    stack.wait(lambda: any(parent == topics.MAP_FRAME for parent, _ in set(listening.edges)), "a map's frame", 30.0)
    read = stack.plant.read
    monkeypatch.setattr(stack.plant, "read", lambda: read()._replace(hazards=Hazard.CLIFF_LEFT))
    stack.wait(lambda: topics.BUMPER_CLOUD in listening.with_frames, "the stair to be told", 10.0)
    monkeypatch.undo()
    yield listening
    listening.close()


def test_every_frame_is_in_one_tree_and_every_covariance_means_something(ears: Ears) -> None:
    parents = {child: parent for parent, child in ears.edges}
    assert len(parents) == len(ears.edges), "a frame with two parents"
    assert set(parents.values()) - parents.keys() == {topics.MAP_FRAME}, "more than one tree"
    for topic, message in dict(ears.last).items():
        assert frames_of(message) <= {*parents, topics.MAP_FRAME}, topic

    diagonals = {topic: covariances_of(message) for topic, message in dict(ears.last).items()}
    told = {(topic, name) for topic, found in diagonals.items() for name in found}
    assert told == {
        (topics.ODOM, "PoseWithCovariance.covariance"),
        (topics.ODOM, "TwistWithCovariance.covariance"),
        (topics.POSE, "PoseWithCovariance.covariance"),
        (topics.IMU, "Imu.orientation_covariance"),
        (topics.IMU, "Imu.angular_velocity_covariance"),
        (topics.IMU_RAW, "Imu.angular_velocity_covariance"),
    }
    for topic, name in told:
        if topic == topics.IMU_RAW:  # of three axes
            assert all(0.0 < rate < 1.0 for rate in diagonals[topic][name])
            continue
        *linear, roll, pitch, yaw = diagonals[topic][name]
        assert min(roll, pitch) > HUGE, topic
        assert 0.0 < yaw < 1.0, topic
        if linear:
            assert 0.0 < min(linear[:2]) <= max(linear[:2]) < 100.0, topic
            assert linear[2] > HUGE, topic


@pytest.fixture
def base(tmp_path: Path) -> Iterator[LoneBase]:
    alone = LoneBase(tmp_path)
    yield alone
    alone.close()


@pytest.mark.light
@pytest.mark.parametrize(
    ("silent", "edges"),
    [
        ("", [(topics.MAP_FRAME, topics.ODOM_FRAME), (topics.ODOM_FRAME, topics.BASE_FRAME)]),
        ("mobile_base", [(topics.MAP_FRAME, topics.ODOM_FRAME)]),
        ("vslam", [(topics.ODOM_FRAME, topics.BASE_FRAME)]),
    ],
)
def test_an_edge_of_tf_can_be_somebody_elses(base: LoneBase, silent: str, edges: list[tuple[str, str]]) -> None:
    """Odometry and the static edges go on whoever owns the others."""
    base.start("mobile_base", "_robot_type:=kobuki", f"_port:={base.port}", f"_publish_tf:={silent != 'mobile_base'}")
    base.start("vslam", f"_publish_tf:={silent != 'vslam'}")
    moving, _ = base.observe(TF_OBSERVER, str(len(edges)))
    assert moving == [list(edge) for edge in edges]


@pytest.mark.light
def test_in_a_namespace_the_frames_of_a_base_with_its_own_driver_are_in_one_tree(base: LoneBase) -> None:
    """That driver knows nothing of the namespace, and has a tree of its own."""
    base.processes.start("robot", sys.executable, "-c", OTHER_DRIVER)
    base.start("mobile_base", "__ns:=vsx", "_robot_type:=ros:/odom,/cmd_vel")
    base.start("vslam", "__ns:=vsx")
    moving, static = base.observe(TF_OBSERVER, "3", "__ns:=vsx")
    parents = {child: parent for parent, child in moving + static}
    assert len(parents) == len(moving + static), "a frame with two parents"
    assert set(parents.values()) - parents.keys() == {"odom", f"vsx/{topics.MAP_FRAME}"}
    assert parents[f"vsx/{topics.BASE_FRAME}"] == f"vsx/{topics.ODOM_FRAME}"
