"""Node ``dock``: drives the base onto its dock and off it again; in time by itself, when the battery runs low.

Subscribers: mobile_base/sensors/dock_ir, mobile_base/{docked,hazards,operator_hold}, battery, dock/pose,
    explore/status, odom, vslam/pose, vslam/state, move_base/{goal,status}.
Publishers: cmd_vel_mux/input/navi (while it docks or undocks), dock/status (latched String, JSON, 1 Hz and on change:
    state, reason, number: of the newest docking or undocking, unlike all before, also of a node that ended; tries,
    docked, known: a dock; holds: nobody else may move the base; battery_left_s: until it is empty, null while unknown),
    /diagnostics, move_base/lease.
Services: dock/start (AddDiagnostics, a standard type that takes a text: JSON {}, or {"at": [x, y, heading]}: the pose
    in the map [m, rad] in which the base charges), dock/leave, dock/cancel (Trigger). Held wheels refuse the first two.
Actions: client of move_base, for the way to the dock.
Parameters: ~config (tree of 'vsx config', branch docking), ~seed (int, 0).

The exploration is paused from docking to undocking; one that drives leaves the dock first, and so does a goal of
somebody else. Bumpers, cliffs and emergency stop act as always; held wheels and such a goal end the docking."""

import math
import threading

import rospy
from geometry_msgs.msg import Twist

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.navigation.dock_light import dock_light
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper, Errand
from vsx_ros.robot import STOP
from vsx_ros.ros import convert, headers, node, threads, topics
from vsx_ros.ros.callbacks import offer_text, offer_trigger
from vsx_ros.ros.dock_claims import DockClaims
from vsx_ros.ros.docking import DockStatus, Errands, HeardDock, wanted_dock
from vsx_ros.ros.driving import PERIOD_S, Lease
from vsx_ros.ros.goal_sender import GoalSender
from vsx_ros.ros.numbered_docking import NumberedDocking

_CONTROL_S, _BATTERY_S, _DECIDE_WITHIN_S = 1.0 / 30.0, 1.0, 1.0


class DockNode:
    """One loop drives; another watches the battery. Services only begin and end things, under the lock."""

    def __init__(self, config: Config) -> None:
        self._lock = threading.Lock()
        self._docking = NumberedDocking(config.docking, int(rospy.get_param("~seed", 0)))
        self._keeper = ChargeKeeper(config.docking)
        self._heard, self._goals, self._claims = HeardDock(self._keeper), GoalSender(), DockClaims(self._keeper)
        self._errands = Errands(config.docking, self._heard, self._keeper)
        self._status, self._lease = DockStatus(), Lease(topics.NAVIGATION_LEASE, rospy.get_name())
        self._command_pub = rospy.Publisher(topics.COMMAND_NAVI, Twist, queue_size=1, tcp_nodelay=True)
        offer_text(topics.DOCK_START, self._start)
        offer_trigger(topics.DOCK_LEAVE, self._leave)
        offer_trigger(topics.DOCK_CANCEL, lambda: self._cancel("cancelled by the operator"))
        threads.every(PERIOD_S, "lease", self._lease.keep)
        threads.every(_CONTROL_S, "docking", self._control)
        threads.every(_BATTERY_S, "battery", self._watch)

    def _start(self, text: str | None = None) -> str:
        self._heard.refuse_held()
        seat, kind = self._heard.place(wanted_dock(text or "")), self._heard.kind
        light = dock_light(kind)
        self._errands.pause.begin()
        with self._lock:
            self._docking.dock(headers.timer_ns(), kind, light.dock_at(seat))
            if text is not None:  # a base that a user docks stays there
                self._keeper.sent = False
        return "driving to the dock"

    def _leave(self, errand: Errand | None = None) -> str:
        if errand is None:  # of an errand the exploration is paused already
            self._heard.refuse_leaving()
        with self._lock:  # a new exploration drives ahead
            self._docking.undock(headers.timer_ns(), math.pi if self._errands.pause.began_here else 0.0)
        return "leaving the dock backwards"

    def _cancel(self, reason: str) -> str:
        with self._lock:
            self._docking.cancel(headers.timer_ns(), reason)
        return reason

    def _control(self) -> None:
        now_ns = headers.timer_ns()
        with self._lock:
            self._claims.heed(now_ns, self._docking, self._heard.hold, bool(self._heard.docked))
            if not self._docking.state.rests:
                self._drive(now_ns)
            if ended := self._docking.has_ended():
                self._goals.cancel()
                self._command_pub.publish(convert.twist(STOP))
            taken = self._docking.notice_taken_off(now_ns, bool(self._heard.docked))
            self._status.publish(self._docking, self._heard, self._claims, self._keeper.meter.left_s)
        if taken or (ended and self._docking.state in (DockingState.UNDOCKED, DockingState.FAILED)):
            self._errands.pause.end()

    def _drive(self, now_ns: int) -> None:
        self._lease.promise(_DECIDE_WITHIN_S)
        seen = self._heard.seen(now_ns, self._goals.state())
        act = self._docking.step(now_ns, seen) if seen is not None else None
        if act is not None and act.goal is not None:
            self._goals.send(headers.now_ns(), topics.MAP_FRAME, act.goal)
        command = STOP if act is None or self._heard.odometry_is_old else act.command
        if command is not None and not threads.is_ending():
            self._command_pub.publish(convert.twist(command))

    def _watch(self) -> None:
        try:
            if (errand := self._errands.due(headers.timer_ns(), self._docking)) is not None:
                _ = self._start() if errand is Errand.DOCK else self._leave(errand)
        except VsxError as error:
            rospy.logwarn("%s", error)

    def close(self) -> None:
        """Stand before the node ends."""
        self._cancel("shutting down")
        self._command_pub.publish(convert.twist(STOP))


def main() -> None:
    """Entry point of scripts/dock."""
    node.run("dock", DockNode)
