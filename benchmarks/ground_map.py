"""How well the ground map shows obstacles, sparse and dense, with everything in the loop.

    PYTHONPATH=src:hw python benchmarks/ground_map.py [--world lab] [--seeds 100-109] [--seconds 60] [--sparse]
    PYTHONPATH=src:hw python benchmarks/ground_map.py --rebuild

Each world is explored with the dense map in the loop (``--sparse``: without). At the end the ground map is built from
the same keyframes without surfaces (the paper's sparse map) and with them. Both are compared with the world at 10 cm.
Faces count if three keyframes saw them at 0.5 to 3.5 m. Phantoms are occupied cells over 10 cm from any obstacle;
phantoms from the floor are those whose points' corners are truly on the floor, as seen by the true camera.
Gaps kept: of the known area in gaps 0.4 to 0.8 m wide, the share that is free. Planes: as in planes.py, in the same
maps. Covered: share of the observable cells that is known in the map used for driving.
CPU: of one core, for densifying a keyframe and building the last map.
``--rebuild`` times maps of synthetic keyframes, 300 in 12 m x 8 m and 3000 in 40 m x 25 m.
"""

import argparse
import time
from typing import NamedTuple

import cv2
import numpy as np
from floor_phantoms import floor_phantom_m2
from planes import Score, faces_of, judged

from vsx_ros.config import Config, DenseConfig
from vsx_ros.dense.densify import Densifier
from vsx_ros.evaluation.map_quality import ObstacleQuality, obstacle_quality, seen_faces
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.robot import STOP
from vsx_ros.runs.judge import MapJudge
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import World
from vsx_ros.system import ExplorationSystem


class TimedDensifier(Densifier):
    """Records the processor time of each update."""

    cpu_s: list[float]

    def update(self, snapshot, budget=None):
        began = time.thread_time()
        dense = super().update(snapshot, budget)
        self.cpu_s.append(time.thread_time() - began)
        return dense


class Run(NamedTuple):
    """Of one exploration: the maps without and with surfaces, the floor among their phantoms [m2], and the planes."""

    qualities: list[ObstacleQuality]
    floor_m2: list[float]
    planes: Score
    covered: float
    about: str


def explored(name: str, world: World, seed: int, seconds: float, sparse: bool = False) -> Run:
    """Explore a world for a while and judge its maps."""
    config = Config(dense=DenseConfig(enabled=not sparse))
    robot = EmulatedRobot(world, seed, SimulationConfig(threads=1), config.robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, seed)
    densifier = TimedDensifier(robot.camera_given, robot.T_base_cam_given, config.dense, seed)
    densifier.cpu_s = []
    if not sparse:
        system._densifier = densifier
    command, truth_of = STOP, dict[int, SE3]()
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > seconds:
            break
        truth_of[frame.stamp_ns] = robot.truth.T_world_cam
        command = system.step(frame, odometry, "bumper pressed" if any(robot.body.bumper) else None).command
    snapshot, ground = system.slam.snapshot(), config.ground_map
    truth = ground_truth_grid(world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m)
    poses = [truth_of[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()]
    faces = seen_faces(truth, poses)
    qualities, floor_m2, times = [], [], []
    for with_surfaces in (False, True):
        began = time.thread_time()
        grid = system.ground.grid(snapshot, with_surfaces)
        times.append(1e3 * (time.thread_time() - began))
        qualities.append(obstacle_quality(grid, truth, faces, world.start_pose))
        floor_m2.append(floor_phantom_m2(grid, truth, world, snapshot, poses, robot.camera_given))
    cpu = densifier.cpu_s or [0.0]
    planes = judged(densifier.update(snapshot).planes, snapshot, faces_of(world), robot.camera_given.fx)
    covered = MapJudge(world, config).quality(grid).coverage_correct or 0.0
    about = (
        f"{name} {seed}: {len(snapshot.keyframe_ids)} keyframes, {np.count_nonzero(faces)} cells of faces seen, "
        f"{robot.truth.path_length_m:.0f} m, {robot.truth.collisions} collisions, mission {system.mission.outcome}, "
        f"covered {covered:.3f}; planes {planes.recalled}/{planes.faces} recalled, {planes.spurious}/{planes.planes} "
        f"spurious; densify {np.median(cpu):.2f} s (p95 {np.quantile(cpu, 0.95):.2f}), map {times[0]:.0f} and "
        f"{times[1]:.0f} ms"
    )
    return Run(qualities, floor_m2, planes, covered, about)


def words(name: str, of: list[ObstacleQuality], floor_m2: list[float]) -> str:
    """Medians, and the worst in brackets."""

    def two(values: list[float], worst: float) -> str:
        return f"{np.median(values):.3f} ({worst:.3f})"

    f1, into = [q.f1 or 0.0 for q in of], [q.free_inside or 0.0 for q in of]
    kept = [q.gaps_free for q in of if q.gaps_free is not None] or [np.nan]
    surface = [q.surface_free or 0.0 for q in of]
    precision = [q.precision for q in of if q.precision is not None] or [np.nan]
    recall = [q.recall for q in of if q.recall is not None] or [np.nan]
    return (
        f"  {name}: F1 {two(f1, min(f1))}, precision {np.median(precision):.3f}, recall "
        f"{np.median(recall):.3f}, surface called free {two(surface, max(surface))}, free inside "
        f"{two(into, max(into))}, phantom {two([q.phantom_m2 for q in of], max(q.phantom_m2 for q in of))} m2, "
        f"of floor {np.sum(floor_m2):.4f} m2 in all, gaps kept {np.mean(kept):.3f}"
    )


def rebuild(n: int, half_length_m: float, half_width_m: float) -> float:
    """Processor time [ms] of a map of n keyframes along a path through a room."""
    rng = np.random.default_rng(0)
    way = 2.0 * np.pi * np.arange(n) / 300
    spread = np.sqrt((np.arange(n) + 1.0) / n)
    poses = [
        SE2(half_length_m * s * np.cos(a), half_width_m * s * np.sin(a), a + 1.57)
        for a, s in zip(way.tolist(), spread.tolist())
    ]
    cameras = [SE3.from_se2(pose) @ mount_pose(-0.09, 0.0, 0.31, 0.0) for pose in poses]
    points, keyframe, point = [], [], []
    for k, T in enumerate(cameras):
        z = rng.uniform(0.8, 5.0, 30)
        points.append(T @ np.column_stack([rng.uniform(-0.5, 0.5, 30) * z, rng.uniform(-0.4, 0.3, 30), z]))
        for j in range(max(0, k - 5), k + 1):
            keyframe.append(np.full(30, j))
            point.append(np.arange(30 * k, 30 * k + 30))
    at = np.vstack(points)
    surfaces = Surfaces(np.repeat(at, 8, axis=0), np.repeat(np.arange(n), 240), np.full(240 * n, 0.01))
    ground_map, times = GroundMap(Config().ground_map, Config().robot), []
    for _ in range(4):
        began = time.thread_time()
        ground_map.build(
            cameras, at, np.concatenate(keyframe), np.concatenate(point), DriveHistory(poses, start=SE2()), surfaces
        )
        times.append(1e3 * (time.thread_time() - began))
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="lab", help="lab, office or corridor (default lab)")
    parser.add_argument("--seeds", default="100-109", metavar="A-B", help="worlds (default 100-109)")
    parser.add_argument("--seconds", type=float, default=60.0, help="emulated time of each exploration (default 60)")
    parser.add_argument("--sparse", action="store_true", help="explore by the sparse map; the dense one is not made")
    parser.add_argument("--rebuild", action="store_true", help="only time maps of many keyframes")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.rebuild:
        for n, size, must in ((300, (4.0, 2.5), 20), (3000, (18.0, 11.0), 200)):
            print(f"map of {n} keyframes: {rebuild(n, *size):.0f} ms cpu (must {must})")
        return
    first, _, last = args.seeds.partition("-")
    every = list[Run]()
    for seed in range(int(first), int(last or first) + 1):
        run = explored(args.world, generate_world(args.world, seed), seed, args.seconds, args.sparse)
        every.append(run)
        print(run.about)
        for k, name in enumerate(("sparse", "dense ")):
            print(words(name, [run.qualities[k]], [run.floor_m2[k]]), flush=True)
    print(f"all {len(every)}: median (worst); covered {np.mean([run.covered for run in every]):.3f} on average")
    for k, name in enumerate(("sparse", "dense ")):
        print(words(name, [run.qualities[k] for run in every], [run.floor_m2[k] for run in every]))
    total = [sum(run.planes[k] for run in every) for k in range(4)]
    off = np.median(np.concatenate([run.planes.errors_deg for run in every]))
    print(
        f"  planes: {total[1]}/{total[0]} faces recalled ({100 * total[1] / total[0]:.0f} %), {total[3]}/{total[2]} "
        f"spurious ({100 * total[3] / total[2]:.0f} %), normals {off:.2f} deg off"
    )


if __name__ == "__main__":
    main()
