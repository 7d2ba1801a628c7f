"""A base of a user's own module, through the node mobile_base: who stops it when that node dies."""

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from lone_base import LoneBase

from vsx_ros.registry import PLUGINS
from vsx_ros.ros import topics

pytestmark = [pytest.mark.ros, pytest.mark.light]

HAND = f"""
import time
import rospy
from geometry_msgs.msg import Twist
rospy.init_node("hand", disable_signals=True)
hand = rospy.Publisher("{topics.COMMAND_TELEOP}", Twist, queue_size=1)
forwards = Twist()
forwards.linear.x = 0.05
while True:
    hand.publish(forwards)
    time.sleep(0.05)
"""

WIRED = """
from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.protocol import BAUD
from vsx_ros.ros.base_drivers import BASES, at_port

BASES.add("mine", at_port(BAUD, KobukiDialect))
"""


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LoneBase]:
    (tmp_path / "my_wired.py").write_text(WIRED)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv(PLUGINS, "my_wired")
    made = LoneBase(tmp_path)
    made.processes.start("hand", "python3", "-c", HAND)
    yield made
    made.close()


def test_a_killed_node_leaves_a_base_of_one_s_own_standing(base: LoneBase) -> None:
    node = base.start("mobile_base", "_robot_type:=mine", f"_port:={base.port}")
    base.processes.wait(lambda: base.plant.turns, "the hand to drive")
    node.kill()
    node.wait()
    base.processes.wait(lambda: not base.plant.turns, "the watchdogs to stop the wheels")
