"""Compares exploration strategies without the SLAM: true poses, and landmarks of the emulated world as its map.

    python benchmarks/exploration_strategy.py [--seeds 100-119] [--strategy views nearest tour] [--jobs 2]

Mission, planner and ground map are the real ones. Instead of SLAM points it uses image corners from 160 random places,
at their true positions. Each corner is found in a share of the keyframes that see it (drawn once), and its depth is as
uncertain as its parallax implies. The base follows its plans exactly. A run takes a quarter of a minute of processor
time instead of three to four. It compares strategies and does not show what the whole system reaches
(``exploration.py``). Each run writes a row, and ``tables.py`` makes the table.
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from exploration import LEVELS, SAMPLE_S
from frontier_strategies import STRATEGIES
from tables import RESULTS, rooms_of

from vsx_ros.config import Config
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.exploration.decision import Action, NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import Ranker
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.view import with_view
from vsx_ros.kernels import kernel
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import FREE, OccupancyGrid
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.planning.corridor import Visibility
from vsx_ros.planning.path import Refusal, Trajectory
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.slow_spans import blind_spans
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.runs.judge import MapJudge
from vsx_ros.sim.camera import EmulatedCamera
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.robot import SimulationConfig
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import World, prisms
from vsx_ros.slam.state import TrackingState
from vsx_ros.vision.corners import strongest

PLACES, CORNERS, SAME_M, SEEN_SHARE, NEVER = 160, (400, 150), 0.04, (0.15, 0.9), 0.35
PIXEL_RAD, LEAST_PARALLAX_RAD, HALF_FOV_RAD, RANGE_M = 0.0012, 0.014, 0.54, 5.0
KEYFRAME_M, KEYFRAME_RAD, STEP_S, TOUCH_M = 0.15, 0.14, 0.05, 0.03
SLIDE_M = 0.001  # how much closer a touching base may come to the obstacle per step while it slides along
SECOND_NS = 1_000_000_000


@kernel
def in_view(heights, resolution, x0, y0, camera, yaw, points):
    """(N,) which points (N, 3) the camera (3,) sees above ground of the given heights (H, W) [m]."""
    seen = np.zeros(len(points), np.bool_)
    for k in range(len(points)):
        dx, dy, dz = points[k, 0] - camera[0], points[k, 1] - camera[1], points[k, 2] - camera[2]
        d = math.sqrt(dx * dx + dy * dy)
        off = math.atan2(dy, dx) - yaw
        off -= 2 * math.pi * math.floor((off + math.pi) / (2 * math.pi))
        if d < 0.35 or d > RANGE_M or abs(off) > HALF_FOV_RAD or abs(dz) > 0.44 * d * math.cos(off):
            continue
        r, hidden = 0.05, False
        while r < d - 0.12 and not hidden:
            i = int(math.floor((camera[1] + dy * r / d - y0) / resolution))
            j = int(math.floor((camera[0] + dx * r / d - x0) / resolution))
            inside = 0 <= i < heights.shape[0] and 0 <= j < heights.shape[1]
            hidden = inside and heights[i, j] > camera[2] + dz * r / d
            r += 0.07
        seen[k] = not hidden
    return seen


def corners_of(world: World, truth: OccupancyGrid, clearance_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) corners that cameras at random places see, in the world [m]."""
    camera = EmulatedCamera(scene_of(world), Config().robot.mount, SimulationConfig().camera, rng, 2)
    cells, found = np.argwhere(clearance_m > 0.25), []
    for _ in range(PLACES):
        x, y = truth.centres(cells[[rng.integers(len(cells))]])[0]
        base = np.array([x, y, rng.uniform(-math.pi, math.pi), 0.0])

        def standing(stamps: np.ndarray, base: np.ndarray = base) -> np.ndarray:
            return np.tile(base, (len(stamps), 1))

        picture = camera.picture(0, standing, want_depth=True)
        image = camera._sensor.develop(picture.radiance)
        R, t = camera.poses_cam(base[None])
        for scale, count in zip((1, 2), CORNERS, strict=True):
            small = cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
            u, v = scale * strongest(small, np.zeros(small.shape, bool), count).T
            if not len(u):
                continue
            depth = picture.depth[v, u]
            rays = camera.camera_true.unproject(np.column_stack([u, v]).astype(float))
            near = (depth > 0.3) & (depth < RANGE_M)
            found.append((depth[:, None] * rays / rays[:, 2:])[near] @ R[0].T + t[0])
    points = np.concatenate(found)
    return points[np.unique(np.round(points / SAME_M), axis=0, return_index=True)[1]]


class Landmarks:
    """The map of a SLAM with perfect poses, in the map's frame, which starts at the world's start pose."""

    def __init__(self, world: World, seed: int) -> None:
        ground, rng = Config().ground_map, np.random.default_rng([seed, 77])
        self.start = world.start_pose
        self.truth = ground_truth_grid(world, ground.resolution_m, 0.06, ground.obstacle_max_height_m)
        free = (self.truth.data == FREE).astype(np.uint8)
        self.clearance_m = cv2.distanceTransform(free, cv2.DIST_L2, 5) * self.truth.resolution
        self._heights = self._solid_heights(world)
        self._world = corners_of(world, self.truth, self.clearance_m, rng)
        self._world = self._world[rng.random(len(self._world)) > NEVER]
        self._points = np.column_stack([self.start.inverse() @ self._world[:, :2], self._world[:, 2]])
        n = len(self._points)
        self._share, self._depth_noise, self._rng = rng.uniform(*SEEN_SHARE, n), rng.normal(size=n), rng
        self._first, self._parallax, self._count = np.full((n, 3), np.nan), np.zeros(n), np.zeros(n, int)
        self._T_base_cam = mount_pose(*(getattr(Config().robot.mount, name) for name in (
            "forward_m", "left_m", "height_m", "pitch_down_rad", "yaw_left_rad")))  # fmt: skip
        self.poses: list[SE2] = []
        self.T_world_cams: list[SE3] = []
        self._seen: list[np.ndarray] = []

    def _solid_heights(self, world: World) -> np.ndarray:
        """(H, W) height of solid ground [m]; infinite for walls."""
        heights = np.where(self.truth.data == FREE, 0.0, 3.0)
        for solid in prisms(world):
            if solid.z_min < 0.2 and solid.z_max < 2.5:
                corner = np.array([self.truth.origin_x, self.truth.origin_y])
                pixels = np.rint((np.asarray(solid.footprint) - corner) / self.truth.resolution - 0.5).astype(np.int32)
                mask = cv2.fillPoly(np.zeros(heights.shape, np.uint8), [pixels], 1)
                heights[mask > 0] = solid.z_max
        return heights

    def look(self, pose: SE2) -> None:
        """Add a keyframe at this pose."""
        T = SE3.from_se2(pose) @ self._T_base_cam
        camera = np.append((self.start @ T.translation[None, :2])[0], T.translation[2])
        visible = in_view(
            self._heights, self.truth.resolution, self.truth.origin_x, self.truth.origin_y, camera,
            pose.theta + self.start.theta, self._world,
        )  # fmt: skip
        rows = np.flatnonzero(visible & (self._rng.random(len(visible)) < self._share))
        new = rows[np.isnan(self._first[rows, 0])]
        self._first[new] = T.translation
        a, b = self._points[rows] - T.translation, self._points[rows] - self._first[rows]
        cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        self._parallax[rows] = np.maximum(self._parallax[rows], np.arccos(np.clip(cosine, -1.0, 1.0)))
        self._count[rows] += 1
        self.poses.append(pose)
        self.T_world_cams.append(T)
        self._seen.append(rows)

    def mapped(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (M, 3), and the keyframe and point of each observation."""
        known = (self._count >= 2) & (self._parallax > LEAST_PARALLAX_RAD)
        number = np.cumsum(known) - 1
        keyframe = np.repeat(np.arange(len(self._seen)), [len(rows) for rows in self._seen])
        point = np.concatenate(self._seen)
        ray = self._points[known] - self._first[known]
        sigma = np.linalg.norm(ray, axis=1) * PIXEL_RAD / self._parallax[known]
        sigma /= np.sqrt(0.5 * self._count[known])
        noise = (np.minimum(sigma, 0.5) * self._depth_noise[known] / np.linalg.norm(ray, axis=1))[:, None]
        return self._points[known] + noise * ray, keyframe[known[point]], number[point[known[point]]]


class Run:
    """Mission, planner and ground map on a base that follows its plans exactly."""

    def __init__(self, seed: int, rank: Ranker) -> None:
        config, world = with_view(Config()), generate_world("lab", seed)
        self._config, self._judge, self._landmarks = config, MapJudge(world, config), Landmarks(world, seed)
        self._planner, self._rng = Planner(config.planner, config.robot), np.random.default_rng(seed)
        self._mission = Mission(config, self._planner.travel_costs)
        self._mission.view_selector._rank = rank
        self._ground = GroundMap(config.ground_map, config.robot)
        self._grid: OccupancyGrid | None = None
        self._points = np.zeros((0, 3))
        self._trail, self._bumps = list[SE2](), list[SE2]()
        self._pose, self._now_s, self._way_m = SE2(), 0.0, 0.0
        self._navigation, self._why, self._hazard = NavigationState.IDLE, "", None
        self._trajectory: tuple[Trajectory, float] | None = None
        self.curve: list[tuple[float, float, float, int]] = []

    def explore(self, until: float, way_m: float, time_s: float) -> str:
        """Run until the share is known correctly or a limit is reached; returns why it ended."""
        while self._mission.outcome is None and self._way_m < way_m and self._now_s < time_s:
            self._refresh()
            if self.curve and self.curve[-1][2] >= until:
                return "enough is known"
            self._decide()
            self._drive(0.2)
        return "limit" if self._mission.outcome is None else self._mission.outcome.value

    def _refresh(self) -> None:
        """Build the map, every second and wherever the mission chooses."""
        due = not self.curve or self._now_s >= self.curve[-1][0] + SAMPLE_S
        if len(self._landmarks.poses) < 3 or (self._trajectory is not None and round(self._now_s * 5) % 5 and not due):
            return
        self._points, keyframe, point = self._landmarks.mapped()
        self._grid = self._ground.build(
            self._landmarks.T_world_cams, self._points, keyframe, point,
            DriveHistory(self._trail, self._bumps, SE2()),
        )  # fmt: skip
        if due:
            right = self._judge.quality(self._grid).coverage_correct or 0.0
            self.curve.append((self._now_s, self._way_m, right, len(self._bumps)))

    def _decide(self) -> None:
        mapped = self._grid is not None
        situation = Situation(
            TrackingState.GOOD if mapped else TrackingState.NOT_INITIALISED, "", self._pose if mapped else None,
            self._pose, self._grid, self._navigation, self._why, self._hazard, self._points,
        )  # fmt: skip
        decision = self._mission.decide(round(self._now_s * SECOND_NS), situation)
        if decision.action is Action.GO and decision.goal is not None:
            self._go(decision.goal, decision.frame)
        elif decision.action is Action.CANCEL and self._trajectory is not None:
            self._stop(NavigationState.ABORTED, "cancelled")

    def _go(self, goal: SE2, frame: str) -> None:
        config = self._config
        if frame == "odom" or self._grid is None:
            plan = self._planner.plan_blind(self._pose, goal)
        else:
            visibility = Visibility(self._points, config.planner)
            plan = self._planner.plan(self._pose, goal, self._grid, self._rng, visibility)
        if isinstance(plan, Refusal):
            self._stop(NavigationState.ABORTED, plan.reason)
            return
        timed = time_scale(plan.path, config.limits, blind_spans(plan.blind_spans, config.planner.blind_v_m_s))
        self._trajectory, self._navigation, self._hazard = (timed, self._now_s), NavigationState.ACTIVE, None

    def _stop(self, state: NavigationState, why: str) -> None:
        self._trajectory, self._navigation, self._why = None, state, why

    def _clearance_m(self, pose: SE2) -> float:
        truth, world = self._landmarks.truth, self._landmarks.start @ pose
        cell = np.array([world.x - truth.origin_x, world.y - truth.origin_y]) / truth.resolution - 0.5
        column, row = np.float32(cell).reshape(2, 1, 1)
        return float(cv2.remap(self._landmarks.clearance_m, column, row, cv2.INTER_LINEAR)[0, 0])

    def _drive(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self._now_s += STEP_S
            if self._trajectory is None:
                continue
            timed, began_s = self._trajectory
            pose = timed.at(self._now_s - began_s)[0]
            clear_m = self._clearance_m(pose)
            if clear_m < min(self._config.robot.radius_m - TOUCH_M, self._clearance_m(self._pose) - SLIDE_M):
                self._bumps.append(self._pose)
                self._hazard = "bumper"
                self._stop(NavigationState.ABORTED, "bumper")
                continue
            self._way_m += self._pose.distance_to(pose)
            self._pose = pose
            self._trail.append(pose)
            last = self._landmarks.poses[-1] if self._landmarks.poses else None
            if last is None or pose.distance_to(last) > KEYFRAME_M or abs(pose.angle_to(last)) > KEYFRAME_RAD:
                self._landmarks.look(pose)
            if self._now_s - began_s >= timed.duration_s:
                self._stop(NavigationState.SUCCEEDED, "arrived")


class Choosing(NamedTuple):
    """A world explored with one strategy, until enough is known or a limit is reached."""

    seed: int
    strategy: str
    until: float
    way_m: float
    time_s: float


def explored(task: Choosing) -> dict[str, object]:
    """Metres and seconds until each share was known correctly, and how the run ended."""
    run = Run(task.seed, STRATEGIES[task.strategy])
    why = run.explore(task.until, task.way_m, task.time_s)
    reached: dict[str, list[float]] = {}
    for now_s, way_m, right, _ in run.curve:
        for level in LEVELS:
            if right >= level:
                reached.setdefault(f"{100 * level:.0f}", [round(way_m, 2), round(now_s, 1)])
    now_s, way_m, right, bumps = run.curve[-1]
    return {
        "reached": reached, "coverage_correct": round(right, 4), "driven_m": round(way_m, 2),
        "duration_s": round(now_s, 1), "collisions": bumps, "stop_reason": why,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100-119", help="first-last")
    parser.add_argument("--strategy", nargs="+", choices=tuple(STRATEGIES), default=list(STRATEGIES))
    parser.add_argument("--until", type=float, default=0.9)
    parser.add_argument("--way", type=float, default=120.0)
    parser.add_argument("--time", type=float, default=800.0)
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=RESULTS / "exploration_strategy.jsonl")
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    tasks = [Choosing(seed, strategy, args.until, args.way, args.time) for seed in seeds for strategy in args.strategy]
    run_campaign(tasks, explored, Store(args.out, rooms=rooms_of("exploration_strategy")), Engine(args.jobs))


if __name__ == "__main__":
    main()
