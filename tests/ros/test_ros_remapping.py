"""A node in somebody else's robot: topics under other names, parameters from a YAML file, and one with a mistake."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

import yaml
from lone_base import LoneBase

from vsx_ros.ros import topics

pytestmark = [pytest.mark.ros, pytest.mark.light]

ODOM, TELEOP = "/wheels/odom", "/joy/cmd_vel"
ASKED_M_S, MAX_M_S, SCALE = 0.3, 0.1, 2.0

DRIVER = """
import json, sys
import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry

odom, teleop, asked = sys.argv[1], sys.argv[2], float(sys.argv[3])
rospy.init_node("driver", disable_signals=True)
heard = []
rospy.Subscriber(odom, Odometry, heard.append, queue_size=50)
hand = rospy.Publisher(teleop, Twist, queue_size=1)
command = Twist()
command.linear.x = asked
def wait(condition, what, act=lambda: None):
    deadline = rospy.get_time() + 400.0
    while not condition():
        if rospy.get_time() > deadline:
            sys.exit(f"waited for {what}: {heard[-1:]}")
        act()
        rospy.sleep(0.05)
x = lambda: heard[-1].pose.pose.position.x
wait(lambda: heard and x() > 0.4, "the drive", lambda: hand.publish(command))
wait(lambda: all(abs(each.twist.twist.linear.x) < 1e-3 for each in heard[-25:]), "the stop")
print(json.dumps({"x": x(), "frame": heard[-1].header.frame_id}))
"""


@pytest.fixture
def base(tmp_path: Path) -> Iterator[LoneBase]:
    alone = LoneBase(tmp_path)
    yield alone
    alone.close()


def load(base: LoneBase, folder: Path, tree: dict[str, Any]) -> None:
    """``rosparam load`` below the node's name."""
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    done = base.processes.run("rosparam", "load", str(file), "/mobile_base")
    assert done.returncode == 0, done.stderr


def test_a_base_under_other_names_obeys_its_yaml(base: LoneBase, tmp_path: Path) -> None:
    calibrated = {"max_vel": MAX_M_S, "odom_linear_scale_correction": SCALE}
    load(base, tmp_path, {"robot_type": "kobuki", "port": base.port, **calibrated})
    base.start("mobile_base", f"odom:={ODOM}", f"{topics.COMMAND_TELEOP}:={TELEOP}")
    driven = base.observe(DRIVER, ODOM, TELEOP, str(ASKED_M_S))
    assert driven["frame"] == topics.ODOM_FRAME, "frames are not topics"
    assert driven["x"] == pytest.approx(SCALE * base.plant.state.path_length_m, rel=0.1)
    assert base.plant.fastest_m_s == pytest.approx(MAX_M_S, abs=0.002)

    published, subscribed = base.graph()
    assert published[ODOM] == ["/mobile_base"]
    assert subscribed[TELEOP] == ["/mobile_base"]
    assert f"/{topics.ODOM}" not in published
    assert f"/{topics.COMMAND_TELEOP}" not in subscribed
    assert subscribed[f"/{topics.COMMAND_NAVI}"] == ["/mobile_base"]


@pytest.mark.parametrize(
    ("config", "named"),
    [
        ({"limits": {"v_m_s": -1.0}}, ["limits.v_m_s is -1.0"]),
        ({"robot": {"odometry": {"linear_scal": 1.0}}}, ["robot.odometry.linear_scal'"]),
        (0.3, ["/mobile_base/config", "0.3"]),
    ],
)
def test_a_mistake_in_the_yaml_ends_the_node_with_a_sentence(
    base: LoneBase, tmp_path: Path, config: Any, named: list[str]
) -> None:
    load(base, tmp_path, {"robot_type": "kobuki", "port": base.port, "config": config})
    ended = base.run("mobile_base")
    assert ended.returncode == 1
    said = [line for line in (ended.stdout + ended.stderr).splitlines() if line.strip()]
    assert len(said) == 1, said
    assert "mobile_base: " in said[0]
    for word in named:
        assert word in said[0]
