"""Plans are made on a thread of their own, so that who drives is watched meanwhile."""

import queue
import threading
import time

import rospy
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float32

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.navigation.goal_execution import PlanRequest
from vsx_ros.navigation.goal_planner import GoalPlanner, TimedPlan
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Plan, Refusal
from vsx_ros.ros import clock, convert, frames, threads, topics
from vsx_ros.ros.adjustable import serve_adjustable
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.ros.diagnostics import OK, Diagnostics

_PLAN_STEP_M = 0.05


class PlanningThread:
    """Subscribers: map, vslam/map_points. Publishers: move_base/stats/plan_ms. Services: move_base/make_plan."""

    def __init__(self, config: Config, diagnostics: Diagnostics) -> None:
        """Raises ConfigError for a ~planner that there is not."""
        kind, seed = str(rospy.get_param("~planner", "fov")), int(rospy.get_param("~seed", 0))
        self._planner, self._diagnostics = GoalPlanner(config, kind, seed), diagnostics
        warm_up()
        self._lock = threading.Lock()
        self._requests: queue.SimpleQueue[PlanRequest] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[tuple[int, TimedPlan | Refusal]] = queue.SimpleQueue()
        self._plan_ms_pub = rospy.Publisher(topics.PLAN_MS, Float32, queue_size=10, latch=True)
        subscribe(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)
        subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        rospy.Service(topics.MAKE_PLAN, GetPlan, self._on_make_plan)
        threads.worker("planner", self._work)
        serve_adjustable(config, self._change)

    @property
    def grid(self) -> OccupancyGrid | None:
        """The newest map."""
        return self._planner.grid

    def ask(self, request: PlanRequest) -> None:
        """Begin with this plan when the one under way is made; others that wait are not wanted any longer."""
        if request.again:
            rospy.logwarn("planning again: %s", request.again)
        self._requests.put(request)

    def answers(self) -> list[tuple[int, TimedPlan | Refusal]]:
        """What was found since the last call, each with the number of its request."""
        return [self._answers.get() for _ in range(self._answers.qsize())]

    def _work(self) -> None:
        while not threads.is_ending():
            request = self._requests.get()
            while not self._requests.empty():
                request = self._requests.get()
            self.make(request)

    def make(self, request: PlanRequest) -> None:
        """Make a plan, here."""
        began_s = time.monotonic()
        with self._lock:
            answer = self._planner.timed(request.start, request.goal, request.frame)
        self._answers.put((request.number, answer))
        elapsed_ms = 1e3 * (time.monotonic() - began_s)
        self._plan_ms_pub.publish(elapsed_ms)
        self._diagnostics.set("planner", OK, f"last plan took {elapsed_ms:.0f} ms")

    def _change(self, config: Config) -> None:
        with self._lock:
            self._planner.change(config)

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        self._planner.take_grid(convert.grid(msg), msg.header.stamp.to_nsec())

    def _on_points(self, msg: PointCloud2) -> None:
        self._planner.take_landmarks(convert.cloud_points(msg), msg.header.stamp.to_nsec())

    def _on_make_plan(self, request: GetPlanRequest) -> GetPlanResponse:
        start, goal = ((frames.bare(p.header.frame_id), convert.se2(p.pose)) for p in (request.start, request.goal))
        with self._lock:
            plan = self._planner.plan_between(start, goal)
        if isinstance(plan, Refusal):
            rospy.logwarn("make_plan: %s", plan.reason)
            return GetPlanResponse()
        return GetPlanResponse(path_msg(plan, goal[0]))


def path_msg(plan: Plan, frame: str) -> PathMsg:
    """The way of a plan in ``frame``, every few centimetres."""
    poses = [SE2(*row[:3]) for row in plan.path.sample(_PLAN_STEP_M).tolist()]
    return convert.path_msg(frame, clock.now_ns(), poses)
