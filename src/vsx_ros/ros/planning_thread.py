"""Makes plans on a separate thread, so that the drive is monitored meanwhile. Any client of dynamic_reconfigure may
change speed limits and the view bound of the plans while the node runs."""

import math
import queue
import threading
import time
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import rospy
from dynamic_reconfigure.encoding import Config as Values
from dynamic_reconfigure.server import Server
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float32

from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError, VsxError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.navigation.goal_execution import PlanRequest
from vsx_ros.navigation.goal_frames import in_map
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Plan, Refusal, TimedPlan
from vsx_ros.robot import MAP_FRAME
from vsx_ros.ros import convert, headers, threads, topics
from vsx_ros.ros.callbacks import hear_view, subscribe
from vsx_ros.ros.driving import path_msg
from vsx_ros.ros.logs import OK, Diagnostics
from vsx_ros.ros.situation import LocalizationSubscriber
from vsx_ros.ros.zones import ZonedMap


class PlanningThread:
    """Subscribers: map, zones, vslam/map_points, camera/rgb/camera_info. Publishers: move_base/stats/plan_ms. Services:
    move_base/make_plan."""

    def __init__(self, config: Config, diagnostics: Diagnostics, where: LocalizationSubscriber) -> None:
        """Raises ConfigError for an unknown ~planner."""
        kind, seed = str(rospy.get_param("~planner", "fov")), int(rospy.get_param("~seed", 0))
        self._planner, self._diagnostics, self._where = GoalPlanner(config, kind, seed), diagnostics, where
        warm_up("planning")
        self._lock = threading.Lock()
        self._requests: queue.SimpleQueue[PlanRequest] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[tuple[int, TimedPlan | Refusal]] = queue.SimpleQueue()
        self._plan_ms_pub = rospy.Publisher(topics.PLAN_MS, Float32, queue_size=10, latch=True)
        ZonedMap(config, self._planner.take_grid)
        subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        hear_view(self._planner.look_with)
        rospy.Service(topics.MAKE_PLAN, GetPlan, self._on_make_plan)
        threads.worker("planner", self._work)
        serve_adjustable(config, self._change)

    @property
    def grid(self) -> OccupancyGrid | None:
        """The newest map."""
        return self._planner.grid

    def ask(self, request: PlanRequest) -> None:
        """Make this plan after the current one; other waiting requests are dropped."""
        if request.again:
            rospy.logwarn("planning again: %s", request.again)
        self._requests.put(request)

    def answers(self) -> list[tuple[int, TimedPlan | Refusal]]:
        """Results since the last call, each with the number of its request."""
        return [self._answers.get() for _ in range(self._answers.qsize())]

    def way(self, start: SE2, goal: SE2) -> TimedPlan | Refusal:
        """Plan in the newest map on the caller's thread, for nobody to drive. Raises PlanningError for poses that are
        not finite."""
        with self._lock:
            return self._planner.timed(start, goal, MAP_FRAME)

    def _work(self) -> None:
        while not threads.is_ending():
            request = self._requests.get()
            while not self._requests.empty():
                request = self._requests.get()
            self.make(request)

    def make(self, request: PlanRequest) -> None:
        """Plan on this thread."""
        began_s = time.monotonic()
        with self._lock:
            answer = self._planner.timed(request.start, request.goal, request.frame, request.T_map_frame)
        self._answers.put((request.number, answer))
        elapsed_ms = 1e3 * (time.monotonic() - began_s)
        self._plan_ms_pub.publish(elapsed_ms)
        self._diagnostics.set("planner", OK, f"last plan took {elapsed_ms:.0f} ms")

    def _change(self, config: Config) -> None:
        with self._lock:
            self._planner.change(config)

    def _on_points(self, msg: PointCloud2) -> None:
        self._planner.take_landmarks(convert.cloud_points(msg), msg.header.stamp.to_nsec())

    def _on_make_plan(self, request: GetPlanRequest) -> GetPlanResponse:
        """Answers in the map; without poses if there is no plan, and then the log gives the reason."""
        try:
            ends, where = (request.start, request.goal), self._where.at(headers.now_ns())
            start, goal = (in_map(convert.se2(end.pose), headers.bare(end.header.frame_id), where) for end in ends)
            with self._lock:
                plan = self._planner.plan(start, goal, MAP_FRAME)
            if isinstance(plan, Plan):
                return GetPlanResponse(path_msg(plan, MAP_FRAME))
            refusal = plan.reason
        except VsxError as error:
            refusal = str(error)
        rospy.logwarn("make_plan: %s", refusal)
        return GetPlanResponse()


class Adjustable(NamedTuple):
    """One adjustable number. entry: its dotted name in the configuration; value: as configured."""

    entry: str
    value: float
    low: float
    high: float
    meaning: str

    @property
    def name(self) -> str:
        """Its name for clients, and the private parameter that keeps it across a restart of the node."""
        return self.entry.rpartition(".")[2]


def adjustable_of_plans(config: Config) -> list[Adjustable]:
    """What clients may change for later plans. Speeds can be lower than configured, never higher."""
    v, omega, phi = config.limits.v_m_s, config.limits.omega_rad_s, config.planner.phi_rad_m
    return [
        Adjustable("limits.v_m_s", v, 0.05, v, "speed [m/s]"),
        Adjustable("limits.omega_rad_s", omega, 0.1, omega, "turn rate [rad/s]"),
        Adjustable("planner.phi_rad_m", phi, 0.1, 10.0, "bound on the change of view per metre [rad/m]"),
    ]


def serve_adjustable(config: Config, on_change: Callable[[Config], None]) -> Server:
    """Services: ~set_parameters. Publishers: ~parameter_descriptions, ~parameter_updates (latched).

    Calls ``on_change`` with the whole configuration on a separate thread: at once if a private parameter was set
    before, and at each change by a client. Values beyond the bounds are clamped. Raises ConfigError for a private
    parameter that is not a number."""
    numbers = adjustable_of_plans(config)
    applied = {number.name: number.value for number in numbers}
    for number in numbers:
        stored: Any = rospy.get_param(f"~{number.name}", None)
        if stored is None:
            continue
        if type(stored) not in (int, float) or not math.isfinite(stored):
            name = rospy.resolve_name(f"~{number.name}")
            raise ConfigError(f"parameter {name} is {stored!r}; give a number from {number.low:g} to {number.high:g}")
        rospy.set_param(f"~{number.name}", float(stored))

    def change(values: Any, _: int) -> Any:
        wanted = {number.name: float(values[number.name]) for number in numbers}
        if wanted != applied:
            applied.update(wanted)
            on_change(overridden(config, {number.entry: wanted[number.name] for number in numbers}))
            rospy.loginfo("from now on %s", ", ".join(f"{name} = {value:g}" for name, value in wanted.items()))
        values.update(wanted)
        return values

    return Server(_described(numbers), change)


def _described(numbers: Sequence[Adjustable]) -> SimpleNamespace:
    """The content of a module generated from a .cfg file."""
    about = {"type": "double", "level": 1, "edit_method": ""}
    parameters = [{"name": number.name, "description": number.meaning, **about} for number in numbers]
    group = {"name": "Default", "type": "", "id": 0, "parent": 0, "parameters": parameters, "groups": []}
    return SimpleNamespace(
        config_description=group,
        defaults=Values({number.name: number.value for number in numbers}),
        min=Values({number.name: number.low for number in numbers}),
        max=Values({number.name: number.high for number in numbers}),
    )
