"""An emulated base in a room with a dock: bytes between driver and board, planner, follower and docking above them, all
in one process and in simulated time."""

import math
from typing import NamedTuple

import numpy as np

from vsx_hw.bases import BASES
from vsx_hw.readings import Hazard
from vsx_hw.safety import SpeedLimits, Supervisor
from vsx_ros.config import Config
from vsx_ros.control.localization import Localization
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DockSight
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingSeen, DockingState
from vsx_ros.navigation.navigator import ComputingTime, GoalPlanner, Navigator
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.robot import MAP_FRAME, STOP, VelocityCommand
from vsx_ros.ros.base_messages import odometry
from vsx_ros.ros.emulated_base import BodyPlant, housing
from vsx_ros.slam.state import TrackingState

STEP_NS, PERIOD_NS, PATIENCE_NS, FRAME_NS = 5_000_000, 20_000_000, 50_000_000, 66_666_667
AT_DOCK_M = 0.3  # a contact nearer than this is one with the dock
ROOM_M, BEHIND_M = (5.0, 6.0), 0.08  # depth and width; the dock stands so far before a wall
SLAM_M, SLAM_RAD = 0.005, math.radians(0.3)  # noise of one pose; ``Room.bias`` stays


class Room(NamedTuple):
    """start: of the base, in the dock's frame. remembered: the dock, as remembered, in the frame of the true one."""

    start: SE2
    remembered: SE2 = SE2()
    bias: SE2 = SE2()
    widths: float = 1.0
    ranges: float = 1.0
    side_wall_m: float = 2.5  # beside the dock


class _Walls:
    """The part of an emulated world that a body needs. The world's frame is the dock's."""

    def __init__(self, room: Room) -> None:
        self.start_pose = room.start
        self.hard: dict[str, float] = {}
        x0, x1, y0, y1 = -BEHIND_M, ROOM_M[0], room.side_wall_m - ROOM_M[1], room.side_wall_m
        corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        self.segments = np.hstack([corners, np.roll(corners, -1, axis=0)])

    def obstacle_segments(self, z_min: float, z_max: float) -> np.ndarray:
        return self.segments

    def grid(self) -> OccupancyGrid:
        """The room as the map knows it."""
        low, high = self.segments[:, :2].min(axis=0), self.segments[:, :2].max(axis=0)
        shape = np.ceil((high - low) / 0.05).astype(int) + 2
        data = np.full((shape[1], shape[0]), FREE, np.int8)
        data[[0, -1], :] = data[:, [0, -1]] = OCCUPIED
        grid = OccupancyGrid(data, 0.05, low[0] - 0.05, low[1] - 0.05)
        front = housing(SE2())
        dots = np.linspace(front[:, :2], front[:, 2:], 9).reshape(-1, 2)
        rows, columns = grid.cells(dots).T
        data[rows, columns] = OCCUPIED
        return OccupancyGrid(data, 0.05, grid.origin_x, grid.origin_y)


class DockingRobot:
    """``run`` until docking rests. The map's frame is the dock's, but for the bias of SLAM."""

    def __init__(self, kind: str, room: Room, seed: int, config: Config | None = None) -> None:
        self.kind, self.room, self.now_ns = kind, room, 1_000_000_000
        config = config or Config()
        self.rng, walls, base = np.random.default_rng([seed, 3]), _Walls(room), BASES[kind]
        self.plant = BodyPlant(walls, seed, config.robot, lambda state: None, base.wheel_base_m, SE2())
        self.plant.at_dock = self.plant.at_dock._replace(widths=room.widths, ranges=room.ranges)
        self.board, self.dialect = base.board(self.plant, seed), base.dialect(1.0, 1.0)
        self.supervisor = Supervisor(SpeedLimits(0.5, 1.5))
        self.planner = GoalPlanner(config, "unconstrained", seed)
        self.planner.take_grid(walls.grid(), 1)
        self.navigator = Navigator(config, self.planner, ComputingTime(config.computing))
        self.docking, self.localization = Docking(config.docking, seed), Localization()
        self.reading, self.states, self.touches = None, [], 0
        self._sent_ns = self._frame_ns = 0
        self._answered, self._hazards = False, frozenset()
        self._navi, self._navigates = STOP, False
        for data, pause_s in self.dialect.hello():
            self.board.receive(data, self.now_ns)
            for _ in range(math.ceil(pause_s * 1e9 / STEP_NS)):
                self._advance()
        while self.reading is None:
            self._cycle()
        self.localization.add_state(TrackingState.GOOD, "")

    def dock(self, limit_s: float = 300.0) -> DockingState:
        self.docking.dock(self.now_ns, self.kind, self.room.remembered)
        return self.run(limit_s)

    def undock(self, limit_s: float = 20.0, turn_rad: float = 0.0) -> DockingState:
        self.docking.undock(self.now_ns, turn_rad)
        return self.run(limit_s)

    def run(self, limit_s: float) -> DockingState:
        end_ns = self.now_ns + round(limit_s * 1e9)
        while self.now_ns < end_ns and not self.docking.state.rests:
            self._cycle()
        return self.docking.state

    def wait(self, seconds: float) -> None:
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self._cycle()

    @property
    def at(self) -> SE2:
        """The base in the dock's frame."""
        return self.plant.body.T_world_base

    def _advance(self) -> None:
        before = self.plant.body.collisions
        self.plant.advance(STEP_NS)
        at_dock = math.hypot(self.at.x, self.at.y) < AT_DOCK_M
        self.touches += 0 if at_dock else self.plant.body.collisions - before
        self.now_ns += STEP_NS
        data = self.board.emit(self.now_ns)
        for reading in self.dialect.receive(data, self.now_ns) if data else []:
            self._answered = True
            self._take(reading)

    def _cycle(self) -> None:
        """One step of time; the driver sends as ``BaseDriver`` does."""
        self._advance()
        waits = self.dialect.waits() and not self._answered
        if self.now_ns - self._sent_ns >= (PATIENCE_NS if waits else PERIOD_NS):
            decision = self.supervisor.decide(self.now_ns, self.reading.hazards if self.reading else Hazard.NONE)
            self.board.receive(self.dialect.drive(decision.v_m_s, decision.omega_rad_s), self.now_ns)
            self._sent_ns, self._answered = self.now_ns, False

    def _take(self, reading) -> None:
        self.reading = reading
        moved = odometry(reading.odometry)
        self.localization.add_odometry(moved)
        if self.now_ns >= self._frame_ns:
            self._frame_ns = self.now_ns + FRAME_NS
            x, y, turn = self.rng.normal(0.0, (SLAM_M, SLAM_M, SLAM_RAD))
            self.localization.add_pose(moved.stamp_ns, self.room.bias @ self.at @ SE2(x, y, turn))
        where = self.localization.at(self.now_ns)
        hazards = frozenset(flag.name for flag in Hazard if reading.hazards & flag & Hazard.TOUCHED)
        command = self._docked(reading, moved, where, ", ".join(sorted(hazards)))
        if command is None:
            command = self.navigator.step(self.now_ns, where, hazards).command
        self.supervisor.command("navi", *command, self.now_ns)

    def _docked(self, reading, moved, where, hazard: str) -> VelocityCommand | None:
        if not self.states or self.states[-1][1] is not self.docking.state:
            self.states.append((self.now_ns, self.docking.state, self.docking.reason))
        battery = reading.battery
        sight = None if reading.dock is None else DockSight(*map(int, reading.dock[1:]))
        seen = DockingSeen(
            odometry=moved, sight=sight, docked=battery.docked, charging=battery.charging or battery.state == "charged",
            hazard=hazard, T_map_base=where.T_map_base, navigation=self.navigator.state,
            navigation_reason=self.navigator.reason,
        )  # fmt: skip
        act = self.docking.step(self.now_ns, seen)
        if act.goal is not None:
            self.navigator.go(self.now_ns, act.goal, MAP_FRAME)
            self.navigator.state = NavigationState.ACTIVE
        return act.command
