"""A master that answers, one that is gone, one that comes back."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

from ros_ports import HOST, free_port

from vsx_ros.ros.master_watch import MasterWatch


class Master:
    """What is asked of one, at a port of this machine."""

    def __init__(self, port: int) -> None:
        self._server = SimpleXMLRPCServer((HOST, port), logRequests=False)
        self._server.register_function(lambda name: [1, "", 1], "getPid")
        threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True).start()

    def end(self) -> None:
        self._server.shutdown()
        self._server.server_close()


def wait(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 10.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Of the master to watch; the watch ends with the test."""
    port, ended = free_port(), threading.Event()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:{port}/")
    monkeypatch.setattr("rospy.get_name", lambda: "/base")
    monkeypatch.setattr("rospy.is_shutdown", ended.is_set)
    yield port
    ended.set()


def test_a_master_that_refuses_is_gone_and_one_that_answers_is_back(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vsx_ros.ros.master_watch.SILENT_AFTER_S", 1e6)
    master = Master(port)
    try:
        watch = MasterWatch()
        assert watch.answers
        master.end()
        assert wait(lambda: not watch.answers), "refused, and it is said to be there"
        master = Master(port)
        assert wait(lambda: watch.answers), "it answers, and it is said to be gone"
    finally:
        master.end()


def test_an_answer_that_means_nothing_is_none_and_is_not_the_last(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody else at the master's port for a while: the watch goes on."""
    master = Master(port)
    try:
        watch = MasterWatch()
        with monkeypatch.context() as babel:
            babel.setattr(master._server, "_marshaled_dispatch", lambda *_: b"<methodResponse><nonsense")
            assert wait(lambda: not watch.answers), "nonsense, and it is said to be there"
            time.sleep(0.3)
        assert wait(lambda: watch.answers), "it answers, and it is said to be gone"
    finally:
        master.end()
