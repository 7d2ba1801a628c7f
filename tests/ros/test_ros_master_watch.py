"""A master that answers, one that is gone, one that comes back and knows nobody, one that is somebody else's."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from socketserver import ThreadingMixIn
from types import SimpleNamespace
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

import rosgraph
from ros_ports import HOST, free_port
from rosmaster.master_api import ROSMasterHandler
from waiting import PATIENCE_S, wait_for

from vsx_ros.ros import master_watch
from vsx_ros.ros.master_watch import MasterWatch, Offers

pytestmark = pytest.mark.changes_rospy

OFFERS = Offers(
    {"/odom": "nav_msgs/Odometry"}, {"/cmd": "geometry_msgs/Twist"}, {"/base/estop": "rosrpc://localhost:1"}
)  # fmt: skip
ME = f"http://{HOST}:9/"


class Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True
    block_on_close = False


class Graph:
    """The master of ROS itself, at a port where it can be ended and started again."""

    def __init__(self, port: int) -> None:
        self._port = port
        self.server = Server((HOST, port), logRequests=False)
        self.server.register_instance(ROSMasterHandler(3))
        self.server.register_multicall_functions()
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()
        self.asked = rosgraph.Master("/test", f"http://{HOST}:{port}/")

    def end(self) -> None:
        self.server.shutdown()
        self.server.server_close()

    def again(self) -> Graph:
        self.end()
        return Graph(self._port)

    def knows_base(self) -> bool:
        published, subscribed, services = (dict(names) for names in self.asked.getSystemState())
        return (
            published.get("/odom") == ["/base"]
            and subscribed.get("/cmd") == ["/base"]
            and services.get("/base/estop") == ["/base"]
        )


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Of the master to watch; the watch ends with the test."""
    port, ended = free_port(), threading.Event()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:{port}/")
    for name, value in (("get_name", "/base"), ("core.is_shutdown_requested", None), ("core.get_node_uri", ME)):
        monkeypatch.setattr(f"rospy.{name}", ended.is_set if value is None else lambda value=value: value)
    monkeypatch.setattr("rospy.resolve_name", lambda name: name.replace("~", "/base/"))
    monkeypatch.setattr(master_watch, "offers", lambda: OFFERS)
    monkeypatch.setattr(master_watch, "PERIOD_S", 0.1)
    yield port
    ended.set()
    time.sleep(0.2)


@pytest.fixture
def graph(port: int) -> Iterator[list[Graph]]:
    """The master of now, as the only entry; ended with the test."""
    graph = [Graph(port)]
    yield graph
    graph[0].end()


def test_a_master_that_refuses_is_gone_and_one_that_answers_is_back(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(master_watch, "SILENT_AFTER_S", 1e6)
    graph = Graph(port)
    try:
        watch = MasterWatch()
        wait_for(lambda: not watch.trouble)
        graph.end()
        wait_for(lambda: not watch.answers, "refused, and it is said to be there")
        assert watch.trouble == "the ROS master does not answer; start it again"
        graph = Graph(port)
        wait_for(lambda: not watch.trouble, "it answers, and it is said to be gone")
    finally:
        graph.end()


def test_an_answer_that_means_nothing_is_none_and_is_not_the_last(
    graph: list[Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody else at the master's port for a while: the watch goes on."""
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    with monkeypatch.context() as babel:
        babel.setattr(graph[0].server, "_marshaled_dispatch", lambda *_, **__: b"<methodResponse><nonsense")
        wait_for(lambda: not watch.answers, "nonsense, and it is said to be there")
        time.sleep(0.3)
    wait_for(lambda: not watch.trouble, "it answers, and it is said to be gone")


def test_nothing_may_move_until_a_new_master_knows_all_of_the_node(
    graph: list[Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    assert graph[0].knows_base()
    held, register = threading.Event(), master_watch.register

    def in_time(offers: Offers) -> None:
        held.wait(PATIENCE_S)
        register(offers)

    monkeypatch.setattr(master_watch, "register", in_time)
    graph[0] = graph[0].again()
    wait_for(lambda: "does not" in watch.trouble)
    time.sleep(0.5)
    assert watch.trouble, "it answers, but knows nobody"
    held.set()
    wait_for(lambda: not watch.trouble)
    assert graph[0].knows_base()


@pytest.mark.parametrize("lost", ["service", "publisher", "subscriber"])
def test_what_a_master_has_lost_of_the_node_is_registered_anew(graph: list[Graph], lost: str) -> None:
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    as_base = rosgraph.Master("/base", graph[0].asked.master_uri)
    if lost == "service":
        as_base.unregisterService("/base/estop", OFFERS.services["/base/estop"])
    elif lost == "publisher":
        as_base.unregisterPublisher("/odom", ME)
    else:
        as_base.unregisterSubscriber("/cmd", ME)
    assert not graph[0].knows_base()
    wait_for(graph[0].knows_base)


@pytest.mark.parametrize("every", [1, 3])
def test_topics_are_looked_for_every_so_many_periods(
    graph: list[Graph], every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The motion that a master's loss of the topics allows; mobile_base asks for them every third time."""
    asked: list[str] = []
    ask = master_watch.ask_master

    def recorded(questions: list[tuple[Any, ...]], *patience: float) -> Any:
        asked.append(questions[0][0] if questions else "")
        return ask(questions, *patience)

    monkeypatch.setattr(master_watch, "ask_master", recorded)
    watch = MasterWatch()
    watch.topics_every = every
    wait_for(lambda: asked.count("getSystemState") > 4)
    between = "".join({"lookupNode": "s", "getSystemState": "T"}.get(what, "") for what in asked).split("T")
    assert max(map(len, between[1:-1])) <= every


def test_a_new_master_gets_the_parameters_of_the_old_one_but_not_over_newer_ones(graph: list[Graph]) -> None:
    for name, value in (("/base/port", "/dev/one"), ("/base/robot_type", "create"), ("config", {"a": {"b": 1.5}})):
        graph[0].asked.setParam(name, value)
    graph[0].asked.setParam("/use_sim_time", True)
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    watch.keep({"~estopped": True})
    assert graph[0].asked.getParam("/base/estopped") is True
    graph[0].asked.setParam("/config/a/b", 2.5)
    graph[0].asked.deleteParam("/use_sim_time")
    time.sleep(1.5)
    watch.remember({"/follower/gain": 2})
    graph[0].end()
    wait_for(lambda: not watch.answers)
    graph[0] = Graph(graph[0]._port)
    graph[0].asked.setParam("/base/port", "/dev/two")
    wait_for(lambda: not watch.trouble)
    told = graph[0].asked.getParam("/")
    assert told["base"] == {"port": "/dev/two", "robot_type": "create", "estopped": True}
    assert (told["follower"], told["config"]) == ({"gain": 2}, {"a": {"b": 2.5}})
    assert "use_sim_time" not in told, "the replay that set it was over"


def test_what_is_stated_while_no_master_answers_is_written_to_the_next(graph: list[Graph]) -> None:
    graph[0].asked.setParam("/base/estopped", False)
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    graph[0].end()
    wait_for(lambda: not watch.answers)
    watch.keep({"~estopped": True})
    graph[0] = Graph(graph[0]._port)
    wait_for(lambda: not watch.trouble)
    assert graph[0].asked.getParam("/base/estopped") is True


def test_a_slow_new_master_is_not_asked_again_before_it_has_answered(
    graph: list[Graph], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes longer for a question than a healthy one may."""
    watch = MasterWatch()
    wait_for(lambda: not watch.trouble)
    graph[0].end()
    wait_for(lambda: not watch.answers)
    graph[0] = Graph(graph[0]._port)
    answer, counts, registered = graph[0].server._marshaled_dispatch, threading.Lock(), threading.Event()
    waiting, most = [0], [0]

    def slowly(data: bytes, *more: Any, **options: Any) -> Any:
        with counts:
            waiting[0] += 1
            most[0] = max(most[0], waiting[0])
        registered.wait(1.0)
        with counts:
            waiting[0] -= 1
        if b"getSystemState" in data:
            registered.set()
        return answer(data, *more, **options)

    monkeypatch.setattr(graph[0].server, "_marshaled_dispatch", slowly)
    wait_for(lambda: not watch.trouble, "all to be registered")
    assert most == [1]


def test_nodes_that_a_slow_master_does_not_answer_ask_again_at_times_of_their_own(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And in the same times in every run."""

    def pauses(name: str) -> list[float]:
        found, clock = list[float](), [0.0]

        def sleep(seconds: float) -> None:
            found.append(seconds)
            clock[0] += seconds

        def ask(_: object, patience_s: float) -> None:
            clock[0] += patience_s
            raise TimeoutError

        with monkeypatch.context() as patch:
            patch.setattr("rospy.get_name", lambda: name)
            patch.setattr("rospy.core.is_shutdown_requested", lambda: len(found) == 4)
            patch.setattr(master_watch, "ask_master", ask)
            patch.setattr(master_watch, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=sleep))
            patch.setattr(master_watch.threading, "Thread", lambda target, **_: SimpleNamespace(start=target))
            MasterWatch()
        return found

    base, vslam = pauses("/mobile_base"), pauses("/vslam")
    assert base == pauses("/mobile_base")
    assert base[0] == vslam[0] == master_watch.PERIOD_S, "the first late answer may be a hiccup"
    assert base[-1] != vslam[-1]
    assert all(master_watch.PERIOD_S < pause[-1] < 1.0 + master_watch.REGISTER_S for pause in (base, vslam))


@pytest.mark.parametrize("what", ["node", "service"])
def test_a_master_where_another_robot_has_the_name_is_left_alone(graph: list[Graph], what: str) -> None:
    with socket.create_server((HOST, 0)) as living:
        address = f"http://{HOST}:{living.getsockname()[1]}/"
        stranger = rosgraph.Master("/base" if what == "node" else "/other", graph[0].asked.master_uri)
        before: Any = stranger.registerService("/base/estop", address.replace("http", "rosrpc"), address)
        watch = MasterWatch()
        wait_for(lambda: "another node" in watch.trouble, "its services would be taken from it")
        time.sleep(0.5)
        assert graph[0].asked.lookupService("/base/estop") == address.replace("http", "rosrpc"), before
        assert "another node" in watch.trouble
    wait_for(lambda: not watch.trouble, "it has died")
    assert graph[0].knows_base()
