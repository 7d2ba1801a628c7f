"""A base that drives to goals over a floor on which things come to light, as lock-step drives it."""

from collections import deque
from typing import NamedTuple

import numpy as np

from vsx_ros.config import ComputingConfig, Config
from vsx_ros.control.localization import Localization, LocalizationState
from vsx_ros.geometry.se2 import SE2, integrate
from vsx_ros.navigation.navigator import ComputingTime, GoalPlanner, Navigator
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.robot import STOP, Odometry, VelocityCommand
from vsx_ros.slam.state import TrackingState

PLAN_MS = 200.0
CONFIG = Config(computing=ComputingConfig(plan_ms=PLAN_MS, plan_ms_m=0.0))
FRAME_NS = 66_666_667
POSE_LATE_NS = 60_000_000
_STEP_NS, _DEAD_TIME_NS, _LAG_S = 5_000_000, 60_000_000, 0.08
_OPEN = OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, -4.0, -4.0)


def open_floor() -> OccupancyGrid:
    """8 m x 8 m without anything on it, the origin in its middle: a new map each time."""
    return OccupancyGrid(_OPEN.data.copy(), _OPEN.resolution, _OPEN.origin_x, _OPEN.origin_y)


def with_post(x: float, y: float) -> OccupancyGrid:
    """The same with a post of 10 cm around a place [m]."""
    data = _OPEN.data.copy()
    row, column = _OPEN.cells(np.array([[x, y]]))[0]
    data[row - 1 : row + 1, column - 1 : column + 1] = OCCUPIED
    return OccupancyGrid(data, _OPEN.resolution, _OPEN.origin_x, _OPEN.origin_y)


class Scene(NamedTuple):
    """What happens when [s]. goals: pursued from then on; maps: hold from then on; lost: from, to; cancelled: then."""

    goals: tuple[tuple[float, SE2], ...]
    maps: tuple[tuple[float, OccupancyGrid], ...] = ((0.0, open_floor()),)
    lost: tuple[float, float] = (np.inf, np.inf)
    cancelled: float = np.inf

    def state(self, seconds: float) -> TrackingState:
        return TrackingState.LOST if self.lost[0] <= seconds < self.lost[1] else TrackingState.GOOD


class LaggingBase:
    """Wheels that do what they are told 60 ms later, with a lag of 80 ms. rows: time [s], x, y [m], speed [m/s]."""

    def __init__(self) -> None:
        self.now_ns, self.pose = 0, SE2()
        self.rows: list[tuple[float, float, float, float]] = []
        self._v = self._omega = 0.0
        self._wanted = STOP
        self._late: deque[tuple[int, VelocityCommand]] = deque()

    @property
    def odometry(self) -> Odometry:
        return Odometry(self.now_ns, self.pose, self._v, self._omega)

    def tell(self, command: VelocityCommand) -> None:
        self._late.append((self.now_ns + _DEAD_TIME_NS, command))

    def advance(self, until_ns: int) -> None:
        while self.now_ns < until_ns:
            step_ns = min(_STEP_NS, until_ns - self.now_ns)
            self.now_ns += step_ns
            while self._late and self._late[0][0] <= self.now_ns:
                self._wanted = self._late.popleft()[1]
            dt = 1e-9 * step_ns
            self._v += (self._wanted.v - self._v) * dt / _LAG_S
            self._omega += (self._wanted.omega - self._omega) * dt / _LAG_S
            self.pose = integrate(self.pose, self._v * dt, self._omega * dt)
            self.rows.append((1e-9 * self.now_ns, self.pose.x, self.pose.y, self._v))

    def pushed(self, sideways_m: float) -> None:
        self.pose = self.pose @ SE2(0.0, sideways_m, 0.0)


class LockStep:
    """The navigator above such a base, told where it is by odometry and by a camera that is late."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.base, self.localization = LaggingBase(), Localization()
        self.planner = GoalPlanner(config, "fov", 0)
        self.planner.take_grid(open_floor(), 0)
        self.navigator = Navigator(config, self.planner, ComputingTime(config.computing))
        self._seen: deque[tuple[int, SE2]] = deque()
        self.drive(0.2)

    def go(self, goal: SE2, frame: str = "map") -> None:
        self.navigator.go(self.base.now_ns, goal, frame)

    def where(self, state: TrackingState) -> LocalizationState:
        base = self.base
        self._seen.append((base.now_ns, base.pose))
        self.localization.add_odometry(base.odometry)
        while self._seen and self._seen[0][0] + POSE_LATE_NS <= base.now_ns:
            seen = self._seen.popleft()
            self.localization.add_state(state, "")
            if state.tracked:
                self.localization.add_pose(*seen)
        return self.localization.at(base.now_ns)

    def drive(self, seconds: float, state: TrackingState = TrackingState.GOOD) -> None:
        for _ in range(round(seconds * 15)):
            self.base.advance(self.base.now_ns + FRAME_NS)
            self.base.tell(self.navigator.step(self.base.now_ns, self.where(state)).command)


def lock_step(scene: Scene, seconds: float) -> tuple[np.ndarray, LockStep]:
    """The rows of the base over so long, and how it ended."""
    run = LockStep()
    goals, maps, cancelled = list(scene.goals), list(scene.maps), False
    while (now_s := 1e-9 * run.base.now_ns) < seconds:
        while maps and maps[0][0] <= now_s:
            run.planner.take_grid(maps.pop(0)[1], run.base.now_ns)
        while goals and goals[0][0] <= now_s:
            run.go(goals.pop(0)[1])
        if now_s >= scene.cancelled and not cancelled:
            cancelled = True
            run.navigator.cancel(run.base.now_ns)
        run.drive(1.0 / 15.0, scene.state(now_s))
    return np.array(run.base.rows), run
