"""What the node dock hears and tells, and how others ask it."""

import json
import math
import time

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool, String, UInt8, UInt8MultiArray

from vsx_ros.config import DockingConfig
from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.limits import FAR_M, json_tree
from vsx_ros.navigation.dock_light import DockSight
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingSeen, DockingState
from vsx_ros.navigation.energy import ChargeKeeper, Errand
from vsx_ros.robot import OperatorHold
from vsx_ros.ros import calls, convert, headers, topics
from vsx_ros.ros.callbacks import hear_operator_hold, subscribe
from vsx_ros.ros.dock_claims import DockClaims, stands_on_dock
from vsx_ros.ros.exploration_pause import ExplorationPause
from vsx_ros.ros.logs import OK, WARN, Diagnostics
from vsx_ros.ros.numbered_docking import NumberedDocking
from vsx_ros.ros.situation import LocalizationSubscriber

_STATUS_S, _WAY_S = 1.0, 30.0  # between repetitions of the status; between questions for the way
_SOON_S = 1800.0  # the way is asked for when the battery lasts no longer
_ANSWER_S = 5.0  # of the planner
_ODOMETRY_S = 0.5  # as for the follower
_CHARGES = BatteryState.POWER_SUPPLY_STATUS_CHARGING, BatteryState.POWER_SUPPLY_STATUS_FULL


def wanted_dock(text: str) -> SE2 | None:
    """The pose of a charging base in a request of dock/start; None for the remembered one. Raises InputError for
    anything else."""
    try:
        tree = json_tree(text or "{}")
    except ValueError as error:
        raise InputError(f"{text[:80]!r} is not JSON: {error}") from error
    if tree == {}:
        return None
    at = tree.get("at") if isinstance(tree, dict) and tree.keys() == {"at"} else None
    if not isinstance(at, list) or len(at) != 3 or not all(_is_number(value) for value in at):
        raise InputError(f'{text[:80]!r} is no place of a dock; give {{"at": [x, y, heading]}} in m and rad, or {{}}')
    return SE2(*map(float, at))


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < FAR_M


def heard_sight(msg: UInt8MultiArray) -> tuple[str, DockSight]:
    """The kind of base, and what its receivers see. Raises InputError for a message of another shape."""
    seen, dims = bytes(msg.data), msg.layout.dim
    if len(seen) != 3 or len(dims) != 1:
        raise InputError(f"{len(seen)} bytes are no readings of three receivers; is another node publishing them?")
    return str(dims[0].label), DockSight(*seen)


class HeardDock:
    """Subscribers: those of the node, without explore/status. seat: where the base charges, in the map. docked: whether
    the contacts touch; None until that is heard."""

    def __init__(self, keeper: ChargeKeeper) -> None:
        self._keeper = keeper
        self.kind, self._charging, self._hazard = "", False, ""
        self.docked: bool | None = None
        self.seat: SE2 | None = None
        self._is_named = False
        self.hold: OperatorHold | None = None
        self._sight: DockSight | None = None
        self._where = LocalizationSubscriber()
        subscribe(topics.DOCK_IR, UInt8MultiArray, self._on_sight, queue_size=5, tcp_nodelay=True)
        subscribe(topics.DOCKED, Bool, self._on_docked, queue_size=5, tcp_nodelay=True)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5, tcp_nodelay=True)
        subscribe(topics.BATTERY, BatteryState, self._on_battery, queue_size=1)
        subscribe(topics.DOCK_POSE, PoseStamped, self._on_pose, queue_size=1)
        hear_operator_hold(self._on_hold)

    def _on_sight(self, msg: UInt8MultiArray) -> None:
        self.kind, self._sight = heard_sight(msg)

    def _on_docked(self, msg: Bool) -> None:
        self.docked = bool(msg.data)

    def _on_hazards(self, msg: UInt8) -> None:
        self._hazard = convert.hazard_words(msg.data)

    def _on_battery(self, msg: BatteryState) -> None:
        self._charging = msg.power_supply_status in _CHARGES
        full = msg.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_FULL  # by the charger; voltages differ
        self._keeper.add(headers.timer_ns(), 1.0 if full else msg.percentage, self._charging)

    def _on_pose(self, msg: PoseStamped) -> None:
        self.seat = convert.se2(msg.pose)

    def _on_hold(self, hold: OperatorHold | None) -> None:
        self.hold = hold

    @property
    def odometry_is_old(self) -> bool:
        """Whether the base moves unseen."""
        return self._where.odometry_age_s > _ODOMETRY_S

    @property
    def T_map_base(self) -> SE2 | None:
        """The base in the map, if known."""
        return self._where.at(headers.now_ns()).T_map_base

    def refuse_held(self) -> None:
        """Raises InputError while the operator holds the wheels."""
        if (hold := self.hold) is not None:
            raise InputError(f"{hold.words()}, then ask again")

    def refuse_leaving(self) -> None:
        """Raises InputError off the dock, and while the operator holds the wheels."""
        if not self.docked:
            raise InputError("the base is not on its dock")
        self.refuse_held()

    def place(self, named: SE2 | None) -> SE2:
        """Where to dock: at the named seat, else at the known one, also when that moves with the map. Raises InputError
        when there is neither."""
        self._is_named = named is not None
        if (seat := named or self.seat) is None:
            raise InputError("no dock is known in this map: give its place with 'vsx dock --at', or drive onto it once")
        return seat

    def seen(self, now_ns: int, navigation: tuple[NavigationState, str]) -> DockingSeen | None:
        """What is known now; each reading of the receivers once. None before the first odometry. navigation: state and
        reason of the goal."""
        where, sight = self._where.at(now_ns), self._sight
        self._sight = None
        if where.odometry is None:
            return None
        return DockingSeen(
            odometry=where.odometry, sight=sight, docked=bool(self.docked), charging=self._charging,
            hazard=self._hazard, T_map_base=where.T_map_base, navigation=navigation[0],
            navigation_reason=navigation[1], seat=None if self._is_named else self.seat,
        )  # fmt: skip


class WayToDock:
    """The length of the way to the dock, by the planner, asked now and then."""

    def __init__(self) -> None:
        self._asked_s = -math.inf
        self._length_m: float | None = None

    def length_m(self, T_map_base: SE2 | None, seat: SE2) -> float | None:
        """None while it is not known."""
        if T_map_base is not None and time.monotonic() - self._asked_s > _WAY_S:
            self._asked_s, self._length_m = time.monotonic(), self._planned(T_map_base, seat @ SE2(-0.6, 0.0, 0.0))
        return self._length_m

    def _planned(self, start: SE2, goal: SE2) -> float | None:
        ends = [convert.pose_stamped(topics.MAP_FRAME, headers.now_ns(), pose) for pose in (start, goal)]
        try:
            poses = calls.service(topics.MAKE_PLAN, GetPlan, *ends, 0.1, within_s=_ANSWER_S).plan.poses
        except (rospy.ROSException, rospy.ServiceException) as error:
            rospy.logwarn("%s: %s", topics.MAKE_PLAN, error)
            return None
        places = [(p.pose.position.x, p.pose.position.y) for p in poses]
        return sum(math.dist(a, b) for a, b in zip(places, places[1:])) if places else None


class Errands:
    """What is to be done without a user's asking. pause: of the exploration."""

    def __init__(self, config: DockingConfig, heard: HeardDock, keeper: ChargeKeeper) -> None:
        self._config, self._heard, self._keeper, self.pause = config, heard, keeper, ExplorationPause()
        self._way = WayToDock()

    def due(self, now_ns: int, docking: Docking) -> Errand | None:
        """What the battery wants; an exploration that drives leaves the dock first.

        A restarted node lets the exploration that it finds paused go on, or docks on, as for the battery, where the
        base stands on its dock."""
        self.pause.keep()
        heard, state, errand, reason = self._heard, docking.state, None, ""
        if state is DockingState.DOCKED and not heard.docked:
            return None  # the contact may come back; else the docking notices that somebody has taken it off
        if stands_on_dock(docking, bool(heard.docked)) and self.pause.drives and heard.hold is None:
            self.pause.begin()
            errand, reason = Errand.UNDOCK, "the exploration drives, and the base stands on its dock"
        elif self.pause.inherited and heard.docked is False:
            self.pause.end(inherited=True)
        elif self.pause.inherited and heard.docked and heard.seat is not None and heard.kind and heard.hold is None:
            self._keeper.sent = True
            errand, reason = Errand.DOCK, "the base was on its dock when this node began"
        elif self._config.return_to_charge and heard.seat is not None and heard.hold is None:
            left_s = self._keeper.meter.left_s
            soon = left_s is not None and left_s < _SOON_S
            way_m = self._way.length_m(heard.T_map_base, heard.seat) if soon else None
            if heard.hold is None:  # the planner took its time
                errand, reason = self._keeper.errand(now_ns, state, way_m), self._keeper.reason
        if errand is not None:
            rospy.logwarn("%s: %s", errand.value, reason)
        return errand


class DockStatus:
    """Publishers: dock/status, /diagnostics."""

    def __init__(self) -> None:
        self._diagnostics = Diagnostics()
        self._told, self._told_s = "", -math.inf
        self._publisher = rospy.Publisher(topics.DOCK_STATUS, String, queue_size=5, latch=True)

    def publish(self, docking: NumberedDocking, heard: HeardDock, claims: DockClaims, left_s: float | None) -> None:
        """On change of anything but the battery, and once a second."""
        known, docked = heard.seat is not None, bool(heard.docked)
        facts = {"state": docking.state.value, "reason": docking.reason, "tries": docking.tries, "docked": docked}
        facts |= {"known": known, "holds": claims.holds(docking, docked), "number": docking.number}
        told, now_s = json.dumps(facts), time.monotonic()
        if told == self._told and now_s - self._told_s < _STATUS_S:
            return
        if told != self._told:
            rospy.loginfo("%s: %s", docking.state.value, docking.reason)
        self._told, self._told_s = told, now_s
        left = None if left_s is None else round(left_s)
        level = WARN if docking.state is DockingState.FAILED else OK
        self._diagnostics.set("docking", level, docking.reason or "idle", tries=docking.tries, docked=docked)
        self._publisher.publish(json.dumps({**facts, "battery_left_s": left}))
