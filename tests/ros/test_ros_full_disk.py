"""Nodes whose words a full disk does not take: the stop is taken and answered, and a base that comes back is driven."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from lone_base import LoneBase
from waiting import PATIENCE_S

from vsx_ros.ros import topics

pytestmark = [pytest.mark.ros, pytest.mark.light]

FULL = "/dev/full"
STOP = f"""
import json, threading
import rospy
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

rospy.init_node("operator", anonymous=True)
rospy.wait_for_service("{topics.ESTOP}", {PATIENCE_S})
rospy.wait_for_message("{topics.ODOM}", Odometry, {PATIENCE_S})
answers = []
call = lambda: answers.append(rospy.ServiceProxy("{topics.ESTOP}", SetBool)(True).message)
thread = threading.Thread(target=call, daemon=True)
thread.start()
thread.join({PATIENCE_S})
print(json.dumps([answers, rospy.get_param("/mobile_base/estopped", None)]))
"""
HANGING = f"""
import json, os, signal, sys, threading
import rospy
from std_srvs.srv import SetBool

rospy.init_node("operator", anonymous=True)
rospy.wait_for_service("{topics.ESTOP}", {PATIENCE_S})
stop = rospy.ServiceProxy("{topics.ESTOP}", SetBool, persistent=True)
stop(False)
answers, master = [], int(sys.argv[1])
os.kill(master, signal.SIGSTOP)
thread = threading.Thread(target=lambda: answers.append(stop(True).message), daemon=True)
thread.start()
thread.join({PATIENCE_S})
os.kill(master, signal.SIGCONT)
print(json.dumps(answers))
"""
REPORTS = f"""
import json
import rospy
from nav_msgs.msg import Odometry

rospy.init_node("listener", anonymous=True)
print(json.dumps(rospy.wait_for_message("{topics.ODOM}", Odometry, {PATIENCE_S}).header.frame_id))
"""


@pytest.fixture
def base(tmp_path: Path) -> Iterator[LoneBase]:
    """What its node says, on the screen and in its log, a full disk does not take."""
    for name in ("mobile_base.txt", "mobile_base.log"):
        (tmp_path / name).symlink_to(FULL)
    made = LoneBase(tmp_path)
    made.start("mobile_base", "_robot_type:=kobuki", f"_port:={made.port}")
    yield made
    made.close()


def test_the_emergency_stop_is_taken_and_answered(base: LoneBase) -> None:
    assert base.observe(STOP) == [["stopped"], True]


def test_a_base_that_is_plugged_in_again_reports_again(base: LoneBase) -> None:
    assert base.observe(REPORTS) == "odom"
    base.emulator.unplug()
    base.processes.wait(lambda: not Path(base.port).exists(), "the port to go")
    base.observe("import json, time; time.sleep(3.0); print(json.dumps(0))")
    base.emulator.replug()
    assert base.observe(REPORTS) == "odom"


def test_a_master_that_hangs_stands_not_between_the_stop_and_its_answer(base: LoneBase) -> None:
    master = base.processes._processes[0].pid
    try:
        assert base.observe(HANGING, str(master)) == ["stopped"]
    finally:
        os.kill(master, signal.SIGCONT)
