"""Which parts of faces the dense map fills and which gaps it keeps open, with the real SLAM in the loop.

    python benchmarks/surface_cells.py gaps 101 gaps-plain 102 gaps-dark 104 lab 100

Worlds: ``gaps`` is a room with a row of boxes, 0.4 to 0.8 m apart, their faces in one plane, each with a notice on it;
with -plain all boxes are plain grey, with -dark the floor, the walls and the skirting have the same dark grey. The
robot explores for 45 s (a lab: 80 s). The true position of a cell is found through its keyframe, so that drift does
not count.
Filled: share of the face samples (every 5 cm, seen by three keyframes at 0.5 to 3.5 m) with a wall cell (0.06 to
0.6 m high) within 10 cm. Sparse: the same with map points. Wrong: share of those cells that are over 10 cm from
any face. A gap is kept if its free part is at most 0.2 m (the tolerance at both sides) narrower than the truth.
CPU: median per update (5 keyframes each), planes and cells.
"""

import sys
import time
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from vsx_ros.config import Config
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.planes import PlaneKind
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.interior import decorated
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import Box, Material, Poster, Start, World
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.system import ExplorationSystem

BAND_M = (0.06, 0.6)
KEYFRAMES_PER_UPDATE = 5
TOLERANCE_M = 0.10


class Drive(NamedTuple):
    """Snapshots as the map grew, true poses of all keyframes by their ids, and the robot."""

    snapshots: list[MapSnapshot]
    truth: list[SE3]
    robot: EmulatedRobot


def gap_world(seed: int, look: str) -> tuple[World, float, list[tuple[float, float]]]:
    """The world, the y coordinate of its faces, and the gaps between them along x [m]."""
    rng = np.random.default_rng([77, seed])
    shell = generate_world("lab", seed)
    corners = [(0.0, 0.0), (6.5, 0.0), (6.5, 5.0), (0.0, 5.0)]
    outline = replace(shell.outlines[0], points=corners)
    x, y, boxes, notices, gaps = 0.8, float(rng.uniform(3.2, 3.6)), [], [], []
    while True:
        length, height = float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.45, 1.0))
        if x + length > 6.0:
            break
        material = "grey" if look == "plain" else ["print0", "print1", "grey", "wood"][int(rng.integers(4))]
        boxes.append(Box(x=x + length / 2, y=y + 0.2, length=length, width=0.4, height=height, material=material))
        picture = f"poster{int(rng.integers(4))}"
        notices.append(
            Poster(x=x + length / 2, y=y - 0.002, z=0.6 * height, yaw_rad=-np.pi / 2, width=0.25, height=0.2,
                   material=picture)
        )  # fmt: skip
        gap = float(rng.uniform(0.4, 0.8))
        gaps.append((x + length, x + length + gap))
        x += length + gap
    materials = dict(shell.materials)
    if look == "dark":
        dark = Material(kind="plain", brightness=0.15)
        materials |= dict.fromkeys(("paint", "wallpaper", "brick", "floor", "skirting"), dark)
    bare = replace(
        shell, outlines=[outline], walls=[], boxes=boxes, tables=[], cylinders=[], posters=[], materials=materials,
        start=Start(x=1.0, y=1.2, theta_rad=0.5),
    )  # fmt: skip
    world = decorated(rng, bare, 1.2)
    return replace(world, posters=world.posters + notices), y, gaps[:-1]


def explored(world: World, seed: int, limit_s: float) -> Drive:
    """Explore for a while and keep the intermediate maps."""
    config = Config()
    robot = EmulatedRobot(world, seed)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, seed)
    command, snapshots, truth = STOP, [], {}
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > limit_s:
            break
        command = system.step(frame, odometry, "bumper" if any(robot.body.bumper) else None).command
        truth[frame.stamp_ns] = robot.truth.T_world_cam
        snapshot = system.slam.snapshot()
        if len(snapshot.images) >= (len(snapshots[-1].images) if snapshots else 0) + KEYFRAMES_PER_UPDATE:
            snapshots.append(snapshot)
    keyframes = [] if (slam_map := system.slam.slam_map()) is None else slam_map.view.keyframes
    return Drive([*snapshots, system.slam.snapshot()], [truth[k.data.stamp_ns] for k in keyframes], robot)


def in_truth(drive: Drive, snapshot: MapSnapshot, points: np.ndarray, keyframe: np.ndarray) -> np.ndarray:
    """(N, 3) points in the true world, through the true poses of their keyframes (N,), indices of the rays'."""
    rays = snapshot.rays
    moves = [drive.truth[number] @ T.inverse() for number, T in zip(rays.ids, rays.T_world_cams)]
    R, t = np.array([m.rotation for m in moves]), np.array([m.translation for m in moves])
    return np.einsum("nij,nj->ni", R[keyframe], points) + t[keyframe]


def distances(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """(N,) distances to the nearest of (S, 4) segments [m]."""
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    ratio = np.clip(((points[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - ratio[..., None] * d, axis=2).min(axis=1, initial=np.inf)


def visible_samples(drive: Drive, snapshot: MapSnapshot, segments: np.ndarray) -> np.ndarray:
    """(N, 2) places on faces, every 5 cm, that at least three settled keyframes see."""
    places, normals = [], []
    for ax, ay, bx, by in segments:
        length = float(np.hypot(bx - ax, by - ay))
        n = max(1, int(length / 0.05))
        share = (np.arange(n) + 0.5)[:, None] / n
        places.append(np.array([ax, ay]) + share * np.array([bx - ax, by - ay]))
        normals.append(np.tile(np.array([by - ay, ax - bx]) / length, (n, 1)))
    place, normal = np.concatenate(places), np.concatenate(normals)
    seen, a, e = np.zeros(len(place), int), segments[:, :2], segments[:, 2:] - segments[:, :2]
    for number in snapshot.keyframe_ids[:-2].tolist():
        T = drive.truth[number]
        way = T.translation[:2] - place
        far, axis = np.linalg.norm(way, axis=1), T.rotation[:2, 2] / np.linalg.norm(T.rotation[:2, 2])
        shown = (far > 0.8) & (far < 3.5) & ((way * normal).sum(axis=1) > 0.26 * far) & (-(way @ axis) > 0.87 * far)
        rows = np.flatnonzero(shown)
        start, d = place[rows] + 0.02 * normal[rows], T.translation[:2] - place[rows] - 0.02 * normal[rows]
        cross = d[:, None, 0] * e[:, 1] - d[:, None, 1] * e[:, 0]
        w = a - start[:, None]
        with np.errstate(all="ignore"):
            along = (w[..., 0] * e[:, 1] - w[..., 1] * e[:, 0]) / cross
            across = (w[..., 0] * d[:, None, 1] - w[..., 1] * d[:, None, 0]) / cross
        hidden = ((along > 0.0) & (along < 1.0) & (across >= 0.0) & (across <= 1.0)).any(axis=1)
        seen[rows[~hidden]] += 1
    return place[seen >= 3]


def near(places: np.ndarray, points: np.ndarray) -> float:
    """Share of places with a point within the tolerance."""
    return float(np.mean([np.min(np.hypot(*(points - at).T), initial=np.inf) < TOLERANCE_M for at in places]))


def in_band(points: np.ndarray) -> np.ndarray:
    return points[(points[:, 2] > BAND_M[0]) & (points[:, 2] < BAND_M[1])]


def wall_cells(drive: Drive, snapshot: MapSnapshot, dense: DenseMap) -> np.ndarray:
    """(N, 3) true positions of the wall cells."""
    walls = [plane.id for plane in dense.planes if plane.kind is PlaneKind.WALL]
    mine = np.isin(dense.cells.plane, walls)
    return in_truth(drive, snapshot, dense.cells.centre[mine], dense.cells.keyframe[mine])


def kept_gaps(cells: np.ndarray, y: float, gaps: list[tuple[float, float]]) -> list[bool]:
    x = cells[np.abs(cells[:, 1] - y) < 0.12, 0]
    free = [np.diff(np.sort([low, *x[(x > low) & (x < high)], high])).max() for low, high in gaps]
    return [bool(f >= high - low - 2 * TOLERANCE_M) for f, (low, high) in zip(free, gaps)]


def row(name: str, seed: int) -> str:
    """One line of the table."""
    kind, _, look = name.partition("-")
    if kind == "gaps":
        world, y, gaps = gap_world(seed, look)
    else:
        world, y, gaps = generate_world(kind, seed), 0.0, []
    drive = explored(world, seed, 45.0 if gaps else 80.0)
    densifier, took = Densifier(drive.robot.camera_given, drive.robot.T_base_cam_given, Config().dense), []
    for snapshot in drive.snapshots:
        began = time.process_time()
        dense = densifier.update(snapshot)
        took.append(time.process_time() - began)
    while not dense.complete:
        dense = densifier.update(snapshot)
    segments = np.asarray(world.obstacle_segments(*BAND_M)).reshape(-1, 4)
    cells = in_band(wall_cells(drive, snapshot, dense))
    rays = snapshot.rays
    point = in_band(in_truth(drive, snapshot, snapshot.points_world[rays.point], rays.keyframe))
    places = visible_samples(drive, snapshot, segments)
    filled, sparse = near(places, cells[:, :2]), near(places, point[:, :2])
    wrong = float(np.mean(distances(cells[:, :2], segments) > TOLERANCE_M))
    kept = kept_gaps(cells, y, gaps)
    return (
        f"{name:12} {seed:4} {len(snapshot.images):5} {len(places):7} {sparse:7.3f} {filled:7.3f} {wrong:7.3f} "
        f"{sum(kept):5}/{len(kept)} {np.median(took):7.3f}"
    )


if __name__ == "__main__":
    print("world        seed   kfs samples  sparse  filled   wrong gaps kept   cpu s")
    for name, seed in zip(sys.argv[1::2], sys.argv[2::2]):
        print(row(name, int(seed)), flush=True)
