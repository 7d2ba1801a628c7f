"""Calls to other processes with a time limit; rospy's own calls wait forever."""

import http.client
import socket
import threading
import xmlrpc.client
from collections.abc import Callable, Sequence
from concurrent import futures
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlparse

import rosgraph
import rospy

MASTER_S = 10.0
"""The master may be slow when nodes start on a busy machine. A caller that cannot wait so long uses ``within``."""
ANSWER_S = 0.35  # A healthy process answers within this time
_PID_S = 2.0  # for a node to say who it is; nobody waits for the answer

Answer = TypeVar("Answer")


class NoAnswer(rospy.ROSException):
    """The other process did not answer in time."""


class TimeoutTransport(xmlrpc.client.Transport):
    """A hanging master accepts connections but never answers. rospy calls other nodes on its own threads."""

    def __init__(self, *others: Any, patience_s: float = MASTER_S, **options: Any) -> None:
        super().__init__(*others, **options)
        self._timeout_s = patience_s

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """A connection; it has a timeout only if it goes to the master."""
        connection = super().make_connection(host)
        master = urlparse(rosgraph.get_master_uri())
        if (connection.host.lower(), connection.port) == (master.hostname, master.port):
            connection.timeout = self._timeout_s
        return connection


def bound_master_calls() -> None:
    """In this process, parameter calls, look-ups and registrations raise TimeoutError after MASTER_S."""
    xmlrpc.client.Transport = TimeoutTransport  # type: ignore[misc]  # default of ServerProxy


def begin(ask: Callable[[], Answer], whom: str) -> futures.Future[Answer]:
    """Ask on a thread of its own, which lasts until ``ask`` ends; what it returns or raises comes in the future."""
    answer: futures.Future[Answer] = futures.Future()

    def call() -> None:
        try:
            answer.set_result(ask())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=call, name=f"asks {whom}", daemon=True).start()
    return answer


def within(seconds: float, ask: Callable[[], Answer], whom: str) -> Answer:
    """Returns or raises what ``ask`` does. Raises NoAnswer if it takes longer; ``ask`` then continues on its thread."""
    answer = begin(ask, whom)
    if not futures.wait([answer], seconds).done:
        raise NoAnswer(f"{whom} did not answer in {seconds:g} s")
    return answer.result()


def answers_at(address: str) -> bool:
    """Whether a process listens at this address. The master keeps the addresses of dead nodes forever."""
    there = urlparse(address)
    try:
        socket.create_connection((there.hostname or "", there.port or 0), ANSWER_S).close()
    except OSError:
        return False
    return True


def pid_of(node: str) -> int:
    """The process of a node; 0 if it does not answer."""

    def ask() -> int:
        with xmlrpc.client.ServerProxy(rosgraph.Master(rospy.get_name()).lookupNode(rospy.resolve_name(node))) as slave:
            told: Any = slave.getPid(rospy.get_name())
            return int(told[2])

    with suppress(OSError, rosgraph.MasterException, rospy.ROSException, xmlrpc.client.Error):
        return within(_PID_S, ask, node)
    return 0


def is_alive(pid: int) -> bool:
    """Whether the process runs on this machine; one that only waits to be reaped does not."""
    with suppress(OSError, IndexError):
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    return False


def ask_master(questions: Sequence[tuple[Any, ...]], patience_s: float = ANSWER_S) -> list[Any]:
    """(code, words, value) of each call of the master's API, made in this node's name, in one request. The connection
    is closed afterwards: a master that shuts down still answers open connections."""
    if not questions:
        return []
    with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), TimeoutTransport(patience_s=patience_s)) as master:
        many = xmlrpc.client.MultiCall(master)
        for method, *arguments in questions:
            getattr(many, method)(rospy.get_name(), *arguments)
        answers = many()
        return [answers[k] for k in range(len(questions))]


def service(name: str, kind: type[Any], *arguments: object, within_s: float) -> Any:
    """Find and call a service and return its answer. Raises rospy.ROSException or rospy.ServiceException."""

    def ask() -> Any:
        rospy.wait_for_service(name, timeout=within_s)
        return rospy.ServiceProxy(name, kind)(*arguments)

    try:
        return within(within_s, ask, rospy.resolve_name(name))
    except (OSError, rosgraph.MasterException) as error:
        raise rospy.ROSException(f"the ROS master does not answer ({error})") from error
