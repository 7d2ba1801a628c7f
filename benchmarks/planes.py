"""How well planes are found in emulated labs: ``PYTHONPATH=src:hw python benchmarks/planes.py [--seeds A-B]``.

Each lab is explored for a while with everything in the loop (emulator, SLAM, planner). Then the planes of the SLAM's
map are compared with the world's faces. A face counts if it is at least 20 cm wide and high and 20 of the map's points
lie on it. Only flat faces count, not the floor, cylinders, ends of walls, or legs. A face is recalled if a plane within
15 degrees and 10 cm holds 30 % of its points. A plane is spurious if less than half of its points lie on faces within
15 degrees of it.
"""

import argparse
import time
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.config import Config
from vsx_ros.dense.plane_finding import PlaneFinder, observed_points
from vsx_ros.dense.plane_tiles import cluster
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.world import World, prisms
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.system import ExplorationSystem

MIN_POINTS, MIN_SHARE = 20, 0.3
MIN_SIZE_M = 0.2
NEAR_M, MAX_ANGLE_DEG = 0.10, 15.0
ROUND_SIDES = 8


class Face(NamedTuple):
    """A flat piece of surface in the map's frame: outward normal, offset, corners (N, 3); whether its planes count."""

    normal: np.ndarray
    offset: float
    corners: np.ndarray
    counts: bool

    @property
    def dominant(self) -> bool:
        """Whether the map must show it, if it has points."""
        sides = np.linalg.norm(self.corners - np.roll(self.corners, 1, axis=0), axis=1)
        return self.counts and float(sides.min()) >= MIN_SIZE_M

    def distances(self, points: np.ndarray, views: np.ndarray) -> np.ndarray:
        """(N,) distances [m] of points to the face; infinite for points seen from behind."""
        u = self.corners[1] - self.corners[0]
        u = u / np.linalg.norm(u)
        axes = np.stack([u, np.cross(self.normal, u)])
        own, every = self.corners @ axes.T, points @ axes.T
        beyond = np.maximum(np.maximum(own.min(axis=0) - every, every - own.max(axis=0)), 0.0)
        away = np.hypot(np.hypot(*beyond.T), points @ self.normal - self.offset)
        return np.where(views @ self.normal > 0.0, away, np.inf)


def upright(a: np.ndarray, b: np.ndarray, low: float, high: float, counts: bool) -> Face:
    """The face above the segment from a to b; the solid is to the left of the segment."""
    normal = np.array([b[1] - a[1], a[0] - b[0], 0.0])
    normal = normal / np.linalg.norm(normal)
    corners = np.array([[*a, low], [*b, low], [*b, high], [*a, high]])
    return Face(normal, float(normal[:2] @ a), corners, counts)


def faces_of(world: World) -> list[Face]:
    """All surfaces, in the frame of a map that starts at the world's start pose."""
    T_start_world, faces = world.start_pose.inverse(), list[Face]()
    for outline in world.outlines:
        loop = (T_start_world @ np.asarray(outline.points, float))[::-1]
        faces += [upright(a, b, 0.0, outline.height, True) for a, b in zip(loop, np.roll(loop, -1, axis=0))]
    for solid in prisms(world):
        loop = T_start_world @ solid.footprint
        flat = len(loop) < ROUND_SIDES
        faces += [upright(a, b, solid.z_min, solid.z_max, flat) for a, b in zip(loop, np.roll(loop, -1, axis=0))]
        for side, z in ((1.0, solid.z_max), (-1.0, solid.z_min)):
            corners = np.column_stack([loop, np.full(len(loop), z)])
            faces.append(Face(np.array([0.0, 0.0, side]), side * z, corners, flat))
    x0, y0, x1, y1 = world.bounds
    room = T_start_world @ np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    for side, z in ((1.0, 0.0), (-1.0, world.ceiling_height)):
        faces.append(Face(np.array([0.0, 0.0, side]), side * z, np.column_stack([room, np.full(4, z)]), False))
    return faces


def explored(seed: int, seconds: float) -> tuple[list[MapSnapshot], float]:
    """The maps after each keyframe of an exploration, and the camera's focal length [px]."""
    config = Config()
    world = generate_world("lab", seed)
    robot = EmulatedRobot(world, seed, SimulationConfig(threads=1), config.robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, seed)
    maps, command = list[MapSnapshot](), STOP
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > seconds:
            break
        command = system.step(frame, odometry, "bumper pressed" if any(robot.body.bumper) else None).command
        snapshot = system.slam.snapshot()
        if len(snapshot.keyframe_ids) and (not maps or snapshot.version != maps[-1].version):
            maps.append(snapshot)
    return maps, robot.camera_given.fx


class Score(NamedTuple):
    """Faces to be found and faces found; planes and spurious ones; angle errors of the other planes [deg]."""

    faces: int
    recalled: int
    planes: int
    spurious: int
    errors_deg: list[float]


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))


def judged(planes: tuple[Plane, ...], snapshot: MapSnapshot, faces: list[Face], focal_px: float) -> Score:
    config = Config().dense.planes
    points = observed_points(snapshot, focal_px, config.noise_px)
    away = np.stack([face.distances(points.world, points.views) for face in faces], axis=1)
    nearest = np.where(away.min(axis=1) < NEAR_M, away.argmin(axis=1), -1)
    nearest[(points.sigma > config.max_sigma_m) | (points.world[:, 2] < 0.06)] = -1
    wanted = [k for k, face in enumerate(faces) if face.dominant and (nearest == k).sum() >= MIN_POINTS]
    found = [plane for plane in planes if plane.kind is not PlaneKind.FLOOR]

    def recalled(k: int) -> bool:
        rows = np.flatnonzero(nearest == k)
        middle = np.median(points.world[rows], axis=0)[None]
        return any(
            angle_deg(plane.normal, faces[k].normal) < MAX_ANGLE_DEG
            and abs(plane.distances(middle)[0]) < NEAR_M
            and np.isin(rows, plane.points).mean() >= MIN_SHARE
            for plane in found
        )

    spurious, errors = 0, list[float]()
    for plane in found:
        off = np.array([angle_deg(plane.normal, face.normal) for face in faces])
        on = away[plane.points] < NEAR_M
        alike = on & (off <= MAX_ANGLE_DEG)
        best = int(alike.sum(axis=0).argmax())
        if alike.any(axis=1).mean() < 0.5:
            spurious += 1
        elif faces[best].counts:
            errors.append(float(off[best]))
    return Score(len(wanted), sum(map(recalled, wanted)), len(found), spurious, errors)


def linkage_ms(points: int, hypotheses: int) -> float:
    """CPU time of J-linkage on ten structures among noise."""
    rng = np.random.default_rng(0)
    structure, model = rng.integers(0, 10, points), rng.integers(0, 10, hypotheses)
    bits = rng.random((points, hypotheses)) < np.where(structure[:, None] == model, 0.7, 0.05)
    bits = np.pad(bits, ((0, 0), (0, -hypotheses % 64)))
    rows = np.packbits(bits, axis=1, bitorder="little").view(np.uint64)
    times = []
    for _ in range(4):
        began = time.process_time()
        cluster(rows)
        times.append(1e3 * (time.process_time() - began))
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100-104", metavar="A-B", help="labs (default 100-104)")
    parser.add_argument("--seconds", type=float, default=150.0, help="emulated time of each exploration (default 150)")
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    cv2.setNumThreads(1)
    for n, m in ((1000, 2000), (2000, 2000), (5000, 2000)):
        print(f"J-linkage of {n} points, {m} hypotheses: {linkage_ms(n, m):.0f} ms cpu")
    scores = []
    for seed in range(int(first), int(last or first) + 1):
        maps, focal_px = explored(seed, args.seconds)
        finder, times, planes = PlaneFinder(focal_px, Config().dense.planes, True), list[float](), tuple[Plane, ...]()
        for snapshot in maps:
            began = time.process_time()
            planes = finder.update(snapshot)
            times.append(1e3 * (time.process_time() - began))
        score = judged(planes, maps[-1], faces_of(generate_world("lab", seed)), focal_px)
        scores.append(score)
        print(
            f"lab {seed}: {score.recalled}/{score.faces} faces recalled, {score.spurious}/{score.planes} planes"
            f" spurious, normals {np.median(score.errors_deg):.2f} deg off; {len(maps)} updates, median"
            f" {np.median(times):.0f} ms, p95 {np.quantile(times, 0.95):.0f} ms cpu",
            flush=True,
        )
    total = Score(*(sum((s[k] for s in scores), [] if k == 4 else 0) for k in range(5)))
    print(
        f"all: recalled {100 * total.recalled / total.faces:.0f} % (must 90), spurious "
        f"{100 * total.spurious / total.planes:.0f} % (must 10), median normal error "
        f"{np.median(total.errors_deg):.2f} deg (must 3)"
    )


if __name__ == "__main__":
    main()
