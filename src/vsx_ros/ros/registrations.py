"""What this node has registered with the ROS master, and what the master knows of it.

rospy registers each name once, when it is offered, and never looks again.
"""

import socket
import xmlrpc.client
from collections.abc import Sequence
from typing import Any, NamedTuple
from urllib.parse import urlparse

import rosgraph
import rospy
import rospy.core
from rospy.impl import registration

from vsx_ros.ros.calls import TimeoutTransport

ANSWER_S = 0.35
REGISTER_S = 5.0
"""All nodes register at a new master at once."""

Call = tuple[Any, ...]


class Offers(NamedTuple):
    """What this node has registered: topic -> type, and service -> address."""

    published: dict[str, str]
    subscribed: dict[str, str]
    services: dict[str, str]


def answers_at(address: str) -> bool:
    """Whether somebody listens at the address of a node or service; one that died is at the master for ever."""
    there = urlparse(address)
    try:
        socket.create_connection((there.hostname or "", there.port or 0), ANSWER_S).close()
    except OSError:
        return False
    return True


def master_uri() -> str:
    """Of the master that this process was told to use."""
    return str(rosgraph.get_master_uri())


def asked(calls: Sequence[Call], patience_s: float = ANSWER_S) -> list[Any]:
    """(code, words, value) of each call of the master's API, made in this node's name, in one request. The connection
    is closed: a master that is ending answers who is connected, and nobody else."""
    if not calls:
        return []
    with xmlrpc.client.ServerProxy(master_uri(), transport=TimeoutTransport(patience_s=patience_s)) as master:
        many = xmlrpc.client.MultiCall(master)
        for method, *arguments in calls:
            getattr(many, method)(rospy.get_name(), *arguments)
        answers = many()
        return [answers[k] for k in range(len(calls))]


def offers() -> Offers:
    """What this node offers now."""
    topics, services = registration.get_topic_manager(), registration.get_service_manager()
    return Offers(*map(dict, (topics.get_publications(), topics.get_subscriptions(), services.get_services())))


def missing(offered: Offers) -> list[str]:
    """What the master does not have of this node's, but for what it has let go since."""
    ((_, _, state),) = asked([("getSystemState",)])
    name, now = rospy.get_name(), offers()
    return [
        what
        for registered, before, after in zip(state, offered, now)
        for what in (set(before) & set(after)) - {key for key, names in registered if name in names}
    ]


def register(offered: Offers) -> None:
    """All of it, services first: the emergency stop is one. Subscribers learn who publishes."""
    uri = rospy.core.get_node_uri()
    calls = [("registerService", name, address, uri) for name, address in offered.services.items()]
    calls += [("registerPublisher", name, kind, uri) for name, kind in offered.published.items()]
    asked(calls, REGISTER_S)
    subscribed = [("registerSubscriber", name, kind, uri) for name, kind in offered.subscribed.items()]
    known = asked(subscribed, REGISTER_S)
    for listener in registration.get_registration_listeners().listeners:
        for (_, name, _, _), (code, _, publishers) in zip(subscribed, known):
            if code == 1:
                listener.publisher_update(name, publishers)
