"""The whole explorer as one object with one main method: a frame and the odometry in, a velocity out.

This is the lock-step run (``vsx explore --fast``), and shows what the ROS nodes do together."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.dense.densify import DenseMap, Densifier, update_every_s
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.exploration.decision import Action, Decision, NavigationState, SavedMission, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.view import view_rad, with_view
from vsx_ros.navigation.navigator import ComputingTime, GoalPlanner, Navigator
from vsx_ros.occupancy.anchored_poses import KeyframePlaces
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.planner import Planner
from vsx_ros.robot import Frame, Odometry, OdometryEpochs, OperatorHold, VelocityCommand
from vsx_ros.session import SlamSession
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import MapSnapshot, SlamMap
from vsx_ros.slam.state import TrackingResult

_MAP_EVERY_NS = 500_000_000  # emulated; SLAM adds a keyframe or two in that time


class StepResult(NamedTuple):
    """The result of one step: the command for the wheels, the tracking result, the mission's decision if it made one,
    and the distance of the base from the plan [m] if there is one."""

    command: VelocityCommand
    tracking: TrackingResult
    decision: Decision | None
    follow_error_m: float | None


class SavedSystem(NamedTuple):
    """What another session needs to continue: the map, the counts and driven ground as arrays by name, and the
    mission's data."""

    slam_map: SlamMap
    state: dict[str, NDArray[Any]]
    mission: SavedMission


class ExplorationSystem:
    """SLAM, dense map, ground map, mission, planner and follower in lock-step: same frames, same seed, same bits."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3, config: Config, seed: int, planner: str = "fov",
        saved: SavedSystem | None = None, slam_map: SlamMap | None = None,
    ) -> None:  # fmt: skip
        """saved: a run to continue; the base stands where it stood. slam_map: a map to continue; the base may be
        anywhere in it. Raises CalibrationError when either was made with another camera or mount, InputError when the
        saved data is damaged."""
        self._config = config = with_view(config, view_rad(camera))
        self.planner = GoalPlanner(config, planner, seed)
        self._computing_time = ComputingTime(config.computing)
        self._densifier = Densifier(camera, T_base_cam, config.dense, seed) if config.dense.enabled else None
        self._epochs = OdometryEpochs()
        self.odometry = Odometry(0, SE2())
        self._decided: tuple[int, Decision] | None = None
        self._mapped, self._zoned = (-1, 0, 0), 0
        self._decide_every_ns = round(1e9 * config.exploration.decide_s)
        self._next_map_ns = self._next_dense_ns = self._next_decision_ns = 0
        continued = (slam_map, None) if saved is None else (saved.slam_map, saved.state)
        self.session = SlamSession(T_base_cam, config, *continued)
        self.slam = self.session.begin(SequentialSlam, camera, seed)
        self.ground = self.session.ground
        self.navigator = Navigator(config, self.planner, self._computing_time)
        ways = Planner(config.planner, config.robot)
        self.mission = Mission(config, ways.travel_costs)
        self.grid: OccupancyGrid | None = None
        self._without_zones: tuple[OccupancyGrid, int] | None = None  # and when it was made [ns]
        self._keyframes: KeyframePlaces | None = None
        self.dense: DenseMap | None = None
        self._saved = None if saved is None else saved.mission
        while self._densify(self.slam.snapshot()):  # process all of an earlier map
            pass

    def step(
        self, frame: Frame, odometry: Odometry, hazard: str | None = None, held: OperatorHold | None = None
    ) -> StepResult:
        """Track the frame, refresh the map, decide, and return the command for the wheels. hazard: a pressed bumper.
        held: the operator holds the wheels, and the command is not obeyed."""
        return self.act(self.track(frame, odometry), hazard, held)

    def track(self, frame: Frame, odometry: Odometry) -> TrackingResult:
        """The first half of ``step``. Odometry enters the system here."""
        self.odometry = self._epochs.enter(odometry)
        return self.session.track(frame, self.odometry)

    def act(self, tracking: TrackingResult, hazard: str | None = None, held: OperatorHold | None = None) -> StepResult:
        """The second half of ``step``, after tracking. Poses, decisions and plans are known only after their computing
        time (``ComputingTime``)."""
        now_ns, odometry = tracking.stamp_ns, self.odometry
        where = self.session.locate(tracking, odometry, self._computing_time.frame_ns())
        if hazard:
            self.session.bumped(self.session.base_at(odometry))  # also before there is a map
        self._refresh_map(now_ns)
        decision = None
        if self._decided is None and now_ns >= self._next_decision_ns:
            self._next_decision_ns = now_ns + self._decide_every_ns
            if self._saved is not None:
                self.mission.restore(now_ns, self._saved, odometry.T_odom_base)
                self._saved = None
            decision = self._decide(now_ns, odometry.T_odom_base, where, hazard, held)
        self._carry_out(now_ns)
        followed = self.navigator.step(
            now_ns, where, frozenset([hazard] if hazard else []), held.words() if held else ""
        )
        error_m = math.hypot(followed.error.x, followed.error.y) if followed.error is not None else None
        return StepResult(followed.command, tracking, decision, error_m)

    def surface_points(self) -> Points3:
        """(N, 3) surface points of the dense map, in the present map [m]."""
        spots = self.ground.dense
        return spots.surfaces(self.slam.snapshot()).points if spots is not None else np.zeros((0, 3))

    def _refresh_map(self, now_ns: int) -> None:
        if self._zoned != self.ground.zones.version:
            self._lay_zones()  # at once: the robot may be about to drive into a new zone
        if now_ns < self._next_map_ns:
            return
        snapshot = self.slam.snapshot()
        denser = now_ns >= self._next_dense_ns and self._densify(snapshot)
        known = (snapshot.version, *self.ground.counts[1:])
        if self.grid is not None and not denser and known == self._mapped:
            return
        if denser:
            self._next_dense_ns = now_ns + round(1e9 * update_every_s(len(snapshot.keyframe_ids)))
        self._next_map_ns = now_ns + _MAP_EVERY_NS
        self._mapped = known
        self._keyframes = KeyframePlaces.of(snapshot.rays.ids, snapshot.rays.T_world_cams)
        self._without_zones = self.ground.grid(snapshot), now_ns
        self._lay_zones()
        self.planner.take_landmarks(snapshot.points_world, now_ns)

    def _lay_zones(self) -> None:
        """Plan in the newest ground map, with the present zones on it."""
        if self._without_zones is None:
            return
        self._zoned = self.ground.zones.version
        ground, made_ns = self._without_zones
        self.grid = self.ground.zoned(ground, self.slam.snapshot())
        self.planner.take_grid(self.grid, made_ns)

    def _densify(self, snapshot: MapSnapshot) -> bool:
        """Update the dense map; returns whether there was work: a new keyframe, or work left from the last one."""
        if self._densifier is None or not len(snapshot.keyframe_ids):
            return False
        if self.dense is not None and not self.dense.is_due(snapshot):
            return False
        self.dense = self._densifier.update(snapshot)
        self.ground.dense = AnchoredSurface.of(self.dense, snapshot, self._config.dense.cell_m)
        return True

    def _decide(
        self, now_ns: int, T_odom_base: SE2, where: LocalizationState, hazard: str | None, held: OperatorHold | None
    ) -> Decision:
        ranked_before = self.mission.view_selector.ranking
        situation = Situation(
            slam_state=where.slam_state, slam_reason=where.slam_reason,
            T_map_base=where.T_map_base, T_odom_base=T_odom_base, odom_epoch=where.odom_epoch,
            grid=self.grid, landmarks_world=self.slam.snapshot().points_world,
            navigation=self.navigator.state, navigation_reason=self.navigator.reason,
            hazard=hazard or where.stuck or None, held=held, keyframes=self._keyframes,
        )  # fmt: skip
        decision = self.mission.decide(now_ns, situation)
        cost_ns = 0
        if self.grid is not None and self.mission.view_selector.ranking is not ranked_before:
            cost_ns = self._computing_time.ranking_ns(self.grid)
        self._decided = now_ns + cost_ns, decision
        return decision

    def _carry_out(self, now_ns: int) -> None:
        """Carry out the last decision after its computing time; until then the mission makes no other."""
        if self._decided is None or now_ns < self._decided[0]:
            return
        decision, self._decided = self._decided[1], None
        if decision.action is Action.GO and decision.goal is not None:
            self.navigator.go(now_ns, decision.goal, decision.frame)
        elif decision.action in (Action.CANCEL, Action.FINISH) and self.navigator.state is NavigationState.ACTIVE:
            self.navigator.cancel(now_ns)
