"""A post appears half a metre ahead on the path of a robot that explores at full speed: does it stop in time?

python benchmarks/fault_obstacle.py [--ahead 0.5] [--repetitions 20]

As benchmarks/fault_nodes.py, on the same stack: real nodes and drivers, the emulated body at the far end of the wire.
The post is 10 cm thick. Its near face appears on the path at this distance from the base's centre, while the robot
drives straight on at full speed. The body can hit it. The camera cannot see it: when SLAM maps a new thing is another
question. This program relays ``map`` to the nodes and draws the post into every map from that instant on, like a sensor
that sees it at once. So the measurement begins with a map that shows the post, and ends when the body stands.
A row is one repetition: the body's speed when the post appeared (``speed_m_s``), the true distance of its face
(``ahead_m``), the time until the body stood (``rest_s``; null: not within 5 s), the gap between body and post
then (``left_m``; null: it did not stand), the smallest gap until then (``least_m``), and whether they touched
(``contact``). A trial without contact in which no obstacle was reported is drawn again, because the base left the path
or stopped for another reason; ``redrawn`` has the smallest gap of each of those before this one. Then the post is
removed, and the robot explores on. Existing rows of the present code are not measured again.
"""

import argparse
import math
import threading
import time
from collections import deque, namedtuple
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from exploring_robot import ExploringRobot, new_stack
from msgspec.structs import replace

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.ros.fork_server import Copy, Request
from vsx_ros.sim.moving import Borders

Ahead = namedtuple("Ahead", "ahead_m repetition")
POST_M, SIDES = 0.05, 12  # radius; number of sides
LIMITS, BODY_M = Config().limits, Config().robot.radius_m
FULL_SPEED, STRAIGHT_RAD, BEYOND_M = 0.97, 0.2, 0.3  # share of the limit; to either side; path length behind the post
REST_M_S, OVER_NS, WATCH_S = 0.005, 50_000_000, 5.0
FIND_S = 120.0


class Post:
    """The post, for the body (on the emulator's thread) and in the map. Create it once a stack is running."""

    def __init__(self, stack: Any, redrawn: list[float]) -> None:
        """redrawn: the smallest gaps [m] of trials to be drawn again, since the last row."""
        import rospy
        from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
        from trajectory_msgs.msg import MultiDOFJointTrajectory

        from vsx_ros.ros import operator_command, topics
        from vsx_ros.ros.driving import wanted
        from vsx_ros.ros.situation import LocalizationSubscriber

        operator_command.join("post")
        self._stack, self._redrawn = stack, redrawn
        self._plant, self._lock, self._walls = stack.plant, threading.Lock(), stack.plant.body._walls
        self._log = stack._folder / "move_base.txt"
        self._centre_map: SE2 | None = None
        self._centre_world: SE2 | None = None
        self._appeared_ns = 0
        self._at_step: Callable[[], None] | None = None
        self._way: np.ndarray = np.empty((0, 3))
        self._steps: deque[tuple[int, float, float]] = deque(maxlen=2000)  # time [ns], way, gap [m]: 10 s
        self._map: Any = None
        self._where = LocalizationSubscriber()
        self._map_pub = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1, latch=True)

        def on_trajectory(msg: Any) -> None:
            way = wanted(msg)
            forwards = not isinstance(way, float) and msg.header.frame_id.endswith("map")
            self._way = way.poses[way.v > 0.0] if forwards and (way.v >= 0.0).all() else np.empty((0, 3))

        rospy.Subscriber(f"/{topics.TRAJECTORY}", MultiDOFJointTrajectory, on_trajectory)
        rospy.Subscriber("/map_seen", OccupancyGridMsg, self._on_map)
        stack.watch_steps(self._on_step)

    def _on_map(self, msg: Any) -> None:
        if self._stack.ended:  # another one hears of this map, too
            return
        with self._lock:
            self._map = msg
            self._say()

    def _say(self) -> None:
        """Publish the newest map, with the post if there is one."""
        from vsx_ros.ros import convert, headers, topics

        grid = convert.grid(self._map)
        if self._centre_map is not None:
            rows, columns = np.indices(grid.shape)
            places = grid.centres(np.column_stack([rows.ravel(), columns.ravel()])).reshape(*grid.shape, 2)
            inside = np.hypot(places[..., 0] - self._centre_map.x, places[..., 1] - self._centre_map.y) <= POST_M
            data = np.where(inside, OCCUPIED, grid.data).astype(np.int8)
            grid = OccupancyGrid(data, grid.resolution, grid.origin_x, grid.origin_y)
        self._map_pub.publish(convert.grid_msg(grid, topics.MAP_FRAME, headers.now_ns()))

    def _on_step(self, state: Any) -> None:
        if self._at_step is not None:
            self._at_step()
            self._at_step = None
        at, post = state.T_world_base, self._centre_world
        gap_m = math.inf if post is None else at.distance_to(post) - POST_M - BODY_M
        self._steps.append((state.time_ns, state.path_length_m, gap_m))

    def _on_emulator(self, act: Callable[[], None]) -> None:
        """Run this between two steps of the emulator."""
        self._at_step = act
        while self._at_step is not None:
            time.sleep(0.001)

    @property
    def speed_m_s(self) -> float:
        """Speed of the body, over 50 ms."""
        steps = list(self._steps)[-(OVER_NS // 5_000_000) - 1 :]
        return (steps[-1][1] - steps[0][1]) / max(1e-9 * (steps[-1][0] - steps[0][0]), 1e-9) if steps else 0.0

    def place_ahead(self, face_m: float) -> SE2 | None:
        """Centre of the post in the base frame; None if the base does not drive straight on at full speed, or its path
        ends before."""
        from vsx_ros.ros import headers

        T_map_base, way = self._where.at(headers.now_ns()).pose("map"), self._way
        if T_map_base is None or len(way) < 2 or self.speed_m_s < FULL_SPEED * LIMITS.v_m_s:
            return None
        nearest = int(np.argmin(np.hypot(way[:, 0] - T_map_base.x, way[:, 1] - T_map_base.y)))
        far = np.hypot(way[nearest:, 0] - T_map_base.x, way[nearest:, 1] - T_map_base.y) >= face_m + POST_M
        if not far.any() or math.hypot(way[-1, 0] - T_map_base.x, way[-1, 1] - T_map_base.y) < face_m + BEYOND_M:
            return None
        x, y, _ = way[nearest + int(far.argmax())]
        place = T_map_base.inverse() @ SE2(float(x), float(y), 0.0)
        return place if abs(math.atan2(place.y, place.x)) < STRAIGHT_RAD else None

    def appear(self, place: SE2) -> None:
        """Appear for the body and in the map at once; place: in the base frame."""
        from vsx_ros.ros import headers

        def stand() -> None:
            self._appeared_ns = self._plant.body.time_ns
            self._centre_world = self._plant.body.T_world_base @ place
            self._plant.body._walls = with_post(self._walls, self._centre_world)

        T_map_base = self._where.at(headers.now_ns()).pose("map")
        with self._lock:
            self._centre_map = T_map_base @ place
            self._on_emulator(stand)
            self._say()

    def vanish(self) -> None:
        def go() -> None:
            self._centre_world = None
            self._plant.body._walls = self._walls

        with self._lock:
            self._centre_map = None
            self._on_emulator(go)
            self._say()

    def _braked(self) -> int:
        """How often move_base has reported a newly seen obstacle."""
        return self._log.read_text(errors="replace").count("an obstacle has come to light")

    def trial(self, task: Ahead) -> dict[str, Any] | None:
        """One row; None if no suitable moment came, or the base stopped for another reason."""
        deadline_s = time.monotonic() + FIND_S
        while (place := self.place_ahead(task.ahead_m)) is None:
            if time.monotonic() > deadline_s:
                return None
            time.sleep(0.01)
        speed_m_s, collisions, braked = self.speed_m_s, self._plant.body.collisions, self._braked()
        self.appear(place)
        rest_s, began_s = None, time.monotonic()
        while rest_s is None and time.monotonic() - began_s < WATCH_S:
            time.sleep(0.01)
            if self.speed_m_s < REST_M_S:
                rest_s = 1e-9 * (self._steps[-1][0] - OVER_NS - self._appeared_ns)
        gaps = [gap for stamp_ns, _, gap in list(self._steps) if stamp_ns >= self._appeared_ns]
        contact = self._plant.body.collisions > collisions
        self.vanish()
        if self._braked() == braked and not contact:
            self._redrawn.append(round(min(gaps), 3))
            return None
        redrawn = list(self._redrawn)
        self._redrawn.clear()
        return {
            "speed_m_s": round(speed_m_s, 3),
            "ahead_m": round(gaps[0] + BODY_M, 3),
            "rest_s": None if rest_s is None else round(rest_s, 3),
            "left_m": None if rest_s is None else round(gaps[-1], 3),
            "least_m": round(min(gaps), 3),
            "contact": contact,
            "redrawn": redrawn,
        }


def with_post(kept: Borders, centre: SE2) -> Borders:
    """The walls of a body, and the post."""
    angles = np.linspace(0.0, 2.0 * math.pi, SIDES + 1)
    corners = np.array([centre.x, centre.y]) + POST_M * np.column_stack([np.cos(angles), np.sin(angles)])
    starts = np.concatenate([kept._a, corners[:-1]])
    ends = np.concatenate([kept._a + kept._edge, corners[1:]])
    return Borders(np.column_stack([starts, ends]))


def stack_with_relay(folder: Path) -> Any:
    """SLAM's map is published as map_seen; ``Post`` relays it."""
    stack = new_stack(folder)
    start = stack._forks.start

    def relayed(request: Request, streams: Sequence[int]) -> Copy | None:
        more = ["map:=map_seen"] if request.command[0].endswith("/vslam") else []
        return start(replace(request, command=[*request.command, *more]), streams)

    stack._forks.start = relayed
    return stack


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ahead", nargs="+", type=float, default=[0.5], metavar="M")
    parser.add_argument("--repetitions", type=int, default=20)
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/fault_obstacle.jsonl")
    args = parser.parse_args()
    tasks = [Ahead(ahead_m, number) for number, ahead_m in product(range(args.repetitions), args.ahead)]
    redrawn: list[float] = []
    robot = ExploringRobot(lambda stack: Post(stack, redrawn).trial, stack_with_relay)
    robot.campaign("fault_obstacle", tasks, args.out)


if __name__ == "__main__":
    main()
