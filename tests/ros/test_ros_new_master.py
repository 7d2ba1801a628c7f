"""The master is killed while a base is driven, and another one is started at its address."""

import json
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rosgraph
from lone_base import HAND, LoneBase

from vsx_ros.ros import topics
from vsx_ros.ros.calls import answers_at

pytestmark = [pytest.mark.ros, pytest.mark.light]


LIVE = """
import os, sys, time
from pathlib import Path
from vsx_ros.config import from_dict
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.live_run import LiveRun

base = LaunchNode("mobile_base", {"robot_type": "kobuki", "port": sys.argv[1]}, respawn=True)
config = from_dict({"robot": {"odometry": {"linear_scale": 1.25}}})
log = Path(os.environ["ROS_LOG_DIR"])
with LiveRun([base], config, ("mobile_base",), log, view=False, replayed=False) as live:
    while not live.interrupted:
        time.sleep(0.1)
"""

LISTEN = f"""
import json, time
import rospy
from diagnostic_msgs.msg import DiagnosticArray
rospy.init_node("observer", disable_signals=True)
told = []
rospy.Subscriber("{topics.DIAGNOSTICS}", DiagnosticArray, told.append)
time.sleep(6.0)
print(json.dumps(len(told)))
"""


@pytest.fixture
def base(tmp_path: Path) -> Iterator[LoneBase]:
    made = LoneBase(tmp_path)
    yield made
    made.close()


def children(pid: int) -> set[int]:
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return {int(child) for task in tasks for child in task.read_text().split()}


def stop_path(base: LoneBase) -> bool:
    """Whether whoever asks the master that answers now can stop the base."""
    master = rosgraph.Master("/test", base.uri)
    try:
        subscribed = dict(master.getSystemState()[1])
        listens = "/mobile_base" in subscribed.get(f"/{topics.COMMAND_SAFETY}", [])
        return listens and answers_at(master.lookupService(f"/{topics.ESTOP}"))
    except (OSError, rosgraph.MasterException):
        return False


def test_the_wheels_stand_until_the_new_master_can_stop_them_and_an_emergency_stop_stays(base: LoneBase) -> None:
    base.start("mobile_base", "_robot_type:=kobuki", f"_port:={base.port}")
    base.processes.start("hand", "python3", "-c", HAND)
    base.processes.wait(lambda: base.plant.turns, "the hand to drive")
    for _ in range(3):
        base.kill_master()
        base.processes.wait(lambda: not base.plant.turns, "the wheels to stand")
        base.plant.turned_again = lambda: stop_path(base)
        base.start_master()
        base.processes.wait(lambda: base.plant.turns, "the hand to drive again")
        assert base.plant.could_be_stopped, "it drove before anybody could have stopped it"
    assert base.processes.vsx("stop").returncode == 0
    assert not base.plant.turns
    starts = base.plant.starts
    base.kill_master()
    base.start_master()
    base.processes.wait(lambda: stop_path(base), "the stop path")
    time.sleep(1.0)
    assert base.plant.starts == starts, "the emergency stop was forgotten"
    assert rosgraph.Master("/test", base.uri).getParam("/mobile_base/estopped") is True
    assert base.processes.vsx("stop", "--release").returncode == 0
    base.processes.wait(lambda: base.plant.turns, "the hand to drive once more")


def test_a_run_at_another_s_master_goes_on_and_a_node_that_died_meanwhile_comes_back_as_it_was(base: LoneBase) -> None:
    live = base.processes.start("live", "python3", "-c", LIVE, base.port)
    base.processes.wait(lambda: stop_path(base), "the base")
    (node,) = (pid for pid in children(live.pid) if b"mobile_base" in Path(f"/proc/{pid}/cmdline").read_bytes())
    base.kill_master()
    os.kill(node, 9)
    base.start_master()
    base.processes.wait(lambda: stop_path(base), "the base that was started again")
    told = rosgraph.Master("/test", base.uri).getParam("/")
    assert (told["mobile_base"]["robot_type"], told["mobile_base"]["port"]) == ("kobuki", base.port)
    assert told["config"]["robot"]["odometry"]["linear_scale"] == 1.25
    assert live.poll() is None


def test_health_is_told_and_watchdogs_are_replaced_while_ros_time_stands(base: LoneBase) -> None:
    rosgraph.Master("/test", base.uri).setParam("/use_sim_time", True)
    node = base.start("mobile_base", "_robot_type:=kobuki", f"_port:={base.port}")
    base.processes.wait(lambda: stop_path(base), "the base")
    base.processes.wait(lambda: len(children(node.pid)) == 2, "its watchdogs")
    assert json.loads(base.processes.run("python3", "-c", LISTEN).stdout) >= 3
    before = children(node.pid)
    os.kill(min(before), 9)
    base.processes.wait(lambda: len(children(node.pid) - before) == 1, "a new watchdog")
    base.kill_master()
    base.start_master()
    base.processes.wait(lambda: stop_path(base), "the stop path")
    assert rosgraph.Master("/test", base.uri).getParam("/use_sim_time") is True


def test_what_is_no_master_moves_nothing(base: LoneBase) -> None:
    """Another program took the master's port."""
    base.start("mobile_base", "_robot_type:=kobuki", f"_port:={base.port}")
    base.processes.start("hand", "python3", "-c", HAND)
    base.processes.wait(lambda: base.plant.turns, "the hand to drive")
    base.kill_master()
    base.processes.wait(lambda: not base.plant.turns, "the wheels to stand")
    web: subprocess.Popen[bytes] = base.processes.start("web", "python3", "-m", "http.server", base.master_port)
    base.processes.wait(lambda: base.plant.stands_for(2.0), "the wheels to stand on")
    web.kill()
    web.wait()
    base.start_master()
    base.processes.wait(lambda: base.plant.turns, "the hand to drive again")
