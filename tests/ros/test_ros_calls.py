"""Questions to processes that hang: nobody waits for ever."""

import socket
import threading
import xmlrpc.client
from collections.abc import Iterator

import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy
from std_srvs.srv import SetBool

from vsx_ros.ros import calls, operator_command
from vsx_ros.runs.process import STOPPED


@pytest.fixture
def hanging_master(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """It takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{listener.getsockname()[1]}")
        monkeypatch.setattr(xmlrpc.client, "Transport", xmlrpc.client.Transport)
        monkeypatch.setattr(calls, "MASTER_S", 0.2)
        yield


def test_what_is_answered_is_returned_and_what_is_raised_is_raised() -> None:
    assert calls.within(30.0, lambda: 7, "nobody") == 7
    assert calls.within(30.0, lambda: None, "nobody") is None
    with pytest.raises(ZeroDivisionError):
        calls.within(30.0, lambda: 1 // 0, "nobody")


def test_who_does_not_answer_in_time_is_named() -> None:
    release = threading.Event()
    with pytest.raises(calls.NoAnswer, match=r"the base did not answer in 0\.05 s"):
        calls.within(0.05, release.wait, "the base")
    release.set()


def test_a_hanging_master_is_given_up(hanging_master: None) -> None:
    calls.bound_master_calls()
    with pytest.raises(TimeoutError):
        rosgraph.Master("/test").getPid()
    assert not rosgraph.is_master_online()
    with pytest.raises(rospy.ROSException):
        calls.service("/mobile_base/estop", SetBool, True, within_s=1.0)


def test_other_nodes_are_not_the_master(hanging_master: None) -> None:
    calls.bound_master_calls()
    connection = xmlrpc.client.Transport().make_connection("127.0.0.1:1")
    assert connection.timeout is not calls.MASTER_S


def test_a_stop_that_is_interrupted_before_the_base_has_confirmed_is_no_success(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(seconds: float, call: object, whom: str) -> None:
        if whom == "the base":
            raise KeyboardInterrupt

    monkeypatch.setattr(calls, "within", interrupted)
    monkeypatch.setattr(operator_command.logs, "quiet_failures", lambda: None)
    assert operator_command.stop(release=False) == STOPPED
    assert "look whether its wheels stand" in capsys.readouterr().err
