"""Checks whether the ROS master knows this node. If not, nobody can find, stop or replace the node.

A restarted master knows no nodes. Connections between nodes survive it, its answers do not show that it is new, and
rospy registers each name only once. So each node checks whether all its topics and services are still registered. If
not, it registers them again, together with the parameters that it needs."""

from __future__ import annotations

import contextlib
import math
import threading
import time
import zlib
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import rosgraph
import rospy
import rospy.core
from rospy.impl import registration

from vsx_ros.ros.calls import ANSWER_S, answers_at, ask_master

REGISTER_S = 5.0  # All nodes register at a new master at the same time
PERIOD_S = 0.5  # between questions to the master
TOPICS_EVERY = 10
"""Services are checked every period; topics need a list of the whole graph, so only every so many periods."""
SILENT_AFTER_S = 0.3  # after the period


class Offers(NamedTuple):
    """What this node has registered: topic -> type, and service -> address."""

    published: dict[str, str]
    subscribed: dict[str, str]
    services: dict[str, str]


@cache
def master_watch() -> MasterWatch:
    """The only watch of this process, which is one node. The first call, after init_node, starts it."""
    return MasterWatch()


class MasterWatch:
    """Asks the master every ``period_s`` seconds on its own thread, for topics every ``topics_every`` periods."""

    def __init__(self) -> None:
        self.period_s, self.topics_every = PERIOD_S, TOPICS_EVERY
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
        """Whether the master answered recently."""
        return time.monotonic() - self._answered_s < self.period_s + SILENT_AFTER_S

    @property
    def trouble(self) -> str:
        """Why nothing may move: the master is silent, or this node is not registered there; else an empty string."""
        return self._trouble if self.answers else "the ROS master does not answer; start it again"

    def keep(self, values: Mapping[str, Any]) -> None:
        """Set these parameters at this master and at every later one. Waits for the master only for a moment."""
        with self._lock:
            for name, value in values.items():
                self._stated[rospy.resolve_name(name)] = value
                self._unwritten.add(rospy.resolve_name(name))
        if not self._trouble:
            with contextlib.suppress(Exception):  # no answer or an invalid one: the thread writes them later
                self._write()

    def remember(self, values: Mapping[str, Any]) -> None:
        """Parameters that were set at the start: a later master gets those that it lacks."""
        self._found.update(values)

    def _ask(self) -> None:
        """A slow master also serves questions that nobody waits for any more. So when it is late, and nothing moves,
        each node waits for the answer, and then for a time of its own: else their questions would keep it slow."""
        own_s = REGISTER_S * zlib.crc32(rospy.get_name().encode()) / 2**32
        while not rospy.core.is_shutdown_requested():
            is_late, pause_s = not self.answers, self.period_s
            try:
                self._tell(self._look(REGISTER_S if is_late else ANSWER_S))
                self._answered_s = time.monotonic()
            except ConnectionRefusedError:
                self._answered_s = -math.inf  # a slow master would not refuse the connection
            except TimeoutError:
                pause_s += own_s if is_late else 0.0
            except Exception:  # an invalid answer
                pass
            time.sleep(pause_s)

    def _tell(self, trouble: str) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            if trouble and not rospy.core.is_shutdown_requested():
                rospy.logwarn("%s", trouble)

    def _look(self, patience_s: float) -> str:
        """Ask, register what is missing, and return why nothing may move."""
        offered = offers()
        questions = [("lookupNode", rospy.get_name()), *(("lookupService", name) for name in offered.services)]
        answers = ask_master(questions, patience_s)
        mine = [rospy.core.get_node_uri(), *offered.services.values()]
        found = [address if code == 1 else "" for code, _, address in answers]
        if found == mine and not self._owing:
            if time.monotonic() - self._told_all_s < self.topics_every * self.period_s:
                self._write()
                return ""
            if not missing(offered, patience_s):
                self._settle(patience_s)
                return ""
        for (_, what), address, own in zip(questions, found, mine):
            if address not in ("", own) and answers_at(address):
                there = rosgraph.get_master_uri()
                return f"another node is {what} at {there}; end it, or give this robot its own namespace or master"
        if rospy.core.is_shutdown_requested():
            return "the node is ending"  # and has unregistered its topics and services
        self._tell("the ROS master does not know this node, which registers again")
        self._owing = True
        self._restore()
        register(offered)
        self._owing = False
        if lacking := missing(offered, REGISTER_S):
            return f"the ROS master has not taken {lacking[0]}"
        self._settle(REGISTER_S)
        rospy.loginfo("registered again with the ROS master at %s", rosgraph.get_master_uri())
        return ""

    def _settle(self, patience_s: float) -> None:
        """Everything is registered. Read the node's current parameters, the configuration and /use_sim_time."""
        self._told_all_s = time.monotonic()
        self._write()
        names = (rospy.get_name(), rospy.resolve_name("config"), "/use_sim_time")
        for name, (code, _, value) in zip(names, ask_master([("getParam", name) for name in names], patience_s)):
            self._found[name] = value if code == 1 else {}

    def _restore(self) -> None:
        """Set parameters that a new master lacks; a value that is already there stays."""
        leaves = {leaf: value for name, tree in list(self._found.items()) for leaf, value in _leaves(name, tree)}
        there = ask_master([("hasParam", leaf) for leaf in leaves], REGISTER_S)
        lost = [leaf for leaf, (_, _, has) in zip(leaves, there) if not has]
        ask_master([("setParam", leaf, leaves[leaf]) for leaf in lost], REGISTER_S)
        with self._lock:
            self._unwritten.update(self._stated)
        self._write()

    def _write(self) -> None:
        """Write the parameters of ``keep`` that the master does not have yet."""
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
    """What this node offers or hears now."""
    topics, services = registration.get_topic_manager(), registration.get_service_manager()
    return Offers(*map(dict, (topics.get_publications(), topics.get_subscriptions(), services.get_services())))


def missing(offered: Offers, patience_s: float) -> list[str]:
    """Offers of this node that the master lacks, except those withdrawn since."""
    ((_, _, state),) = ask_master([("getSystemState",)], patience_s)
    name, now = rospy.get_name(), offers()
    return [
        what
        for registered, before, after in zip(state, offered, now)
        for what in (set(before) & set(after)) - {key for key, names in registered if name in names}
    ]


def register(offered: Offers) -> None:
    """Register all, services first: the emergency stop is one. Subscribers get the publishers."""
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
