"""What to do next. One state machine for the robot, the emulator and the lock-step run.

            +--------> STARTING ----(map initialised)----> MAPPING --(no view worth its way)--> DONE
            |            | attempts used up                 |  ^
            |            v                             LOST |  | relocalised
            |           DONE                                v  |
            |                                            RECOVERING --(nothing left to try)--> DONE
            +--- STARTING: in a map made before --> RECOVERING
            +--- MAPPING: home, out of reach, a hazard that stays; any state: stop --> DONE

From any state the operator may pause it, PAUSED, until it goes on in the state before. ``decide`` is called a few times
a second with what is known and answers with one action. Every change of state and every choice is an event with its
reason.
"""

from vsx_ros.config import Config
from vsx_ros.exploration.decision import (
    Action,
    Decision,
    MissionEvent,
    MissionLog,
    MissionState,
    NavigationState,
    Outcome,
    Situation,
)
from vsx_ros.exploration.home import Home
from vsx_ros.exploration.initialization_drives import InitializationDrives
from vsx_ros.exploration.recovery import SPOT_TURN, Recovery, escape_arc
from vsx_ros.exploration.saved_mission import SavedMission
from vsx_ros.exploration.trail import Trail
from vsx_ros.exploration.utility import Rejection, TravelCostsFrom, View
from vsx_ros.exploration.view_selector import ExpectedGain, ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.slam.state import TrackingState

_SECOND_NS = 1_000_000_000
_RELOCALISE_WAIT_NS = _SECOND_NS
_RECOGNISE_WAIT_NS = 5 * _SECOND_NS
_EMPTY_WAIT_NS = 2 * _SECOND_NS
_SETTLE_NS, _BRAKE_NS = _SECOND_NS, _SECOND_NS // 2
_HOME_AGAIN_NS = 5 * _SECOND_NS
_MOST_BLOCKED = 30


class Mission:
    """Explore until nothing is worth its way; recover when lost; never without a reason."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        self._config = config.exploration
        self._body_m, self._phi_rad_m = config.robot.radius_m, config.planner.phi_rad_m
        self._trail = Trail(spacing_m=0.05)
        self._log = MissionLog()
        self._initialization_drives = InitializationDrives(self._config.init_drive_m, self._config.init_attempts)
        self._after_pause = MissionState.STARTING
        self._goal: View | None = None
        self._purpose = self._stopped_for = ""
        self._gain: ExpectedGain | None = None
        self._wait_until_ns = 0
        self._recovery = Recovery(self._config, self._body_m, self._phi_rad_m)
        self._empty_rankings = 0
        self._backing_off = self._has_gone = False
        self._home = Home()
        self._blocked = 0
        self.view_selector = ViewSelector(config, travel_costs)

    @property
    def state(self) -> MissionState:
        """The box of the diagram the mission is in."""
        return self._log.state

    @property
    def outcome(self) -> Outcome | None:
        """How the mission ended; None before."""
        return self._log.outcome

    def drain_events(self) -> list[MissionEvent]:
        """The events since the last call."""
        return self._log.drain()

    # Requests of the operator -------------------------------------------------------------------------------

    def pause(self, now_ns: int) -> None:
        """Stand still until resume."""
        if self.state not in (MissionState.DONE, MissionState.PAUSED):
            self._after_pause = self.state
            self._log.enter(now_ns, MissionState.PAUSED, "paused by the operator")

    def resume(self, now_ns: int) -> None:
        """Go on after a pause."""
        if self.state is MissionState.PAUSED:
            self._goal = self._gain = None
            self._log.enter(now_ns, self._after_pause, "resumed by the operator")

    def stop(self, now_ns: int) -> None:
        """End the mission here."""
        self._log.finish(now_ns, Outcome.STOPPED, "stopped by the operator")

    def home(self, now_ns: int) -> None:
        """Drive back to where the exploration began, then end; nothing once it has ended."""
        if self.state is not MissionState.DONE:
            self._home.asked = True
            self._goal = self._gain = None
            self._log.note(now_ns, "returning home on request")

    # An interruption ----------------------------------------------------------------------------------------

    def to_save(self, now_ns: int, T_odom_base: SE2) -> SavedMission:
        """What another session needs to go on from here."""
        trail = [T_odom_base.inverse() @ pose for pose in self._trail.poses]
        looked_from, blacklist = list(self.view_selector.viewpoints.poses), self.view_selector.blacklist.left(now_ns)
        paused, over = self.state is MissionState.PAUSED, self.state is MissionState.DONE
        return SavedMission(looked_from, blacklist, trail, self._home.asked and not over, self._home.pose, paused)

    def restore(self, now_ns: int, saved: SavedMission, T_odom_base: SE2) -> None:
        """Go on with the map of a session before, standing where its trail ended: first the camera must recognise
        it. One that was paused, before or meanwhile, stands until it is told to go on; one that was stopped meanwhile
        has ended, and remembers all the same."""
        paused = saved.paused or self.state is MissionState.PAUSED
        self.view_selector.viewpoints.poses = list(saved.looked_from)
        self._home.restore(saved.home, saved.going_home)
        self.view_selector.blacklist.restore(now_ns, saved.blacklist)
        for pose in saved.trail:
            self._trail.add(T_odom_base @ pose)
        if self.state is MissionState.DONE:
            return
        self._look_for_a_place(now_ns, "resumed: looking for a place of the known map")
        if paused:
            self.pause(now_ns)

    # The decision --------------------------------------------------------------------------------------------

    def decide(self, now_ns: int, situation: Situation) -> Decision:
        """One action for the situation. Call it at 2 to 10 Hz; choosing a view takes some tenths of a second."""
        backing = self._backing_off or self.state is MissionState.RECOVERING
        restarted = situation.T_odom_base is not None and self._trail.enter_epoch(situation.odom_epoch)
        if situation.lifted:
            self._trail.clear()
        if situation.T_odom_base is not None:
            (self._trail.driven_back_to if backing else self._trail.add)(situation.T_odom_base)
        self._home.observe(situation)
        if situation.T_map_base is not None and situation.slam_state is TrackingState.GOOD:
            self.view_selector.viewpoints.add(situation.T_map_base)
        if self.state is MissionState.DONE:
            return self._answer(Action.FINISH, self._log.reason)
        active = situation.navigation is NavigationState.ACTIVE
        if self.state is MissionState.PAUSED:
            return self._answer(Action.CANCEL if active else Action.WAIT, "paused")
        if situation.T_odom_base is None:
            return self._answer(Action.WAIT, "waiting for odometry")
        if restarted:
            return self._rest(now_ns, active, "odometry restarted: coming to rest")
        if self.state is MissionState.STARTING:
            return self._start(now_ns, situation, situation.T_odom_base)
        if self.state is MissionState.RECOVERING:
            return self._recover(now_ns, situation)
        return self._map(now_ns, situation)

    def _start(self, now_ns: int, situation: Situation, T_odom_base: SE2) -> Decision:
        """Drive straight until the SLAM has found its two frames (paper 3.1)."""
        if situation.slam_state.tracked:
            self._log.enter(now_ns, MissionState.MAPPING, "the map is initialised")
            return self._map(now_ns, situation)
        if situation.slam_state is TrackingState.LOST:
            return self._look_for_a_place(now_ns, "there is a map: looking for a place of it")
        if situation.navigation is NavigationState.ACTIVE:
            return self._answer(Action.WAIT, "driving straight to start the map: " + situation.slam_reason)
        if now_ns < self._wait_until_ns:
            return self._answer(Action.WAIT, "waiting for the map to start")
        drive = self._initialization_drives.next(situation.slam_reason)
        if drive is None:
            return self._end(now_ns, Outcome.NOT_STARTED, f"the map did not start: {situation.slam_reason}")
        self._wait_until_ns = now_ns + _SECOND_NS
        return self._go(now_ns, T_odom_base @ SE2(drive[0], 0.0, 0.0), "odom", drive[1])

    def _look_for_a_place(self, now_ns: int, reason: str) -> Decision:
        """A map that was made before: first the camera must recognise it, then the robot looks for it."""
        self._recovery.begin(now_ns)
        self._has_gone = True
        self._wait_until_ns = now_ns + _RECOGNISE_WAIT_NS
        self._log.enter(now_ns, MissionState.RECOVERING, reason)
        return self._answer(Action.WAIT, reason)

    def _map(self, now_ns: int, situation: Situation) -> Decision:
        """Choose a view, wait until it is reached, choose the next."""
        if situation.slam_state is TrackingState.LOST:
            self._goal_failed(now_ns, "tracking was lost on the way")
            self._backing_off = False
            self._recovery.begin(now_ns)
            self._wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
            self._log.enter(now_ns, MissionState.RECOVERING, f"tracking lost: {situation.slam_reason}")
            return self._answer(Action.CANCEL, "tracking lost")
        if not situation.hazard:
            self._blocked = 0
        if situation.navigation is NavigationState.ACTIVE:
            return self._supervise(now_ns, situation)
        if situation.navigation is NavigationState.ABORTED and (self._goal is not None or self._backing_off):
            self._goal_failed(now_ns, self._stopped_for or situation.navigation_reason)
            self._backing_off = False
            self._wait_until_ns = now_ns + (_HOME_AGAIN_NS if self._home.asked else _SETTLE_NS)
            return self._answer(Action.WAIT, "coming to rest")
        if now_ns < self._wait_until_ns:
            return self._answer(Action.WAIT, "coming to rest")
        if situation.hazard:
            return self._leave(now_ns, situation, situation.hazard)
        self._backing_off = False
        if self._home.asked and self._goal is not None:
            return self._end(now_ns, Outcome.HOME, "returned to the start")
        if self._goal is not None:
            self.view_selector.viewpoints.poses.append(self._goal.pose)
        self._goal = self._gain = None
        if situation.grid is None or situation.T_map_base is None:
            return self._answer(Action.WAIT, "waiting for the ground map")
        return self._choose(now_ns, situation, situation.grid, situation.T_map_base)

    def _supervise(self, now_ns: int, situation: Situation) -> Decision:
        if situation.hazard and not self._backing_off:
            if not self._stopped_for:
                self._stopped_for = situation.hazard
                self._log.note(now_ns, f"stopping: {situation.hazard}")
            return self._answer(Action.CANCEL, f"stopping: {situation.hazard}")
        if self._home.asked and self._goal is None and not self._backing_off:
            return self._rest(now_ns, True, "leaving the goal to drive home")
        reason = self._gain.why_obsolete(situation.grid) if self._gain and situation.grid is not None else ""
        if not reason:
            return self._answer(Action.WAIT, f"on the way: {self._purpose}")
        return self._rest(now_ns, True, reason)

    def _rest(self, now_ns: int, active: bool, reason: str) -> Decision:
        """Leave the goal, without blame, and come to rest."""
        self._goal = self._gain = None
        self._backing_off = False
        self._wait_until_ns = now_ns + _BRAKE_NS
        self._log.note(now_ns, reason)
        return self._answer(Action.CANCEL if active else Action.WAIT, reason)

    def _choose(self, now_ns: int, situation: Situation, grid: OccupancyGrid, T_map_base: SE2) -> Decision:
        if self._home.asked and self._home.pose is not None:
            if self._home.out_of_reach:
                return self._end(now_ns, Outcome.STRANDED, self._home.out_of_reach)
            self._goal = View(self._home.pose, 0.0, 0.0, 0, 0.0)
            return self._go(now_ns, self._goal.pose, "map", "driving home")
        views = self.view_selector.rank(now_ns, T_map_base, grid, situation.landmarks_world).views
        if not views:
            return self._nothing_left(now_ns, situation, grid)
        self._empty_rankings, self._has_gone = 0, True
        self._goal = goal = views[0]
        self._gain = self.view_selector.expected_gain(goal, grid)
        return self._go(now_ns, goal.pose, "map", goal.words(self._config.stop_cost_m))

    def _nothing_left(self, now_ns: int, situation: Situation, grid: OccupancyGrid) -> Decision:
        """No view is worth its way: try again what failed, look from elsewhere; only where all of the ground is within
        reach, or nothing helps, is it explored."""
        ranking, blacklist = self.view_selector.ranking, self.view_selector.blacklist
        why, boxed_in = ranking.why(), ranking.boxed_in()
        self._empty_rankings += 1
        self._wait_until_ns = now_ns + _EMPTY_WAIT_NS
        if ranking.rejected[Rejection.BLACKLISTED] and blacklist.release(now_ns):
            self._log.note(now_ns, f"no other view found ({why}): what was given up is tried again")
            return self._answer(Action.WAIT, "trying again what was given up")
        if self._empty_rankings > (self._config.retries_boxed_in if boxed_in else self._config.retries_without_view):
            if boxed_in and not self._has_gone:
                return self._end(now_ns, Outcome.BOXED_IN, f"no view can be driven to from the start ({why})")
            return self._end(now_ns, Outcome.EXPLORED, f"no view is worth its way any more ({why})")
        if boxed_in and self._empty_rankings > self._config.retries_without_view:
            reason, ahead = f"no view found ({why}): turning to look elsewhere", self._empty_rankings % 2 == 1
            return self._escape(now_ns, situation, grid, reason, ahead)
        return self._back_off(now_ns, f"no view found ({why}): looking again from further back")

    def _leave(self, now_ns: int, situation: Situation, hazard: str) -> Decision:
        """Away from what was touched: along the trail, or, where there is none or it did not help, over free ground."""
        self._blocked += 1
        if self._blocked > _MOST_BLOCKED:
            return self._end(now_ns, Outcome.BLOCKED, f"a hazard that stays: {hazard}")
        along_trail = self._blocked % 2 == 1 and len(self._trail) > 1
        if along_trail or situation.grid is None or situation.T_map_base is None:
            return self._back_off(now_ns, f"backing off: {hazard}")
        escape = self._escape(now_ns, situation, situation.grid, f"turning away: {hazard}", self._blocked % 4 == 0)
        self._backing_off = escape.action is Action.GO
        return escape

    def _escape(self, now_ns: int, situation: Situation, grid: OccupancyGrid, reason: str, ahead: bool) -> Decision:
        """A short arc ahead or back, so that the camera turns; where all is blocked, back along the trail; without one,
        and without a hazard, on the spot."""
        assert situation.T_map_base is not None
        assert situation.T_odom_base is not None
        step_m = self._config.backtrack_step_m
        arc = escape_arc(grid, situation.T_map_base, self._body_m, self._phi_rad_m, step_m, ahead)
        if arc is None and (len(self._trail) > 1 or situation.hazard):
            return self._back_off(now_ns, reason)
        return self._go(now_ns, situation.T_odom_base @ (arc or SPOT_TURN), "odom", reason)

    def _back_off(self, now_ns: int, reason: str) -> Decision:
        """A step back along the ground just driven: the only way that is surely free."""
        goal = self._trail.back(self._config.backtrack_step_m)
        if goal is None:
            self._wait_until_ns = now_ns + _EMPTY_WAIT_NS
            return self._answer(Action.WAIT, "no way back along the trail")
        self._backing_off = True
        return self._go(now_ns, goal, "odom", reason)

    def _recover(self, now_ns: int, situation: Situation) -> Decision:
        """Wait for relocalisation, then drive to where it is more likely, step by step."""
        tracked = situation.slam_state.tracked
        if situation.navigation is NavigationState.ACTIVE:
            self._wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
            return self._answer(Action.WAIT, f"on the way: {self._purpose}")
        if self._recovery.is_over(now_ns, tracked):
            self._wait_until_ns = now_ns
            self._log.enter(now_ns, MissionState.MAPPING, "relocalised")
        if tracked and not self._recovery.owes_a_step:
            return self._answer(Action.WAIT, "a place of the map is recognised")
        if now_ns < self._wait_until_ns:
            return self._answer(Action.WAIT, "waiting for relocalisation")
        self._wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
        drive = self._recovery.next(self._trail, situation)
        if drive is not None:
            return self._go(now_ns, drive[0], "odom", drive[1])
        return self._end(now_ns, Outcome.LOST, f"tracking lost for good: {situation.slam_reason}")

    # Bookkeeping ---------------------------------------------------------------------------------------------

    def _goal_failed(self, now_ns: int, reason: str) -> None:
        if self._goal is not None and self._home.asked:
            self._log.note(now_ns, self._home.failed(reason))
        elif self._goal is not None:
            seconds = self.view_selector.blacklist.add(now_ns, self._goal.pose)
            self._log.note(now_ns, f"goal given up for {seconds:.0f} s: {reason}")
        self._goal = self._gain = None

    def _end(self, now_ns: int, outcome: Outcome, reason: str) -> Decision:
        self._log.finish(now_ns, outcome, reason)
        return self._answer(Action.FINISH, reason)

    def _go(self, now_ns: int, goal: SE2, frame: str, reason: str) -> Decision:
        self._purpose, self._stopped_for = reason, ""
        self._log.note(now_ns, reason)
        return Decision(Action.GO, goal, frame, self.state.value, reason)

    def _answer(self, action: Action, reason: str) -> Decision:
        return Decision(action, None, "map", self.state.value, reason)
