"""A robot for tests of the page: posts on the board what a run would, at the rates of a run."""

import base64
import math
import threading
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseArray

from vsx_ros.exploration.utility import View
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.unknown_ground import Frontier
from vsx_ros.robot import Frame
from vsx_ros.ros import convert
from vsx_ros.ros.dashboard import feed
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.mission_output import frontier_markers
from vsx_ros.ros.slam_messages import drawn
from vsx_ros.slam.snapshot import TrackedFeatures

RATE_HZ = 15.0
KEYFRAMES = 12
MOUNT = mount_pose(0.0, 0.0, 0.3, 0.1)
OFFICE = [[-1.0, -2.0], [1.9, -2.0], [1.9, 1.95], [-1.0, 1.95]]
"""Outline of a room of the map."""


def room() -> OccupancyGrid:
    """A known rectangle from (-1, -2) to (4.5, 2) m, with a wall with a door at x = 2."""
    cells = np.full((120, 160), UNKNOWN, np.int8)
    cells[20:100, 20:130] = FREE
    cells[20, 20:130] = cells[99, 20:130] = cells[20:100, 20] = OCCUPIED
    cells[20:62, 80] = cells[82:100, 80] = OCCUPIED
    cells[50:60, 45:60] = OCCUPIED
    return OccupancyGrid(cells, 0.05, -2.0, -3.0)


class PostingRobot:
    """Posts on a thread until it is closed."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _post(self, subject: str, value: Any) -> None:
        self._board.post(subject, feed.text(value))

    def _run(self) -> None:
        self._post_map()
        self._post_state()
        rng = np.random.default_rng(0)
        noise = cv2.GaussianBlur(rng.integers(0, 255, (480, 640), dtype=np.uint8), (31, 31), 0)
        k = 0
        while not self._over.wait(1.0 / RATE_HZ):
            k += 1
            points = rng.uniform((10, 10), (630, 470), (300, 2))
            picture = drawn(Frame(k, noise), TrackedFeatures(points[:220], points[220:]))
            _, jpeg = cv2.imencode(".jpg", picture)
            self._post("camera", base64.b64encode(jpeg.tobytes()).decode())
            self._post("pose", [0.02 * k % 3.0, 0.3 * math.sin(0.04 * k), 0.0])
            stats = {"tracked": 220, "attempted": 300, "latency_ms": 20.0, "keyframes": KEYFRAMES, "points": 3000}
            self._post("stats", {**stats, "plan_ms": 180.0})

    def _post_map(self) -> None:
        grid = room()
        border = np.array([[row, 129] for row in range(30, 90)])
        views = [View(SE2(3.6, y, 0.0), 4.0 / k, 1.0 + k, 30, 2.5 / k) for k, y in ((1, 0.5), (2, -1.0))]
        markers = frontier_markers(grid, [Frontier(border, np.zeros(2), 3.0)], views, 1, 2.0)
        self._post("frontiers", feed.frontiers(markers))
        self._post("map", feed.grid(convert.grid_msg(grid, "map", 1)))
        path = [SE2(0.05 * k, 0.3 * math.sin(0.1 * k), 0.0) for k in range(60)]
        self._post("plan", feed.plan(convert.path_msg("map", 1, path)))
        cameras = [SE3.from_se2(SE2(-0.6 + 0.4 * k, -1.5, 0.2 * k)) @ MOUNT for k in range(KEYFRAMES)]
        self._post("keyframes", feed.keyframes(PoseArray(poses=list(map(convert.pose_msg, cameras)))))
        self._post("planes", [[[-1.0, 2.0], [2.0, 2.0], [2.0, 2.0], [-1.0, 2.0]]])
        rug = {"name": "rug", "kind": "no-go", "points": [[2.6, -1.6], [3.6, -1.6], [3.6, -0.7], [2.6, -0.7]]}
        self._post("zones", {"version": 1, "frame": "map", "zones": [rug]})
        office = {"number": 1, "name": "room 1", "area_m2": 11.0, "known_ratio": 0.94, "place": [0.5, 1.0]}
        self._post("rooms", {"version": 1, "rooms": [{**office, "outline": OFFICE}]})

    def _post_state(self) -> None:
        reason = "driving to a view of 4.0 m2, 2.0 m away [U = 2.0]"
        status = {"state": "mapping", "reason": reason, "goal": [3.0, 0.3, 0.0]}
        status |= {"begun_ns": 10**18, "left_s": 230}
        self._post("mission", {**status, "elapsed_s": 85, "driven_m": 12.3, "known_area_m2": 23.4})
        self._post("slam", ["TRACKING", ""])
        health = {
            "mobile_base: safety": [1, "emergency stop", {"estop": "True"}],
            "vslam: input": [0, "30 images a second", {"dropped": "4"}],
        }
        self._post("health", health)
        event = {"stamp_ns": 10**18 + 90 * 10**9, "state": "mapping", "reason": "<b>chosen</b>"}
        again = [
            {"stamp_ns": 10**18 + (12 + k) * 10**9, "state": "mapping", "reason": f"blocked {k} cm ahead"}
            for k in range(7)
        ]
        self._post("events", [*again, event])
