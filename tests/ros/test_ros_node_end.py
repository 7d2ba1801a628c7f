"""How nodes end: in the middle of a question, with a signal ignored, and whatever hangs."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

pytest.importorskip("rospy")

import rosgraph
from processes import Processes
from ros_ports import HOST, free_port
from waiting import PATIENCE_S

pytestmark = [pytest.mark.ros, pytest.mark.light]


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Of processes at a master of their own."""
    uri = f"http://{HOST}:{free_port()}"
    running = Processes(tmp_path_factory.mktemp("ends"), uri, ROS_HOSTNAME=HOST)
    running.start("master", "rosmaster", "--core", "-p", uri.rsplit(":", 1)[1])
    running.wait(lambda: rosgraph.is_master_online(uri), "the master")
    yield running.environment
    running.end()


_ASKING = """
import rospy
from vsx_ros.ros import node, threads
def build(config):
    print("asks", flush=True)
    while not threads.is_ending():
        rospy.get_param("/rosdistro", "")
    raise KeyboardInterrupt
node.run("asker", build)
"""


def test_a_node_ends_in_the_middle_of_a_question_to_the_master(environment: dict[str, str]) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _ASKING, "__name:=asker"], env=environment, stdout=subprocess.PIPE, text=True
    ) as node:
        assert node.stdout is not None
        assert node.stdout.readline() == "asks\n"
        node.send_signal(signal.SIGINT)
        try:
            assert node.wait(PATIENCE_S) == 0
        finally:
            node.kill()


_READY = """
from vsx_ros.ros import node
class Open:
    def close(self):
        print("closed", flush=True)
node.run("ready", lambda config: Open())
"""


def test_a_node_ends_though_its_parent_ignored_the_signal(environment: dict[str, str]) -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        child = subprocess.Popen(
            [sys.executable, "-c", _READY, "__name:=ready"], env=environment, stdout=subprocess.PIPE, text=True
        )
    finally:
        signal.signal(signal.SIGTERM, before)
    with child as node:
        assert node.stdout is not None
        try:
            while "ready" not in node.stdout.readline():
                assert node.poll() is None
            node.terminate()
            assert node.stdout.read() == "closed\n"
            assert node.wait(PATIENCE_S) == 0
        finally:
            node.kill()


_STUCK = """
import sys, threading, time
import rospy, rospy.core
from vsx_ros.ros import node, threads
def hang(*_):
    threading.Event().wait()
class Open:
    def close(self):
        print("closes", flush=True)
        if "close" in sys.argv:
            hang()
        if "full disk" in sys.argv:
            raise OSError("disk full")
def fail():
    while not rospy.core._client_shutdown_hooks:
        time.sleep(0.01)
    raise ZeroDivisionError
def build(config):
    if "rospy" in sys.argv:
        rospy.signal_shutdown = hang
    if "hook" in sys.argv:
        rospy.core.add_preshutdown_hook(hang)
    if "thread" in sys.argv:
        threads.worker("sums", fail)
    return Open()
node._STUCK_S, node._LONGEST_S = 0.5, 2.0
node.run("stuck", build)
"""


@pytest.mark.parametrize(
    ("hangs", "failure"),
    [
        (("rospy",), ""),
        (("close",), ""),
        (("rospy", "close"), "NoAnswer('stuck did not answer in 1.5 s')"),
        (("rospy", "full disk"), "OSError('disk full')"),
        (("hook",), ""),
    ],
)
@pytest.mark.parametrize("told", ["signal", "thread"])
def test_a_node_ends_whatever_hangs_in_its_shutdown(
    environment: dict[str, str], told: str, hangs: tuple[str, ...], failure: str
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _STUCK, told, *hangs, "__name:=stuck"],
        env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as node:  # fmt: skip
        assert node.stdout is not None
        assert node.stderr is not None
        try:
            while told == "signal" and "ready" not in node.stdout.readline():
                assert node.poll() is None
            if told == "signal":
                node.terminate()
            assert node.wait(PATIENCE_S) == 1
            assert "closes" in node.stdout.read()
            said = node.stderr.read()
            assert "hangs; it ends by itself" in said
            failures = [line for line in said.splitlines() if "closing failed" in line]
            assert failures == ([f"stuck: its closing failed: {failure}"] if failure else [])
        finally:
            node.kill()
