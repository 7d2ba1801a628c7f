"""Questions to other processes that are not waited for longer than is said: rospy's own wait for ever."""

import http.client
import socket
import threading
import xmlrpc.client
from collections.abc import Callable, Sequence
from concurrent import futures
from typing import Any, TypeVar
from urllib.parse import urlparse

import rosgraph
import rospy

MASTER_S = 10.0
"""A master may be slow where nodes start on a busy machine; who cannot wait so long asks on a thread (``within``)."""
ANSWER_S = 0.35  # Who is there and well answers within this time

Answer = TypeVar("Answer")


class NoAnswer(rospy.ROSException):
    """Somebody did not answer in time."""


class TimeoutTransport(xmlrpc.client.Transport):
    """A hanging master accepts connections and never answers. Other nodes are rospy's to ask, on threads of its own."""

    def __init__(self, *others: Any, patience_s: float = MASTER_S, **options: Any) -> None:
        super().__init__(*others, **options)
        self._timeout_s = patience_s

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """To the master, with patience; to others as usual."""
        connection = super().make_connection(host)
        master = urlparse(rosgraph.get_master_uri())
        if (connection.host.lower(), connection.port) == (master.hostname, master.port):
            connection.timeout = self._timeout_s
        return connection


def bound_master_calls() -> None:
    """Parameters, look-ups and registrations of this process raise TimeoutError after MASTER_S."""
    xmlrpc.client.Transport = TimeoutTransport  # type: ignore[misc]  # what every ServerProxy without one of its own takes


def within(seconds: float, ask: Callable[[], Answer], whom: str) -> Answer:
    """What ``ask`` returns, or raises; it goes on by itself when it takes longer. Raises NoAnswer then."""
    answer: futures.Future[Answer] = futures.Future()

    def call() -> None:
        try:
            answer.set_result(ask())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=call, name=f"asks {whom}", daemon=True).start()
    if not futures.wait([answer], seconds).done:
        raise NoAnswer(f"{whom} did not answer in {seconds:g} s")
    return answer.result()


def answers_at(address: str) -> bool:
    """Whether somebody listens at the address of a node or service; one that died is at the master for ever."""
    there = urlparse(address)
    try:
        socket.create_connection((there.hostname or "", there.port or 0), ANSWER_S).close()
    except OSError:
        return False
    return True


def ask_master(questions: Sequence[tuple[Any, ...]], patience_s: float = ANSWER_S) -> list[Any]:
    """(code, words, value) of each call of the master's API, made in this node's name, in one request. The connection
    is closed: a master that is ending answers who is connected, and nobody else."""
    if not questions:
        return []
    with xmlrpc.client.ServerProxy(rosgraph.get_master_uri(), TimeoutTransport(patience_s=patience_s)) as master:
        many = xmlrpc.client.MultiCall(master)
        for method, *arguments in questions:
            getattr(many, method)(rospy.get_name(), *arguments)
        answers = many()
        return [answers[k] for k in range(len(questions))]


def service(name: str, kind: type[Any], *arguments: object, within_s: float) -> Any:
    """Call a service: find it, ask it, hear its answer. Raises rospy.ROSException or rospy.ServiceException."""

    def ask() -> Any:
        rospy.wait_for_service(name, timeout=within_s)
        return rospy.ServiceProxy(name, kind)(*arguments)

    try:
        return within(within_s, ask, rospy.resolve_name(name))
    except (OSError, rosgraph.MasterException) as error:
        raise rospy.ROSException(f"the ROS master does not answer ({error})") from error
