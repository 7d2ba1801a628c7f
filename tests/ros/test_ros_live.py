"""What a live run leaves at a master that outlives it."""

import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy
from geometry_msgs.msg import Twist
from lone_base import LoneBase
from waiting import PATIENCE_S

from vsx_ros.config import Config
from vsx_ros.ros import calls, live_run, topics

pytestmark = [pytest.mark.ros, pytest.mark.light]

LIVE = f"""
import json, os, sys
from pathlib import Path
import rosgraph, rospy
from std_srvs.srv import SetBool
from vsx_ros.config import Config
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.live_run import LiveRun

port, operator = sys.argv[1:]
base = LaunchNode("mobile_base", {{"robot_type": "kobuki", "port": port}}, respawn=True)
log = Path(os.environ["ROS_LOG_DIR"])
with LiveRun([base], Config(), ("mobile_base",), log, view=False, replayed=False) as live:
    rospy.wait_for_service("{topics.ESTOP}", 60.0)
    stop = rospy.ServiceProxy("{topics.ESTOP}", SetBool)
    began = rospy.get_param("/mobile_base/estopped", False)
    if operator:
        stop(operator == "stops")
    before = rospy.get_param("/mobile_base/estopped", False)
    live.stop_robot()
    stopped = rospy.get_param("/mobile_base/estopped")
after = rosgraph.Master("/test").hasParam("/mobile_base/estopped")
print(json.dumps([began, before, stopped, after]))
"""


def test_a_launcher_that_hangs_is_left_behind_and_its_nodes_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", "")  # as it was, afterwards
    monkeypatch.setattr(live_run, "_END_S", 0.1)
    monkeypatch.setattr(live_run.rospy, "signal_shutdown", lambda _: None)
    with subprocess.Popen(["sleep", "600"], start_new_session=True) as node:
        run = live_run.LiveRun([], Config(), (), tmp_path, view=False, replayed=False)
        hangs = threading.Event()
        processes = SimpleNamespace(procs=[SimpleNamespace(popen=node), SimpleNamespace(popen=None)])
        run._parent = SimpleNamespace(pm=processes, shutdown=hangs.wait)
        run._end()
        hangs.set()
        assert node.wait(PATIENCE_S) == -signal.SIGKILL


MASTER_TAKES_S = 8.0


@pytest.fixture
def ending(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A run at its end, with a master that needs long for everything; it keeps ``params``."""
    monkeypatch.setenv("ROS_LOG_DIR", "")  # as it was, afterwards
    run: Any = live_run.LiveRun([], Config(), (), tmp_path, view=False, replayed=True)
    run.params = {"/use_sim_time": True, "/mobile_base/estopped": True}

    def within(seconds: float, ask: Callable[[], object], whom: str) -> None:
        if seconds < MASTER_TAKES_S:
            raise calls.NoAnswer(whom)
        ask()

    monkeypatch.setattr(calls, "within", within)
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
    monkeypatch.setattr(rospy, "delete_param", run.params.pop)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    monkeypatch.setattr(rosgraph, "Master", lambda _: SimpleNamespace(deleteParam=run.params.pop))
    return run


def test_a_slow_master_forgets_what_would_stop_the_next_run(ending: Any) -> None:
    ending._to_release = "/mobile_base/estopped"
    ending.__exit__()
    assert ending.params == {}


def test_the_wheels_are_held_until_a_slow_master_has_said_whose_stop_it_is(
    ending: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More zeros than are sent anyway pass before it answers."""
    zeros, held, did = [0], threading.Event(), list[str]()

    def publish(_: Twist) -> None:
        zeros[0] += 1
        if zeros[0] == 40:
            held.set()

    def answer(_name: str, _default: bool) -> bool:
        did.append("answered" if held.wait(PATIENCE_S) else "not held")
        return False

    monkeypatch.setattr(rospy, "get_param", answer)
    monkeypatch.setattr(calls, "service", lambda *_, **__: did.append("stopped"))
    ending._zero_pub = SimpleNamespace(publish=publish)
    ending.stop_robot()
    assert did == ["answered", "stopped"]
    assert ending._to_release == "/mobile_base/estopped"


@pytest.fixture
def base(tmp_path: Path) -> Iterator[LoneBase]:
    made = LoneBase(tmp_path)
    yield made
    made.close()


def test_the_stop_at_the_end_of_a_run_is_not_the_next_one_s_but_the_operator_s_is(base: LoneBase) -> None:
    def run(operator: str = "") -> list[bool]:
        began, before, stopped, after = base.observe(LIVE, base.port, operator)
        assert stopped, "a base node that is started again now must not drive"
        return [began, before, after]

    assert run() == [False, False, False]
    assert run("stops") == [False, True, True]
    assert run("releases") == [True, False, False]
    assert run() == [False, False, False]
