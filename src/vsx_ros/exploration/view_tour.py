"""The mission's state MAPPING: from view to view while one is worth its drive (paper 5.2), away from touched obstacles,
and home on request."""

from vsx_ros.config import Config
from vsx_ros.exploration.choice import Choice
from vsx_ros.exploration.decision import SECOND_NS, Action, Decision, MissionLog, NavigationState, Outcome, Situation
from vsx_ros.exploration.home import Home
from vsx_ros.exploration.recovery import SPOT_TURN, Trail, escape_arc
from vsx_ros.exploration.utility import Ranking, Rejection, View
from vsx_ros.exploration.view_selector import ExpectedGain, ViewSelector
from vsx_ros.exploration.zone_exit import ZoneWatch
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.anchored_poses import MapCorrections
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import MAP_FRAME, ODOM_FRAME
from vsx_ros.slam.state import TrackingState

_EMPTY_WAIT_NS = 2 * SECOND_NS  # no view: the mapper may still be making the map
_SETTLE_NS, BRAKE_NS = SECOND_NS, SECOND_NS // 2  # wait for the map after a failed goal; for the base to stand
_HOME_AGAIN_NS = 5 * SECOND_NS  # between tries to get home
_MOST_BLOCKED = 30  # failed steps away from a hazard
_SHOWS_TOO_LITTLE = Rejection.NO_ROOM, Rejection.NO_GAIN
_AHEAD_M, _AHEAD_RAD = 0.2, 0.3  # braking from there at full speed ends at the view; the camera sees what it shows


class ViewTour:
    """Call ``observe`` with every situation, ``decide`` while the map is known. backing_off: whether it drives away
    from something, back along the trail. has_gone: whether it ever drove to a view, in this session or an earlier
    one."""

    def __init__(self, config: Config, log: MissionLog, home: Home, trail: Trail, view_selector: ViewSelector) -> None:
        self._config = config.exploration
        self._body_m, self._phi_rad_m = config.robot.radius_m, config.planner.phi_rad_m
        self._log, self._home, self._trail, self._view_selector = log, home, trail, view_selector
        self._goal: View | None = None
        self._gain: ExpectedGain | None = None
        self._stopped_for = self._leaving = ""
        self._exit = SE2()  # of the zone that it leaves
        self._has_looked = False  # from the goal, before the base stands there
        self._corrections = MapCorrections()
        self._zones = ZoneWatch(config.robot.radius_m)
        self._empty_rankings = self._blocked = 0
        self.backing_off = self.has_gone = False

    def observe(self, situation: Situation) -> None:
        """Remember from where the camera looks. What is remembered moves when the map is corrected."""
        if situation.keyframes is not None and self._corrections.update(situation.keyframes):
            self._view_selector.moved(self._corrections)
            self._home.moved(self._corrections)
        self._home.observe(situation)
        if situation.T_map_base is not None and situation.slam_state is TrackingState.GOOD:
            self._view_selector.look_from(situation.T_map_base)

    def decide(self, now_ns: int, situation: Situation) -> Decision:
        """Choose a view, wait until it is reached, choose the next."""
        if not situation.hazard:
            self._blocked = 0
        if situation.navigation is NavigationState.ACTIVE:
            return self._supervise(now_ns, situation)
        pursued = self._goal is not None or self.backing_off or bool(self._leaving)
        if situation.navigation is NavigationState.LOST and pursued:
            return self.rest(now_ns, False, situation.navigation_reason)
        if situation.navigation is NavigationState.ABORTED and pursued:
            self.goal_failed(now_ns, self._stopped_for or situation.navigation_reason)
            self._log.wait_until_ns = now_ns + (_HOME_AGAIN_NS if self._home.asked else _SETTLE_NS)
            return self._log.answer(Action.WAIT, "coming to rest")
        if now_ns < self._log.wait_until_ns:
            return self._log.answer(Action.WAIT, "coming to rest")
        if self._home.asked and self._goal is not None:
            return self._log.finish(now_ns, Outcome.HOME, "returned to the start")
        if self._goal is not None and not self._has_looked:
            self._view_selector.looked_from.append(self._goal.pose)
        self.forget_drive()  # it is reached, also where something is touched there
        if situation.hazard:
            return self._leave(now_ns, situation, situation.hazard)
        if situation.grid is None or situation.T_map_base is None:
            return self._log.answer(Action.WAIT, "waiting for the ground map")
        if zone := self._zones.zone_at(situation.grid, situation.T_map_base):
            return self._drive_out(now_ns, zone, situation.grid, situation.T_map_base)
        return self._choose(now_ns, situation, situation.grid, situation.T_map_base)

    def rest(self, now_ns: int, active: bool, reason: str) -> Decision:
        """Leave the goal without a failure, and come to rest."""
        self.forget_drive()
        self._log.wait_until_ns = now_ns + BRAKE_NS
        if reason != self._log.reason:  # the same until the base stands
            self._log.note(now_ns, reason)
        return self._log.answer(Action.CANCEL if active else Action.WAIT, reason)

    def forget_goal(self) -> None:
        """Forget the goal; the next decision chooses again."""
        self._goal = self._gain = None
        self._has_looked = False

    def forget_drive(self) -> None:
        """Forget whatever the robot drives for: the goal, a step away from something, the way out of a zone."""
        self.forget_goal()
        self.backing_off, self._leaving = False, ""

    def goal_failed(self, now_ns: int, reason: str) -> None:
        """The present goal, if there is one, has failed."""
        if self._goal is not None and self._home.asked:
            self._log.note(now_ns, self._home.failed(now_ns, reason))
        elif self._goal is not None:
            seconds = self._view_selector.blacklist.add(now_ns, self._goal.pose)
            self._log.note(now_ns, f"goal blacklisted for {seconds:.0f} s: {reason}")
        elif self._leaving:
            self._view_selector.exit_failed(now_ns, self._exit)
            self._log.note(now_ns, f"still in the zone {self._leaving!r}: {reason}")
        self.forget_drive()

    def withdraw(self, since_ns: int) -> None:
        """Forget what failed since then: views, exits of zones and tries to get home."""
        self._view_selector.withdraw(since_ns)
        self._home.withdraw(since_ns)

    def _supervise(self, now_ns: int, situation: Situation) -> Decision:
        if situation.hazard and not self.backing_off:
            if not self._stopped_for:
                self._stopped_for = situation.hazard
                self._log.note(now_ns, f"stopping: {situation.hazard}")
            return self._log.answer(Action.CANCEL, f"stopping: {situation.hazard}")
        free = not self.backing_off and not self._leaving
        if free and (zone := self._zones.zone_at(situation.grid, situation.T_map_base)):
            return self.rest(now_ns, True, f"the robot stands in the zone {zone!r}: stopping")
        if self._home.asked and self._goal is None and free:
            return self.rest(now_ns, True, "leaving the goal to drive home")
        view = None if self._goal is None or self._home.asked else self._goal.pose
        if zone := self._zones.zone_at(situation.grid, view):
            return self.rest(now_ns, True, f"the goal now lies in the zone {zone!r}")
        reason = self._gain.why_obsolete(situation.grid) if self._gain and situation.grid is not None else ""
        if reason:
            return self.rest(now_ns, True, reason)
        return self._choose_ahead(now_ns, situation) or self._log.on_the_way()

    def _choose_ahead(self, now_ns: int, situation: Situation) -> Decision | None:
        """The next view, once per goal, where the base brakes for this one: it is ranked and planned to meanwhile, from
        where the base will stand. None elsewhere, and when no view is left: that is judged at rest."""
        goal, grid, T_map_base = self._goal, situation.grid, situation.T_map_base
        if goal is None or grid is None or T_map_base is None or self._has_looked or self._home.asked:
            return None
        off_rad = abs(T_map_base.angle_to(goal.pose))
        if T_map_base.distance_to(goal.pose) > _AHEAD_M or off_rad > _AHEAD_RAD:
            return None
        self._has_looked = True
        self._view_selector.looked_from.append(goal.pose)
        return self._drive_to_best(now_ns, situation, grid, T_map_base)

    def _drive_out(self, now_ns: int, zone: str, grid: OccupancyGrid, T_map_base: SE2) -> Decision:
        """The shortest way out of a zone that was drawn around the robot."""
        goal = self._view_selector.exit_pose(now_ns, grid, T_map_base)
        if goal is None:
            self._log.wait_until_ns = now_ns + _EMPTY_WAIT_NS
            reason = f"the robot stands in the zone {zone!r}, and no way leads out of it: waiting"
            if reason != self._log.reason:
                self._log.note(now_ns, reason)
            return self._log.answer(Action.WAIT, reason)
        self._leaving, self._exit = zone, goal
        away_m = T_map_base.distance_to(goal)
        return self._go(
            now_ns, goal, MAP_FRAME, f"driving out of the zone {zone!r}: {away_m:.1f} m to the nearest place"
        )

    def _choose(self, now_ns: int, situation: Situation, grid: OccupancyGrid, T_map_base: SE2) -> Decision:
        if self._home.asked and self._home.pose is not None:
            if self._home.out_of_reach:
                return self._log.finish(now_ns, Outcome.STRANDED, self._home.out_of_reach)
            self._goal = View(self._home.pose, gain_m2=0.0, distance_m=0.0, landmarks=0, utility=0.0)
            return self._go(now_ns, self._goal.pose, MAP_FRAME, "driving home")
        best = self._drive_to_best(now_ns, situation, grid, T_map_base)
        return best or self._nothing_left(now_ns, situation, grid)

    def _drive_to_best(
        self, now_ns: int, situation: Situation, grid: OccupancyGrid, T_map_base: SE2
    ) -> Decision | None:
        """The drive to the best view; None when no view is worth its drive."""
        views = self._view_selector.rank(now_ns, T_map_base, grid, situation.landmarks_world).views
        if not views:
            return None
        self.forget_goal()
        self._empty_rankings, self.has_gone = 0, True
        self._goal = goal = views[0]
        self._gain = self._view_selector.expected_gain(goal, grid)
        choice = Choice.among(views, self._config.sensor_range_m)
        return self._go(now_ns, goal.pose, MAP_FRAME, choice.words(self._config.stop_cost_m))

    def _nothing_left(self, now_ns: int, situation: Situation, grid: OccupancyGrid) -> Decision:
        """No view is worth its drive: try failed goals again, then look from elsewhere. It is explored only when all
        ground is within reach, or when nothing helps, and the drives have not mostly failed."""
        ranking, blacklist = self._view_selector.ranking, self._view_selector.blacklist
        why, boxed_in = ranking.why(), ranking.boxed_in()
        self._empty_rankings += 1
        self._log.wait_until_ns = now_ns + _EMPTY_WAIT_NS
        if ranking.rejected[Rejection.BLACKLISTED] and blacklist.release(now_ns):
            self._log.note(now_ns, f"no other view found ({why}): blacklisted goals are tried again")
            return self._log.answer(Action.WAIT, "trying blacklisted goals again")
        if self._empty_rankings > (self._config.retries_boxed_in if boxed_in else self._config.retries_without_view):
            if boxed_in and not self.has_gone:
                return self._log.finish(now_ns, Outcome.BOXED_IN, f"no view can be driven to from the start ({why})")
            if _mostly_failed(ranking) and len(blacklist.left(now_ns)) > len(self._view_selector.looked_from):
                return self._log.finish(now_ns, Outcome.BOXED_IN, f"most views could not be driven to ({why})")
            return self._log.finish(now_ns, Outcome.EXPLORED, f"no view is worth its way any more ({why})")
        if boxed_in and self._empty_rankings > self._config.retries_without_view:
            reason, ahead = f"no view found ({why}): turning to look elsewhere", self._empty_rankings % 2 == 1
            return self._escape(now_ns, situation, grid, reason, ahead)
        return self._back_off(now_ns, f"no view found ({why}): looking again from further back")

    def _leave(self, now_ns: int, situation: Situation, hazard: str) -> Decision:
        """Drive away from what was touched: along the trail, or over free ground if there is no trail or it did not
        help."""
        self._blocked += 1
        if self._blocked > _MOST_BLOCKED:
            return self._log.finish(now_ns, Outcome.BLOCKED, f"a hazard that stays: {hazard}")
        along_trail = self._blocked % 2 == 1 and len(self._trail.poses) > 1
        if along_trail or situation.grid is None or situation.T_map_base is None:
            return self._back_off(now_ns, f"backing off: {hazard}")
        escape = self._escape(now_ns, situation, situation.grid, f"turning away: {hazard}", self._blocked % 4 == 0)
        self.backing_off = escape.action is Action.GO
        return escape

    def _escape(self, now_ns: int, situation: Situation, grid: OccupancyGrid, reason: str, ahead: bool) -> Decision:
        """A short arc ahead or back, so that the camera turns. If all arcs are blocked, back along the trail; without a
        trail and without a hazard, a turn on the spot."""
        assert situation.T_map_base is not None
        assert situation.T_odom_base is not None
        step_m = self._config.backtrack_step_m
        arc = escape_arc(grid, situation.T_map_base, self._body_m, self._phi_rad_m, step_m, ahead)
        if arc is None and (self._trail.leads_away or situation.hazard):
            return self._back_off(now_ns, reason)
        return self._go(now_ns, situation.T_odom_base @ (arc or SPOT_TURN), ODOM_FRAME, reason)

    def _back_off(self, now_ns: int, reason: str) -> Decision:
        """A step back along the ground just driven, which is surely free."""
        goal = self._trail.back(self._config.backtrack_step_m)
        if goal is None:
            self._log.wait_until_ns = now_ns + _EMPTY_WAIT_NS
            return self._log.answer(Action.WAIT, "no way back along the trail")
        self.backing_off = True
        return self._go(now_ns, goal, ODOM_FRAME, reason)

    def _go(self, now_ns: int, goal: SE2, frame: str, reason: str) -> Decision:
        self._stopped_for = ""
        return self._log.go(now_ns, goal, frame, reason)


def _mostly_failed(ranking: Ranking) -> bool:
    """Whether goals have failed near most of the poses that would show enough."""
    enough = [count for reason, count in ranking.rejected.items() if reason not in _SHOWS_TOO_LITTLE]
    return 2 * ranking.rejected[Rejection.BLACKLISTED] > sum(enough)
