"""A base with a driver of its own is used by its topics, and so is a camera: the whole stack, and the base alone."""

import json
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMsg
from processes import Processes
from ros_ports import HOST, free_port
from waiting import PATIENCE_S

from vsx_hw.readings import BaseReading
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.ros import base_drivers, callbacks, convert, headers, logs, topic_base, topics
from vsx_ros.ros.topic_base import topic_names
from vsx_ros.ros.topic_camera import TopicCamera

CHECKOUT = Path(__file__).resolve().parents[2]
ROBOT = """
import json, sys, threading
import cv2, numpy as np, rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import SetBool

rospy.init_node("robot", disable_signals=True)
told, ours, images, named = [], [], [], {}
speed = [0.0]
def on_command(msg):
    speed[0] = msg.linear.x
    told.append(msg.linear.x)
rospy.Subscriber("/robot/cmd_vel", Twist, on_command, queue_size=50)
rospy.Subscriber("/odom", Odometry, lambda m: ours.append((m.header.frame_id, m.pose.pose.position.x)), queue_size=50)
rospy.Subscriber("/camera/rgb/image_raw", Image, lambda m: images.append((m.encoding, m.width, m.height)), queue_size=5)
rospy.Subscriber("/diagnostics", DiagnosticArray, lambda m: named.update((s.name, s.hardware_id) for s in m.status))
odom_pub = rospy.Publisher("/robot/odom", Odometry, queue_size=5)
image_pub = rospy.Publisher("/cam/image_raw/compressed", CompressedImage, queue_size=1)
info_pub = rospy.Publisher("/cam/camera_info", CameraInfo, queue_size=1)
teleop = rospy.Publisher("/cmd_vel_mux/input/teleop", Twist, queue_size=1)
commanding, over = [0.0], threading.Event()
def drive():
    x, k, rng = 0.0, 0, np.random.default_rng(0)
    while not over.is_set():
        now = rospy.Time.now()
        x += 0.05 * speed[0]
        reading = Odometry(child_frame_id="base_link")
        reading.header.stamp, reading.header.frame_id = now, "odom"
        reading.pose.pose.position.x, reading.pose.pose.orientation.w = x, 1.0
        reading.twist.twist.linear.x = speed[0]
        odom_pub.publish(reading)
        k += 1
        if k % 4 == 0:
            ok, data = cv2.imencode(".jpg", rng.integers(0, 256, (240, 320, 3), np.uint8))
            image = CompressedImage(format="jpeg", data=data.tobytes())
            image.header.stamp = now
            info = CameraInfo(width=320, height=240, distortion_model="plumb_bob", D=[0.0] * 5)
            info.K = [300.0, 0, 160, 0, 300.0, 120, 0, 0, 1]
            info_pub.publish(info)
            image_pub.publish(image)
        if commanding[0]:
            command = Twist()
            command.linear.x = commanding[0]
            teleop.publish(command)
        rospy.rostime.wallsleep(0.05)
driving = threading.Thread(target=drive, daemon=True)
driving.start()
def wait(condition, what):
    for _ in range(8000):
        if condition():
            return
        rospy.rostime.wallsleep(0.05)
    sys.exit(f"waited for {what}: {told[-3:]} {ours[-3:]} {images[-3:]}")
wait(lambda: ours and images, "odometry and images under our names")
wait(lambda: "mobile_base: link" in named, "the health of the base")
commanding[0] = 0.1
wait(lambda: told and told[-1] == 0.1 and ours[-1][1] > 0.05, "the base to drive")
rospy.ServiceProxy("/mobile_base/estop", SetBool)(True)
wait(lambda: told[-1] == 0.0, "the emergency stop")
rospy.ServiceProxy("/mobile_base/estop", SetBool)(False)
wait(lambda: told[-1] == 0.1, "the base to drive again")
commanding[0] = 0.0
wait(lambda: told[-1] == 0.0, "silence to stop it")
over.set()
driving.join()  # Python would end it within OpenCV, which aborts
base = named["mobile_base: link"]
print(json.dumps({"frame": ours[-1][0], "image": images[-1], "most": max(told), "base": base}))
"""


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    uri = f"http://{HOST}:{free_port()}"
    running = Processes(tmp_path, uri, ROS_HOSTNAME=HOST)
    running.start("master", "rosmaster", "--core", "-p", uri.rsplit(":", 1)[1])
    running.wait(lambda: rosgraph.is_master_online(uri), "the master")
    yield running
    running.end()


@pytest.mark.ros
@pytest.mark.light
def test_a_base_and_a_camera_with_drivers_of_their_own_are_used_by_their_topics(processes: Processes) -> None:
    for node, word in (
        ("mobile_base", "_robot_type:=ros:/robot/odom,/robot/cmd_vel"),
        ("camera", "_device:=ros:/cam/image_raw/compressed"),
    ):
        processes.start(node, sys.executable, str(CHECKOUT / "scripts" / node), word)
    done = processes.run(sys.executable, "-c", ROBOT)
    assert done.returncode == 0, done.stderr + processes.logs()
    seen = json.loads(done.stdout)
    assert seen == {"frame": "odom", "image": ["mono8", 320, 240], "most": 0.1, "base": "/robot/odom"}


class TopicRig:
    """A TopicBase without a master, on a clock of its own. sent: (now_s, v [m/s]) of every command."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s, self.asleep_ns = 100.0, 0
        self.sent: list[tuple[float, float]] = []
        self.links: list[bool] = []
        self.readings: list[int] = []
        clock = SimpleNamespace(monotonic=lambda: self.now_s, monotonic_ns=lambda: round(self.now_s * 1e9))
        monkeypatch.setattr(topic_base, "time", clock)
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: self)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        self.base = topic_base.TopicBase(
            topic_base.TopicNames(), self._on_reading, lambda connected, _: self.links.append(connected), 0.25,
            lambda: self.asleep_ns,
        )  # fmt: skip

    def publish(self, twist: Twist) -> None:
        self.sent.append((self.now_s, twist.linear.x))

    def _on_reading(self, reading: BaseReading) -> None:
        self.readings.append(reading.stamp_ns)
        self.base.drive(0.2, 0.0)

    def tell(self, *stamps_ms: int) -> list[float]:
        """Readings with these stamps, 50 ms apart; returns the speeds that were sent meanwhile."""
        del self.sent[:]
        for stamp_ms in stamps_ms:
            self.now_s += 0.05
            moved = Odometry(stamp_ms * 1_000_000, SE2(0.0, 0.0, 0.0), 0.0, 0.0)
            self.base._on_odometry(moved)
            self.base._send()
        return [v for _, v in self.sent]


@pytest.mark.parametrize("stamps_ms", [(50,), (50, 100), (50, 50, 50, 50), (150, 100, 50), (50, 100, 100, 50, 100)])
def test_a_base_on_topics_stands_until_three_stamps_in_a_row_have_risen(
    stamps_ms: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = TopicRig(monkeypatch)
    assert not any(rig.tell(*stamps_ms))
    assert "of 3 readings in a row with rising stamps" in rig.base.status().message
    assert any(rig.tell(1000, 1050, 1100))
    assert rig.base.status().connected
    assert rig.links == [True]


@pytest.mark.parametrize("first", [(), (1200,)])
def test_a_base_on_topics_stands_after_a_sleep_of_the_machine(
    first: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody's clock has counted it: the command and the reading seem to be fresh."""
    rig = TopicRig(monkeypatch)
    assert any(rig.tell(1000, 1050, 1100, 1150))
    rig.asleep_ns += 35 * 10**9
    told = rig.tell(*first)
    rig.base._send()
    assert rig.sent
    assert not any(told + [v for _, v in rig.sent])
    assert rig.links == [True, False]
    assert not any(rig.tell(1250))
    assert any(rig.tell(1300, 1350, 1400))
    assert rig.links == [True, False, True]


def test_odometry_without_a_twist_has_the_speeds_of_its_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    heard, takes, told = list[Odometry](), list[Callable[[OdometryMsg], None]](), list[object]()
    monkeypatch.setattr(callbacks, "subscribe", lambda _, __, take, **___: takes.append(take))
    monkeypatch.setattr(headers, "refuse_future", lambda _: None)
    monkeypatch.setattr(logs, "_said_s", {})
    monkeypatch.setattr(rospy, "logwarn", lambda *words: told.append(words[1:]))
    callbacks.hear_odometry(heard.append, "odom")
    for k in range(10):
        moved = Odometry(10**9 + k * 10**8, SE2(0.03 * k, 0.0, 0.0))
        takes[0](convert.odometry_msg(moved, topics.ODOM_FRAME, topics.BASE_FRAME))
    assert [reading.v for reading in heard] == pytest.approx([0.0] + [0.3] * 9)
    assert told == [("odom",)]


def test_stamps_that_stand_are_a_silence_after_which_a_row_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = TopicRig(monkeypatch)
    assert rig.tell(50, 100, 150, 200)[-1] == 0.2
    assert rig.tell(*[200] * 9)[-1] == 0.0, "the command ran out: no reading renewed it"
    rig.tell(*[200] * 3)
    assert "no odometry with a newer stamp on /odom for 0.5 s" in rig.base.status().message
    assert rig.base.status().counters == {"readings": 4, "repeated": 12, "late": 0}
    assert not any(rig.tell(250, 300))
    assert rig.tell(350)[-1] == 0.2
    assert rig.links == [True, False, True]


def test_a_driver_that_publishes_each_reading_twice_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = TopicRig(monkeypatch)
    assert not any(rig.tell(50, 50, 100, 100))
    assert set(rig.tell(150, 150, 200, 200, 250)) == {0.2}
    assert rig.base.status().connected
    assert rig.base.status().counters == {"readings": 5, "repeated": 4, "late": 0}


def test_one_repeated_reading_does_not_stop_a_base_on_topics(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = TopicRig(monkeypatch)
    rig.tell(50, 100, 150)
    assert set(rig.tell(150, 200, 250, 250, 300)) == {0.2}
    assert rig.readings == [stamp_ms * 1_000_000 for stamp_ms in (50, 100, 150, 200, 250, 300)]


def test_nothing_is_sent_to_a_base_on_topics_after_the_zero_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command on its way when the node ends would be the last that the base hears."""
    rig = TopicRig(monkeypatch)
    rig.tell(50, 100, 150)
    sending, may_send, publish = threading.Event(), threading.Event(), rig.publish

    def slowly(twist: Twist) -> None:
        if twist.linear.x:
            sending.set()
            may_send.wait(0.3)
        publish(twist)

    monkeypatch.setattr(rig, "publish", slowly)
    driving = threading.Thread(target=lambda: rig.base.drive(0.2, 0.0))
    driving.start()
    assert sending.wait(PATIENCE_S)
    rig.base.close()
    may_send.set()
    driving.join()
    rig.base.drive(0.2, 0.0)
    assert rig.sent[-1][1] == 0.0


def test_odometry_that_its_driver_does_not_trust_is_passed_on_so(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, readings = TopicRig(monkeypatch), list[BaseReading]()
    monkeypatch.setattr(rig.base, "_on_reading", readings.append)
    for k in range(2):
        rig.base._on_odometry(Odometry(k + 1, SE2(), trusted=k == 0))
    assert [reading.odometry.trusted for reading in readings] == [True, False]


@pytest.mark.parametrize(("gap_s", "late"), [(0.2, 0), (0.3, 4)])
def test_odometry_too_rare_for_steady_wheels_is_told(gap_s: float, late: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, told = TopicRig(monkeypatch), list[tuple[object, ...]]()
    monkeypatch.setattr(logs, "due", lambda *_: not told)
    monkeypatch.setattr(rospy, "logwarn", lambda *words: told.append(words[1:]))
    rig.tell(50, 100, 150)
    assert rig.base.status().counters["late"] == 0, "the first ones are no row yet"
    for k in range(4):
        rig.now_s += gap_s - 0.05
        rig.tell(1000 * (k + 1))
    assert rig.base.status().counters["late"] == late
    assert told == [("/odom", pytest.approx(gap_s))] * bool(late)


def test_why_messages_of_other_drivers_are_refused_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, camera = TopicRig(monkeypatch), TopicCamera("/cam/image_raw", lambda _: None)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name.lstrip('/')}")
    monkeypatch.setattr(callbacks, "_refusals", {})
    for topic in ("odom", "/cam/image_raw"):
        callbacks.remember_refusal(topic, "a stamp 9 s ahead")
    assert rig.base.status().message == "/odom: a stamp 9 s ahead"
    assert camera.status().message == "/cam/image_raw: a stamp 9 s ahead"
    rig.tell(50, 100, 150)
    assert rig.base.status().message == "connected"


@pytest.mark.parametrize("factors", [(1.03, 1.0), (1.0, 0.98)])
def test_factors_that_nobody_would_apply_are_refused(
    factors: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All nodes hear the odometry of the base's own driver."""
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: None)
    hears = base_drivers.Listeners(lambda _: None, lambda *_: None, lambda _: None)
    settings = base_drivers.BaseSettings("ros:/robot/odom,/robot/cmd_vel", "")
    assert isinstance(base_drivers.base_driver(settings, hears), topic_base.TopicBase)
    with pytest.raises(ConfigError, match="give them to that driver"):
        base_drivers.base_driver(settings._replace(linear_scale=factors[0], angular_scale=factors[1]), hears)


@pytest.mark.parametrize(
    ("robot_type", "hardware_id"),
    [("ros", "/odom"), ("ros:/robot/odom,/robot/cmd_vel", "/robot/odom"), ("mine", "mine"), ("auto", "/dev/x"),
     ("kobuki", "/dev/x")],
)  # fmt: skip
def test_the_health_of_a_base_without_a_port_blames_no_port(
    robot_type: str, hardware_id: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(base_drivers.BASES, "mine", base_drivers.BaseEntry(lambda *_: SimpleNamespace()))
    assert base_drivers.BaseSettings(robot_type, "/dev/x").hardware_id == hardware_id


def test_topics_of_a_base_are_two_or_the_usual_ones() -> None:
    assert topic_names("ros") == ("odom", "cmd_vel")
    assert topic_names("ros:/a/odom, /a/cmd") == ("/a/odom", "/a/cmd")
    assert topic_names("kobuki") is None
    for wrong in ("/odom", "/odom,", "a,b,c"):
        with pytest.raises(ConfigError, match="give two topics"):
            topic_names(f"ros:{wrong}")
