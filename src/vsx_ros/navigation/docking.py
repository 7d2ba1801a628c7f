"""Docks a base by the light of its dock, and leaves the dock again. One state machine for the robot and for lock-step.

    dock                                        seen           on the axis        touched, or where the dock should be
    ----> APPROACHING --(there)--> SEARCHING --------> ALIGNING -------> CREEPING ----------------> VERIFYING
              ^                        |                  ^                 | light lost, obstacle    |      | current
              +--(nothing to be seen)--+                  +-- BACKING_OFF <-+-------------------------+      v
    undock ----> UNDOCKING --> UNDOCKED                                            no current              DOCKED

APPROACHING drives to a place before the remembered dock, by the planner. All later motion follows the estimate of the
``DockFilter``, slowly, without the map: it goes to another place when that leads too far from where the planner has led
it. FAILED when the tries are used up or backing off frees no bumper. Call ``step`` with every reading of the base; it
returns what to do. Safety stays below it: a pressed bumper ends driving ahead, here too."""

import math

import numpy as np

from vsx_ros.config import DockingConfig
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.navigation.dock_filter import DockFilter
from vsx_ros.navigation.dock_light import dock_light
from vsx_ros.navigation.dock_moves import LookAround, creep, may_creep, towards, turn
from vsx_ros.navigation.dock_places import PlacesBefore
from vsx_ros.navigation.docking_state import DockingAct, DockingSeen, DockingState
from vsx_ros.robot import STOP, VelocityCommand

_SEEN_PLACES = 4  # at so many the dock was seen: no ghost
_AT_PLACE_M, _FACING_RAD = 0.05, 0.06
_AT_DOCK_M = 0.25  # before its seat: a contact here, in the light of the dock, is one with the dock
_BESIDE_M = (0.0, 0.02, -0.02)
"""How far beside the estimated axis a try goes. In the middle beam nothing tells where the middle is: if a contact is
missed there, the next tries are made to both sides of it. Then the dock is looked for anew: it is known where it was
touched, but its axis may be wrong."""
_TOUCHED_M, _TOUCHED_RAD = 0.08, 0.6  # how well the dock is then known
_BEYOND_M = 0.20  # driven past the seat without contact: the dock was believed so much too near, or missed
_BLOCKED_S, _DARK_S, _NO_CONTACT_S, _NO_CURRENT_S, _STEADY_S, _TAKEN_S = 1.5, 1.5, 2.5, 10.0, 1.0, 3.0
_STATE_S = 60.0  # longest time in one state
_ALIGNMENTS, _LEASH_SIGMAS = 4, 4.0  # the light may lead as far as a place is before the dock, and so many sigmas
_BY_LIGHT = DockingState.SEARCHING, DockingState.ALIGNING, DockingState.CREEPING


class Docking:
    """One attempt at a time; not thread-safe. reason: of the present state, in words. tries: that did not succeed.
    in_vain: leaving the dock has failed by itself: the contacts touched still, or the base did not move."""

    def __init__(self, config: DockingConfig, seed: int) -> None:
        self._config, self._rng, self._light = config, np.random.default_rng(seed), dock_light("kobuki")
        self._filter = DockFilter(self._light, self._rng)
        self.state, self.reason, self.tries, self.in_vain = DockingState.IDLE, "", 0, False
        self._T_map_dock, self._places = SE2(), PlacesBefore(self._light.stand_m)
        self._prior, self._turn_rad, self._entered, self._epoch = (SE2(), 0.0, 0.0), 0.0, True, 0
        # T_odom_base where the state began, the base moved last, it drove ahead last, and the planner has led it.
        self._begun = self._moved = self._ahead = self._led = SE2()
        self._look, self._alignments, self._faces, self._reached = LookAround(0.0, 0.0), 0, False, False
        self._since_ns = self._lit_ns = self._moved_ns = self._steady_ns = 0

    def dock(self, now_ns: int, kind: str, T_map_dock: SE2) -> None:
        """Dock a base of this kind; the dock was last here. Raises ConfigError for a base without a known dock."""
        self._light = dock_light(kind)
        self._filter = DockFilter(self._light, self._rng)
        self._T_map_dock, self.tries, self._reached, self.in_vain = T_map_dock, 0, False, False
        self._places = PlacesBefore(self._light.stand_m)
        self._enter(now_ns, DockingState.APPROACHING, "driving to the dock")

    def undock(self, now_ns: int, turn_rad: float = 0.0) -> None:
        """Leave the dock backwards, then turn on the spot by this angle."""
        self._turn_rad, self.in_vain = turn_rad, False
        self._enter(now_ns, DockingState.UNDOCKING, "leaving the dock backwards")

    def cancel(self, now_ns: int, reason: str) -> None:
        """Stand, and give up."""
        if not self.state.rests:
            self._enter(now_ns, DockingState.FAILED, reason)

    def notice_taken_off(self, now_ns: int, docked: bool) -> bool:
        """Become idle when somebody has taken a docked base off its dock, and say so. docked: the contacts touch."""
        if self.state is DockingState.DOCKED and docked:
            self._steady_ns = now_ns
        elif self.state is DockingState.DOCKED and now_ns - self._steady_ns > _TAKEN_S * 1e9:
            self._enter(now_ns, DockingState.IDLE, "taken off the dock")
            return True
        return False

    def T_odom_dock(self) -> SE2:
        """Where the dock is believed to be."""
        return self._filter.estimate().T_odom_dock

    def step(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        """What to do now."""
        if self.state.rests:
            return DockingAct(STOP)
        begins, self._entered = self._entered, False
        if begins:
            self._begin(now_ns, seen)
        if seen.odometry.odom_epoch != self._epoch:
            return self._enter(now_ns, DockingState.FAILED, "the base has restarted its odometry")
        if self.state in _BY_LIGHT and seen.sight is not None:
            self._filter.add(seen.odometry.T_odom_base, seen.sight)
            self._lit_ns = now_ns if any(seen.sight) else self._lit_ns
        if self.state is DockingState.APPROACHING:
            self._ahead = self._led = seen.odometry.T_odom_base
        if seen.docked and self.state not in (DockingState.VERIFYING, DockingState.UNDOCKING, DockingState.BACKING_OFF):
            if self.state is not DockingState.CREEPING:  # it came unawares: nothing tells better where the dock is
                self._prior = self._light.dock_at(seen.odometry.T_odom_base), _TOUCHED_M, _TOUCHED_RAD
                self._filter.restart(*self._prior)
            return self._enter(now_ns, DockingState.VERIFYING, "the contacts touch")
        if self.state is DockingState.APPROACHING:
            return self._approach(now_ns, seen, begins)
        if seen.hazard and self.state in (DockingState.SEARCHING, DockingState.ALIGNING):
            return self._retry(now_ns, seen.hazard)
        leash_m = self._light.stand_m + _LEASH_SIGMAS * self._config.remembered_sigma_m
        if self.state in _BY_LIGHT and seen.odometry.T_odom_base.distance_to(self._led) > leash_m:
            return self._enter(now_ns, DockingState.APPROACHING, "the light has led too far; trying another place")
        if now_ns - self._since_ns > _STATE_S * 1e9:
            ends = self._fail if self.state is DockingState.UNDOCKING else self._retry
            return ends(now_ns, f"{self.state.value} took too long")
        act = {
            DockingState.SEARCHING: self._search, DockingState.ALIGNING: self._align,
            DockingState.CREEPING: self._creep, DockingState.VERIFYING: self._check,
            DockingState.BACKING_OFF: self._back_off, DockingState.UNDOCKING: self._leave,
        }[self.state](now_ns, seen)  # fmt: skip
        if act.command is not None and act.command.v > 0.0:
            self._ahead = seen.odometry.T_odom_base
        return act

    def _enter(self, now_ns: int, state: DockingState, reason: str) -> DockingAct:
        self.state, self.reason, self._since_ns, self._entered = state, reason, now_ns, True
        return DockingAct(STOP)

    def _begin(self, now_ns: int, seen: DockingSeen) -> None:
        """The first step in a state."""
        self._begun = self._moved = seen.odometry.T_odom_base
        self._lit_ns = self._moved_ns = self._steady_ns = now_ns
        self._alignments, self._faces = 0, False
        if self.state in (DockingState.APPROACHING, DockingState.UNDOCKING):
            self._epoch = seen.odometry.odom_epoch
        if self.state is DockingState.SEARCHING:
            self._look = LookAround(self._begun.theta, self._config.sweep_rad)
            self._filter.restart(*self._prior)

    def _approach(self, now_ns: int, seen: DockingSeen, begins: bool) -> DockingAct:
        if seen.T_map_base is None:
            return self._fail(now_ns, "the base does not know where it is in the map")
        self._T_map_dock = dock = self._light.dock_at(seen.seat) if seen.seat is not None else self._T_map_dock
        if begins and self._places.all_tried:
            unseen = "the dock is not to be seen from any place before it that can be driven to"
            return self._fail(now_ns, unseen if self._reached else f"no way to the dock: {seen.navigation_reason}")
        if (goal := self._places.goal(dock, begins)) is not None:
            return DockingAct(None, goal)
        if seen.navigation is NavigationState.SUCCEEDED:
            T_odom_dock = seen.odometry.T_odom_base @ seen.T_map_base.inverse() @ dock
            self._reached = True
            self._prior = T_odom_dock, self._config.remembered_sigma_m, self._config.remembered_sigma_rad
            return self._enter(now_ns, DockingState.SEARCHING, "looking for the light of the dock")
        if seen.navigation in (NavigationState.CANCELLED, NavigationState.REPLACED):
            return self._fail(now_ns, f"somebody else has ended the drive to the dock: {seen.navigation_reason}")
        if seen.navigation in (NavigationState.ABORTED, NavigationState.LOST):
            return self._enter(now_ns, DockingState.APPROACHING, "no way there; trying another place before the dock")
        return DockingAct(None)

    def _search(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        """Look to both sides, then all around."""
        if (command := self._look.step(seen.odometry.T_odom_base.theta, self._config.omega_rad_s)) is not None:
            return DockingAct(command)
        if self._filter.seen >= _SEEN_PLACES:
            return self._enter(now_ns, DockingState.ALIGNING, "driving onto the axis of the dock")
        if not self._look.circled:
            self._look.circle()
            return DockingAct(STOP)
        return self._enter(now_ns, DockingState.APPROACHING, "no light of the dock here; trying another place")

    def _align(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        """Drive to the axis and face the dock, again and again while the estimate still moves."""
        config, base = self._config, seen.odometry.T_odom_base
        dock = self.T_odom_dock()
        ready = may_creep(dock.inverse() @ base)
        if not self._faces and not ready:
            stand = base.inverse() @ dock @ SE2(self._light.stand_m, 0.0, 0.0)
            if math.hypot(stand.x, stand.y) > _AT_PLACE_M:
                return DockingAct(towards(stand, config.v_m_s, config.omega_rad_s))
        self._faces = True
        bearing = wrap_angle(math.atan2(dock.y - base.y, dock.x - base.x) - base.theta)
        if abs(bearing) > _FACING_RAD:
            return DockingAct(turn(bearing, config.omega_rad_s))
        self._alignments, self._faces = self._alignments + 1, False
        if ready or self._alignments > _ALIGNMENTS:
            return self._enter(now_ns, DockingState.CREEPING, "driving slowly onto the dock")
        return DockingAct(STOP)

    def _creep(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        base = seen.odometry.T_odom_base
        at = (self.T_odom_dock() @ SE2(0.0, _BESIDE_M[self.tries % len(_BESIDE_M)], 0.0)).inverse() @ base
        left_m = at.x - self._light.seat_m
        if base.distance_to(self._moved) > 0.01 or abs(base.angle_to(self._moved)) > 0.02:
            self._moved, self._moved_ns = base, now_ns
        stuck = "the wheels do not move the base" if now_ns - self._moved_ns > _BLOCKED_S * 1e9 else ""
        if told := seen.hazard or stuck:
            if left_m > _AT_DOCK_M:
                return self._retry(now_ns, told)
            self._filter.touched(base, self._light.seat_m)
            return self._enter(now_ns, DockingState.VERIFYING, told)
        if left_m < -_BEYOND_M:
            return self._enter(now_ns, DockingState.VERIFYING, "no contact where the dock should be")
        if left_m > _AT_DOCK_M and now_ns - self._lit_ns > _DARK_S * 1e9:
            return self._retry(now_ns, "the light of the dock is lost")
        return DockingAct(creep(at, left_m, self._config))

    def _check(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        if not seen.docked:
            self._steady_ns = now_ns
            late = now_ns - self._since_ns > _NO_CONTACT_S * 1e9
            return self._retry(now_ns, "the contacts do not touch") if late else DockingAct(STOP)
        if seen.charging and now_ns - self._steady_ns >= _STEADY_S * 1e9:
            return self._enter(now_ns, DockingState.DOCKED, "on the dock, and it charges")
        late = now_ns - self._since_ns > _NO_CURRENT_S * 1e9
        return self._retry(now_ns, "the contacts touch, but no current flows") if late else DockingAct(STOP)

    def _retry(self, now_ns: int, reason: str) -> DockingAct:
        self.tries += 1
        if self.tries >= self._config.tries:
            return self._fail(now_ns, f"{reason}; given up after {self.tries} tries")
        if self.tries % len(_BESIDE_M) == 0 and self._filter.seen >= _SEEN_PLACES:
            self._prior = self.T_odom_dock(), _TOUCHED_M, _TOUCHED_RAD
            self._filter.seen = 0
        self._filter.loosen(self._config.doubt_m, self._config.doubt_rad)
        return self._enter(now_ns, DockingState.BACKING_OFF, f"{reason}; backing off to try again")

    def _back_off(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        if seen.odometry.T_odom_base.distance_to(self._ahead) < self._config.back_off_m:  # over known floor
            return DockingAct(VelocityCommand(-self._config.v_m_s, 0.0))
        if seen.hazard:
            return self._fail(now_ns, f"after backing off there is still: {seen.hazard}; look at the base")
        if self._filter.seen < _SEEN_PLACES:
            return self._enter(now_ns, DockingState.SEARCHING, "looking for the light of the dock")
        return self._enter(now_ns, DockingState.ALIGNING, "driving onto the axis of the dock")

    def _leave(self, now_ns: int, seen: DockingSeen) -> DockingAct:
        base = seen.odometry.T_odom_base
        if base.distance_to(self._begun) < self._config.undock_m:
            return DockingAct(VelocityCommand(-self._config.v_m_s, 0.0))
        if seen.docked:
            return self._fail(now_ns, "the contacts still touch; look at the dock")
        if abs(left_rad := wrap_angle(self._begun.theta + self._turn_rad - base.theta)) > _FACING_RAD:
            return DockingAct(turn(left_rad, self._config.omega_rad_s))
        return self._enter(now_ns, DockingState.UNDOCKED, "off the dock")

    def _fail(self, now_ns: int, reason: str) -> DockingAct:
        self.in_vain = self.state is DockingState.UNDOCKING
        return self._enter(now_ns, DockingState.FAILED, reason)
