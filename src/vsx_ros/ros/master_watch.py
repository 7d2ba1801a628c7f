"""Whether the ROS master that answers knows this node. Without it nobody can be found, stopped or replaced.

A master that was started anew knows nobody: connections between nodes outlive it, and none of its answers says that it
is another one. So each node asks whether all that it offers is still registered, and registers it again, with the
parameters that it needs, where it is not.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import rosgraph
import rospy
import rospy.core

from vsx_ros.ros import registrations
from vsx_ros.ros.registrations import REGISTER_S, Call, answers_at, asked, master_uri

PERIOD_S = 0.5
TOPICS_EVERY = 10
"""Services are looked for in each period; topics, which only a list of the whole graph tells, in one of so many."""
SILENT_AFTER_S = 0.3
"""Beyond the period."""


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
        offers, name = registrations.offers(), rospy.get_name()
        questions: list[Call] = [("lookupNode", name), *(("lookupService", service) for service in offers.services)]
        answers = asked(questions)
        mine = [rospy.core.get_node_uri(), *offers.services.values()]
        found = [address if code == 1 else "" for code, _, address in answers]
        if found == mine and not self._owing:
            if time.monotonic() - self._told_all_s < TOPICS_EVERY * self.period_s:
                self._write()
                return ""
            if not registrations.missing(offers):
                self._settle()
                return ""
        for (_, what), address, own in zip(questions, found, mine):
            if address not in ("", own) and answers_at(address):
                return (
                    f"another node is {what} at {master_uri()}; end it, or give this robot its own namespace or master"
                )
        if rospy.core.is_shutdown_requested():
            return "the node is ending"  # and has taken back what it offered
        self._tell("the ROS master does not know this node, which registers anew")
        self._owing = True
        self._restore()
        registrations.register(offers)
        self._owing = False
        if missing := registrations.missing(offers):
            return f"the ROS master has not taken {missing[0]}"
        self._settle()
        rospy.loginfo("registered anew with the ROS master at %s", master_uri())
        return ""

    def _settle(self) -> None:
        """All is registered. Look up as they are now its own parameters, the configuration and whose time it is."""
        self._told_all_s = time.monotonic()
        self._write()
        names = (rospy.get_name(), rospy.resolve_name("config"), "/use_sim_time")
        for name, (code, _, value) in zip(names, asked([("getParam", name) for name in names])):
            self._found[name] = value if code == 1 else {}

    def _restore(self) -> None:
        """Parameters that a new master lacks; whoever has set one there already is right."""
        leaves = {leaf: value for name, tree in list(self._found.items()) for leaf, value in _leaves(name, tree)}
        there = asked([("hasParam", leaf) for leaf in leaves], REGISTER_S)
        lost = [leaf for leaf, (_, _, has) in zip(leaves, there) if not has]
        asked([("setParam", leaf, leaves[leaf]) for leaf in lost], REGISTER_S)
        with self._lock:
            self._unwritten.update(self._stated)
        self._write()

    def _write(self) -> None:
        """Parameters that this node has stated and the master does not have yet."""
        with self._lock:
            values = {name: self._stated[name] for name in self._unwritten}
            if values:
                asked([("setParam", name, value) for name, value in values.items()])
                self._unwritten.clear()


def _leaves(name: str, tree: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(tree, dict):
        yield name, tree
        return
    for key, value in tree.items():
        yield from _leaves(rosgraph.names.ns_join(name, key), value)
