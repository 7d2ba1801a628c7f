"""Whether the ROS master that answers knows this node. Without it nobody can be found, stopped or replaced.

A master that was started again knows nobody: connections between nodes outlive it, none of its answers says that it is
another one, and rospy registers each name once, when it is offered. So each node asks whether all that it offers is
still registered, and registers it again, with the parameters that it needs, where it is not."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import rosgraph
import rospy
import rospy.core
from rospy.impl import registration

from vsx_ros.ros.calls import answers_at, ask_master

REGISTER_S = 5.0  # All nodes register at a new master at once
PERIOD_S = 0.5  # between questions to the master
TOPICS_EVERY = 10
"""Services are looked for in each period; topics, which only a list of the whole graph tells, in one of so many."""
SILENT_AFTER_S = 0.3  # Beyond the period


class Offers(NamedTuple):
    """What this node has registered: topic -> type, and service -> address."""

    published: dict[str, str]
    subscribed: dict[str, str]
    services: dict[str, str]


@cache
def master_watch() -> MasterWatch:
    """The one watch of this process, which is one node. It begins with the first call, after init_node."""
    return MasterWatch()


class MasterWatch:
    """Asks every ``period_s`` seconds on a thread of its own."""

    def __init__(self) -> None:
        self.period_s = PERIOD_S
        self._answered_s, self._told_all_s = time.monotonic(), -math.inf
        self._trouble = "the ROS master was not asked yet"
        self._owing = False
        self._lock = threading.Lock()
        self._stated: dict[str, Any] = {}
        self._unwritten: set[str] = set()
        self._found: dict[str, Any] = {}
        threading.Thread(target=self._ask, name="master", daemon=True).start()

    @property
    def answers(self) -> bool:
        """Whether the master answered lately."""
        return time.monotonic() - self._answered_s < self.period_s + SILENT_AFTER_S

    @property
    def trouble(self) -> str:
        """Why nothing may move: the master is silent, or this node cannot be found there; else nothing."""
        return self._trouble if self.answers else "the ROS master does not answer; start it again"

    def keep(self, values: Mapping[str, Any]) -> None:
        """These parameters are so, at this master and at all that follow. Waits for the master only a moment."""
        with self._lock:
            for name, value in values.items():
                self._stated[rospy.resolve_name(name)] = value
                self._unwritten.add(rospy.resolve_name(name))
        if not self._trouble:
            with contextlib.suppress(Exception):  # no answer, or nonsense: the thread does it later
                self._write()

    def remember(self, values: Mapping[str, Any]) -> None:
        """Parameters that were set when all began: a master that follows gets those it lacks."""
        self._found.update(values)

    def _ask(self) -> None:
        while not rospy.core.is_shutdown_requested():
            try:
                self._tell(self._look())
                self._answered_s = time.monotonic()
            except ConnectionRefusedError:
                self._answered_s = -math.inf  # a master that is there and slow refuses nobody
            except Exception:  # no answer, or what nobody can understand
                pass
            time.sleep(self.period_s)

    def _tell(self, trouble: str) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            if trouble and not rospy.core.is_shutdown_requested():
                rospy.logwarn("%s", trouble)

    def _look(self) -> str:
        """Ask, register what is missing, and say why nothing may move."""
        offered = offers()
        questions = [("lookupNode", rospy.get_name()), *(("lookupService", name) for name in offered.services)]
        answers = ask_master(questions)
        mine = [rospy.core.get_node_uri(), *offered.services.values()]
        found = [address if code == 1 else "" for code, _, address in answers]
        if found == mine and not self._owing:
            if time.monotonic() - self._told_all_s < TOPICS_EVERY * self.period_s:
                self._write()
                return ""
            if not missing(offered):
                self._settle()
                return ""
        for (_, what), address, own in zip(questions, found, mine):
            if address not in ("", own) and answers_at(address):
                there = rosgraph.get_master_uri()
                return f"another node is {what} at {there}; end it, or give this robot its own namespace or master"
        if rospy.core.is_shutdown_requested():
            return "the node is ending"  # and has taken back what it offered
        self._tell("the ROS master does not know this node, which registers again")
        self._owing = True
        self._restore()
        register(offered)
        self._owing = False
        if lacking := missing(offered):
            return f"the ROS master has not taken {lacking[0]}"
        self._settle()
        rospy.loginfo("registered again with the ROS master at %s", rosgraph.get_master_uri())
        return ""

    def _settle(self) -> None:
        """All is registered. Look up as they are now its own parameters, the configuration and whose time it is."""
        self._told_all_s = time.monotonic()
        self._write()
        names = (rospy.get_name(), rospy.resolve_name("config"), "/use_sim_time")
        for name, (code, _, value) in zip(names, ask_master([("getParam", name) for name in names])):
            self._found[name] = value if code == 1 else {}

    def _restore(self) -> None:
        """Parameters that a new master lacks; whoever has set one there already is right."""
        leaves = {leaf: value for name, tree in list(self._found.items()) for leaf, value in _leaves(name, tree)}
        there = ask_master([("hasParam", leaf) for leaf in leaves], REGISTER_S)
        lost = [leaf for leaf, (_, _, has) in zip(leaves, there) if not has]
        ask_master([("setParam", leaf, leaves[leaf]) for leaf in lost], REGISTER_S)
        with self._lock:
            self._unwritten.update(self._stated)
        self._write()

    def _write(self) -> None:
        """Parameters that this node has stated and the master does not have yet."""
        with self._lock:
            values = {name: self._stated[name] for name in self._unwritten}
            if values:
                ask_master([("setParam", name, value) for name, value in values.items()])
                self._unwritten.clear()


def _leaves(name: str, tree: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(tree, dict):
        yield name, tree
        return
    for key, value in tree.items():
        yield from _leaves(rosgraph.names.ns_join(name, key), value)


def offers() -> Offers:
    """What this node offers now."""
    topics, services = registration.get_topic_manager(), registration.get_service_manager()
    return Offers(*map(dict, (topics.get_publications(), topics.get_subscriptions(), services.get_services())))


def missing(offered: Offers) -> list[str]:
    """What the master does not have of this node's, but for what it has let go since."""
    ((_, _, state),) = ask_master([("getSystemState",)])
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
    ask_master(calls, REGISTER_S)
    subscribed = [("registerSubscriber", name, kind, uri) for name, kind in offered.subscribed.items()]
    known = ask_master(subscribed, REGISTER_S)
    for listener in registration.get_registration_listeners().listeners:
        for (_, name, _, _), (code, _, publishers) in zip(subscribed, known):
            if code == 1:
                listener.publisher_update(name, publishers)
