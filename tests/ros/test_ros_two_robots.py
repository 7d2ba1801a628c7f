"""Two robots at one master, each in its namespace: topics, commands and tf frames do not cross."""

import json
import signal
import sys
import xmlrpc.client
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rosgraph
from processes import Processes
from ros_ports import HOST, free_port
from waiting import PATIENCE_S

from vsx_ros.ros import launch, topics
from vsx_ros.runs.process import FAILED, STOPPED

pytestmark = pytest.mark.ros

CHECKOUT = Path(__file__).resolve().parents[2]
ROBOTS = ("a", "b")
SHARED = {topics.TF, topics.TF_STATIC, topics.DIAGNOSTICS, "/rosout", "/rosout_agg"}

OBSERVER = """
import json, sys
import rospy
from nav_msgs.msg import Odometry
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from tf2_msgs.msg import TFMessage

rospy.init_node("observer", disable_signals=True)
edges, stamped, speeds, named = set(), {}, {"a": [], "b": []}, set()
def on_tf(msg):
    edges.update((t.header.frame_id, t.child_frame_id) for t in msg.transforms)
for topic in ("/tf", "/tf_static"):
    rospy.Subscriber(topic, TFMessage, on_tf, queue_size=100)
rospy.Subscriber("/diagnostics", DiagnosticArray, lambda m: named.update(s.name for s in m.status), queue_size=50)
def on_odometry(msg, robot):
    stamped[robot] = [msg.header.frame_id, msg.child_frame_id]
    speeds[robot].append(msg.twist.twist.linear.x)
for robot in speeds:
    rospy.Subscriber(f"/{robot}/odom", Odometry, on_odometry, robot, queue_size=50)
def wait(condition, what):
    deadline = rospy.get_time() + 400.0
    while not condition():
        if rospy.get_time() > deadline:
            sys.exit(f"waited for {what}: {sorted(edges)} {stamped}")
        rospy.sleep(0.05)
wait(lambda: len(edges) >= 14 and len(stamped) == 2, "frames and odometry of both")
for each in speeds.values():
    each.clear()
teleop = rospy.Publisher("/a/cmd_vel_mux/input/teleop", Twist, queue_size=1)
command = Twist()
command.linear.x = 0.1
def drive():
    teleop.publish(command)
    return max(speeds["a"], default=0.0) > 0.05
wait(drive, "robot a to drive")
wait(lambda: len(speeds["b"]) > 20, "odometry of b meanwhile")
print(json.dumps({"edges": sorted(edges), "stamped": stamped, "named": sorted(named),
                  "fastest": {robot: max(map(abs, each)) for robot, each in speeds.items()}}))
"""


def start_robot(processes: Processes, folder: Path, robot: str) -> None:
    devices = folder / robot
    devices.mkdir()
    for node in (*launch.emulation("lab", 1, str(devices)), launch.LaunchNode("vslam", {})):
        params = {**node.params, **({"rate_hz": 2.0} if node.name == "emulator" else {})}
        words = [f"_{key}:={value}" for key, value in params.items() if value != ""]
        script = str(CHECKOUT / "scripts" / node.name)
        processes.start(f"{robot}_{node.name}", sys.executable, script, *words, ROS_NAMESPACE=robot)


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    made = Processes(tmp_path, f"http://{HOST}:{free_port()}", ROS_HOSTNAME=HOST)
    yield made
    made.end()


def knows_its_run(uri: str) -> bool:
    """Whether a roscore is up; its last deed is the name of its run, which every launch must then adopt."""
    return rosgraph.is_master_online(uri) and bool(rosgraph.Master("/test", uri).hasParam("/run_id"))


def start_master(processes: Processes) -> str:
    uri = processes.environment["ROS_MASTER_URI"]
    processes.start("master", "rosmaster", "--core", "-p", uri.rsplit(":", 1)[1])
    processes.wait(lambda: rosgraph.is_master_online(uri), "the master")
    return uri


@pytest.mark.light
def test_two_robots_do_not_hear_each_other(processes: Processes, tmp_path: Path) -> None:
    uri = start_master(processes)
    for robot in ROBOTS:
        start_robot(processes, tmp_path, robot)
    observed = processes.run(sys.executable, "-c", OBSERVER)
    assert observed.returncode == 0, observed.stderr + processes.logs()
    seen = json.loads(observed.stdout)

    chain = [topics.MAP_FRAME, topics.ODOM_FRAME, topics.BASE_FRAME, topics.BODY_FRAME, topics.CAMERA_LINK_FRAME,
             topics.CAMERA_FRAME, topics.OPTICAL_FRAME]  # fmt: skip
    tree = [*zip(chain, chain[1:]), (topics.BODY_FRAME, topics.GYRO_FRAME)]
    assert seen["edges"] == sorted([f"{r}/{p}", f"{r}/{c}"] for r in ROBOTS for p, c in tree)
    assert seen["stamped"] == {r: [f"{r}/{topics.ODOM_FRAME}", f"{r}/{topics.BASE_FRAME}"] for r in ROBOTS}
    assert seen["fastest"]["a"] > 0.05
    assert seen["fastest"]["b"] < 0.005
    assert {name.split("/")[0] for name in seen["named"]} == set(ROBOTS)

    published, subscribed, services = xmlrpc.client.ServerProxy(uri).getSystemState("/test")[2]
    for name, nodes in [*published, *subscribed]:
        if name not in SHARED:
            assert {node.split("/")[1] for node in nodes} <= {name.split("/")[1]}, name
    for robot in ROBOTS:
        assert f"/{robot}/{topics.ESTOP}" in dict(services)

    stopped = processes.vsx("stop", ROS_NAMESPACE="a")
    assert stopped.returncode == 0, stopped.stderr
    said = json.loads(processes.vsx("status", "--json", ROS_NAMESPACE="b").stdout)
    assert said["estop"] is False
    assert said["base_reason"]


def test_two_explorations_share_a_master_and_a_third_of_the_same_name_is_refused(
    processes: Processes, tmp_path: Path
) -> None:
    uri = processes.environment["ROS_MASTER_URI"]
    processes.start("roscore", "roscore", "-p", uri.rsplit(":", 1)[1])
    processes.wait(lambda: knows_its_run(uri), "roscore")
    words = "explore --world lab --base create2 --headless --time 300 --rate 5"  # images that two robots have time for
    explore = (sys.executable, "-m", "vsx_ros.cli.main", *words.split())
    runs = {
        robot: processes.start(robot, *explore, "--out", str(tmp_path / robot), ROS_NAMESPACE=robot) for robot in ROBOTS
    }

    def has_mapped(robot: str) -> bool:
        return "mapping: " in (tmp_path / f"{robot}.txt").read_text(encoding="utf-8")

    def state(robot: str) -> str:
        return str(json.loads(processes.vsx("status", "--json", ROS_NAMESPACE=robot).stdout)["state"])

    processes.wait(lambda: all(map(has_mapped, ROBOTS)), "both to map")
    refused = processes.run(*explore, "--out", str(tmp_path / "c"), ROS_NAMESPACE="a")
    assert refused.returncode == FAILED
    assert "node /a/mobile_base runs already" in refused.stderr
    assert "ROS_NAMESPACE=" in refused.stderr
    assert not (tmp_path / "c").exists()
    ended = processes.run("rosservice", "call", f"/b/{topics.EXPLORE_STOP}")
    assert ended.returncode == 0, ended.stderr
    assert runs["b"].wait(PATIENCE_S) == STOPPED, processes.logs()
    assert state("a") in ("mapping", "recovering"), "the end of b is not a's"
    runs["a"].send_signal(signal.SIGINT)
    assert runs["a"].wait(PATIENCE_S) == STOPPED, processes.logs()
    for robot in ROBOTS:
        summary = json.loads((tmp_path / robot / "summary.json").read_text(encoding="utf-8"))
        assert summary["stop_reason"] == "stopped by the operator"
        assert summary["frames_tracked"] > 0
        assert summary["collisions"] == 0
