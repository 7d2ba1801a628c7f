"""Decides what to do next. One state machine for the robot, the emulator and the lock-step run.

            +--------> STARTING ----(map initialised)----> MAPPING --(no view worth its way)--> DONE
            |            | attempts used up                 |  ^
            |            v                             LOST |  | relocalised
            |           DONE                                v  |
            |                                            RECOVERING --(nothing left to try)--> DONE
            +--- STARTING: in a map made before --> RECOVERING
            +--- MAPPING: home, out of reach, a hazard that stays; any state: stop --> DONE

From any state operator or dock may pause it (PAUSED; also who cancels its drive), the operator hold the wheels (HELD:
emergency stop, teleop) or send the robot elsewhere (USER GOAL), or images be missing (BLIND; for long: DONE); then it
resumes in the earlier state, nothing is blamed. ``decide`` returns one action. Changes and choices are events."""

from vsx_ros.config import Config
from vsx_ros.exploration.claims import CancelWatch, Claim, claim_of, why_over
from vsx_ros.exploration.decision import (
    DOCK,
    OPERATOR,
    SECOND_NS,
    Action,
    Decision,
    MissionEvent,
    MissionLog,
    MissionState,
    NavigationState,
    Outcome,
    SavedMission,
    Situation,
)
from vsx_ros.exploration.home import Home
from vsx_ros.exploration.recovery import Recovery, Trail
from vsx_ros.exploration.start_drives import StartDrives
from vsx_ros.exploration.utility import TravelCostsFrom
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.exploration.view_tour import BRAKE_NS, ViewTour
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import ODOM_FRAME
from vsx_ros.slam.state import TrackingState

_RELOCALISE_WAIT_NS, _RECOGNISE_WAIT_NS = SECOND_NS, 5 * SECOND_NS  # for the camera: after each drive; before the first
_YIELDING = MissionState.HELD, MissionState.USER_GOAL, MissionState.BLIND
_IMAGES_WAIT_S = 60.0  # for images to come again; then a device has failed
_RACE_NS = SECOND_NS  # a drive may be told as failed before it is told that the operator has ended it


class Mission:
    """Explores until no view is worth its drive, and recovers when lost; gives a reason for everything."""

    def __init__(self, config: Config, travel_costs: TravelCostsFrom) -> None:
        exploration = config.exploration
        self._log, self._home, self._trail, self._cancels = MissionLog(), Home(), Trail(spacing_m=0.05), CancelWatch()
        self.view_selector = ViewSelector(config, travel_costs)
        self._start_drives, self._stay_at_user_goal = StartDrives(exploration), exploration.stay_at_user_goal
        self._tour = ViewTour(config, self._log, self._home, self._trail, self.view_selector)
        self._recovery = Recovery(config, self.view_selector)
        self._after_pause, self.paused_by, self._why = MissionState.STARTING, set[str](), ""  # who has not resumed it

    @property
    def state(self) -> MissionState:
        """The present box of the diagram."""
        return self._log.state

    @property
    def outcome(self) -> Outcome | None:
        """How the mission ended; None before."""
        return self._log.outcome

    def drain_events(self) -> list[MissionEvent]:
        """The events since the last call."""
        return self._log.drain()

    # Requests of the operator -------------------------------------------------------------------------------

    def pause(self, now_ns: int, by: str = OPERATOR, why: str = "") -> None:
        """Stand still until all who paused have resumed. why: for people."""
        self.paused_by.add(by)
        self._why = why if by == OPERATOR else self._why
        if self.state not in (MissionState.DONE, MissionState.PAUSED):
            if self.state not in _YIELDING:
                self._after_pause = self.state
            self._tour.forget_drive()
            self._log.enter(now_ns, MissionState.PAUSED, why or f"paused by {by}")

    def resume(self, now_ns: int, by: str = OPERATOR) -> None:
        """Continue after a pause, unless another one holds."""
        self.paused_by.discard(by)
        if self.state is MissionState.PAUSED and not self.paused_by:
            self._log.enter(now_ns, self._after_pause, f"resumed by {by}")

    def stop(self, now_ns: int, by: str = OPERATOR) -> None:
        """End the mission here."""
        self._log.finish(now_ns, Outcome.STOPPED, f"stopped by {by}")

    def home(self, now_ns: int, by: str = OPERATOR) -> None:
        """Drive back to where the exploration began, then end. No effect once the mission has ended."""
        if self.state is not MissionState.DONE:
            self._home.asked = True
            self._tour.forget_goal()
            self._log.note(now_ns, f"returning home on request of {by}")

    # An interruption ----------------------------------------------------------------------------------------

    def to_save(self, now_ns: int, T_odom_base: SE2, odom_epoch: int) -> SavedMission:
        """What another session needs to continue from here. odom_epoch: that of T_odom_base."""
        trail = self._trail.behind(T_odom_base, odom_epoch)
        looked_from, blacklist = list(self.view_selector.looked_from), self.view_selector.blacklist.left(now_ns)
        going_home, paused = self._home.asked and self.state is not MissionState.DONE, OPERATOR in self.paused_by
        return SavedMission(looked_from, blacklist, trail, going_home=going_home, home=self._home.pose, paused=paused)

    def restore(self, now_ns: int, saved: SavedMission, T_odom_base: SE2) -> None:
        """Continue in the map of an earlier session, at the end of its trail; first the camera must recognise the map.
        If it was paused, before or meanwhile, it waits for ``resume``; if stopped meanwhile, it only takes the data."""
        pausers = self.paused_by | ({OPERATOR} if saved.paused else set())
        self.view_selector.looked_from = list(saved.looked_from)
        self._home.pose, self._home.asked = saved.home, saved.going_home or self._home.asked
        self.view_selector.blacklist.restore(now_ns, saved.blacklist)
        for pose in saved.trail:
            self._trail.add(T_odom_base @ pose)
        if self.state is MissionState.DONE:
            return
        self._look_for_a_place(now_ns, "resumed: looking for a place of the known map")
        for by in pausers:
            self.pause(now_ns, by)

    # The decision --------------------------------------------------------------------------------------------

    def decide(self, now_ns: int, situation: Situation) -> Decision:
        """One action for the situation. Call it at 2 to 10 Hz; choosing a view takes some tenths of a second."""
        situation, cancelled = self._cancels.seen(situation)
        backing = self._tour.backing_off or (self.state is MissionState.RECOVERING and self._recovery.is_on_trail)
        restarted = situation.T_odom_base is not None and self._trail.enter_epoch(situation.odom_epoch)
        self._recovery.observe(situation, self._trail)
        if situation.T_odom_base is not None:
            (self._trail.driven_back_to if backing else self._trail.add)(situation.T_odom_base)
        self._tour.observe(situation)
        if self.state is MissionState.DONE:
            return self._log.answer(Action.FINISH, self._log.reason)
        active, claim = situation.navigation is NavigationState.ACTIVE, claim_of(now_ns, situation)
        if cancelled and claim is None:
            self.pause(now_ns, why=cancelled)
        if self.state is MissionState.PAUSED:
            self._start_drives.interrupt(situation.navigation)
            told = (self._why or "paused") if OPERATOR in self.paused_by else f"paused by {DOCK}"
            reason = told if claim is None else f"{told}; {claim.reason}"
            if claim is not None and self._log.reason != reason:
                self._log.note(now_ns, reason)
            return self._log.answer(Action.CANCEL if active else Action.WAIT, reason)
        if situation.T_odom_base is None:
            return self._log.answer(Action.WAIT, "waiting for odometry")
        if restarted or situation.navigation is NavigationState.LOST:
            self._start_drives.interrupt(situation.navigation)
        if restarted:
            return self._tour.rest(now_ns, active, "odometry restarted: coming to rest")
        if claim is not None:
            return self._yield(now_ns, situation, claim)
        if self.state in _YIELDING:
            return self._take_over(now_ns, situation)
        if self.state is MissionState.STARTING:
            return self._start(now_ns, situation, situation.T_odom_base)
        if self.state is MissionState.RECOVERING:
            return self._recover(now_ns, situation)
        if situation.slam_state is TrackingState.LOST:
            return self._lose(now_ns, situation)
        return self._tour.decide(now_ns, situation)

    # What comes before it ------------------------------------------------------------------------------------

    def _yield(self, now_ns: int, situation: Situation, claim: Claim) -> Decision:
        """Leave the robot to a claim. What failed since, or just before it was told, was nobody's fault."""
        if self.state not in _YIELDING:
            self._start_drives.interrupt(situation.navigation)
            self._after_pause = self.state
            self._tour.withdraw(min(claim.since_ns, now_ns) - _RACE_NS)
            self._tour.forget_drive()
        if self.state is not claim.state:
            self._log.enter(now_ns, claim.state, claim.reason)
        if claim.state is MissionState.BLIND and situation.blind_s > _IMAGES_WAIT_S:
            told = f"no images for {_IMAGES_WAIT_S:g} s: check camera and vslam"
            return self._log.finish(now_ns, Outcome.BLIND, told)
        stop = claim.state is not MissionState.USER_GOAL and situation.navigation is NavigationState.ACTIVE
        return self._log.answer(Action.CANCEL if stop else Action.WAIT, claim.reason)

    def _take_over(self, now_ns: int, situation: Situation) -> Decision:
        """Go on after a claim, at rest."""
        reason = why_over(self.state, situation)
        self._log.wait_until_ns = now_ns + BRAKE_NS
        if self.state is MissionState.USER_GOAL and self._stay_at_user_goal:
            self.pause(now_ns, why=f"{reason}; staying here until resumed")
            return self._log.answer(Action.WAIT, self._log.reason)
        if self._after_pause is MissionState.RECOVERING:
            self._recovery.begin(now_ns)
        self._log.enter(now_ns, self._after_pause, f"{reason}: the exploration goes on")
        return self._log.answer(Action.WAIT, self._log.reason)

    def _start(self, now_ns: int, situation: Situation, T_odom_base: SE2) -> Decision:
        """Drive until SLAM has found its two frames (paper 3.1)."""
        if situation.slam_state.tracked:
            self._log.enter(now_ns, MissionState.MAPPING, "the map is initialised")
            return self._tour.decide(now_ns, situation)
        if situation.slam_state is TrackingState.LOST:
            return self._look_for_a_place(now_ns, "there is a map: looking for a place of it")
        if situation.navigation is NavigationState.ACTIVE:
            return self._log.answer(Action.WAIT, "driving to start the map: " + situation.slam_reason)
        if now_ns < self._log.wait_until_ns:
            return self._log.answer(Action.WAIT, "waiting for the map to start")
        drive = self._start_drives.next(situation.slam_reason)
        if drive is None:
            refused = situation.navigation is NavigationState.ABORTED and situation.navigation_reason
            why = f"{refused}; {situation.slam_reason}" if refused else situation.slam_reason
            return self._log.finish(now_ns, Outcome.NOT_STARTED, f"the map did not start: {why}")
        self._log.wait_until_ns = now_ns + SECOND_NS
        return self._log.go(now_ns, T_odom_base @ drive[0], ODOM_FRAME, drive[1])

    def _look_for_a_place(self, now_ns: int, reason: str) -> Decision:
        """With an earlier map: wait for the camera to recognise it, then drive to look for it."""
        self._recovery.begin(now_ns)
        self._tour.has_gone = True
        self._log.wait_until_ns = now_ns + _RECOGNISE_WAIT_NS
        self._log.enter(now_ns, MissionState.RECOVERING, reason)
        return self._log.answer(Action.WAIT, reason)

    def _lose(self, now_ns: int, situation: Situation) -> Decision:
        """Stand still: the camera may be relocalised."""
        self._tour.goal_failed(now_ns, "tracking was lost on the way")
        self._recovery.begin(now_ns)
        self._log.wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
        self._log.enter(now_ns, MissionState.RECOVERING, f"tracking lost: {situation.slam_reason}")
        return self._log.answer(Action.CANCEL, "tracking lost")

    def _recover(self, now_ns: int, situation: Situation) -> Decision:
        """Wait for relocalisation, then drive to where it is more likely, step by step."""
        tracked = situation.slam_state.tracked
        if situation.navigation is NavigationState.ACTIVE:
            self._log.wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
            return self._log.on_the_way()
        if self._recovery.is_over(now_ns, tracked):
            self._log.wait_until_ns = now_ns
            self._log.enter(now_ns, MissionState.MAPPING, "relocalised")
        if tracked and not self._recovery.owes_a_step:
            return self._log.answer(Action.WAIT, "a place of the map is recognised")
        if now_ns < self._log.wait_until_ns:
            return self._log.answer(Action.WAIT, "waiting for relocalisation")
        self._log.wait_until_ns = now_ns + _RELOCALISE_WAIT_NS
        drive = self._recovery.next(self._trail, situation)
        if drive is not None:
            return self._log.go(now_ns, drive[0], ODOM_FRAME, drive[1])
        if tracked:
            return self._log.answer(Action.WAIT, "a place of the map is recognised")
        return self._log.finish(now_ns, Outcome.LOST, f"tracking lost for good: {situation.slam_reason}")
