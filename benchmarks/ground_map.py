"""How well the ground map shows obstacles, sparse and dense, with everything in the loop.

    PYTHONPATH=src:hw python benchmarks/ground_map.py [--world lab] [--seeds 100-102] [--seconds 90]
    PYTHONPATH=src:hw python benchmarks/ground_map.py --rebuild

Each world is explored with the dense map switched on; at the end the ground map is built from the same keyframes
without surfaces (the paper's sparse map) and with them. Both are held against the world at 10 cm. Faces count when
three keyframes saw them at 0.5 to 3.5 m. CPU: of one core, densifying a keyframe and building the last map.
``--rebuild`` times maps of made-up keyframes, 300 in 12 m x 8 m and 3000 in 40 m x 25 m.
"""

import argparse
import time

import cv2
import numpy as np

from vsx_ros.config import Config
from vsx_ros.dense.densify import Densifier
from vsx_ros.evaluation.obstacles import ObstacleQuality, obstacle_quality, seen_faces
from vsx_ros.geometry.camera import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.occupancy.surfaces import Surfaces
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.settings import SimulationConfig
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.system import ExplorationSystem


class TimedDensifier(Densifier):
    """Keeps the processor time of each update."""

    cpu_s: list[float]

    def update(self, snapshot, budget=None):
        began = time.thread_time()
        dense = super().update(snapshot, budget)
        self.cpu_s.append(time.thread_time() - began)
        return dense


def explored(kind: str, seed: int, seconds: float) -> tuple[list[ObstacleQuality], str]:
    """The qualities without and with surfaces, and a line about the run."""
    config, world = Config(), generate_world(kind, seed)
    robot = EmulatedRobot(world, seed, SimulationConfig(threads=1), config.robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, seed)
    system._densifier = densifier = TimedDensifier(robot.camera_given, robot.T_base_cam_given, config.dense, seed)
    densifier.cpu_s = []
    command, truth_of = STOP, dict[int, SE3]()
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > seconds:
            break
        truth_of[frame.stamp_ns] = robot.truth.T_world_cam
        command = system.step(frame, odometry, "bumper pressed" if any(robot.body.bumper) else None).command
    snapshot, ground = system.slam.snapshot(), config.ground_map
    truth = ground_truth_grid(world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m)
    faces = seen_faces(truth, [truth_of[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()])
    qualities, times = [], []
    for with_surfaces in (False, True):
        began = time.thread_time()
        grid = system.ground.grid(snapshot, with_surfaces)
        times.append(1e3 * (time.thread_time() - began))
        qualities.append(obstacle_quality(grid, truth, faces, world.start_pose))
    cpu = densifier.cpu_s
    line = (
        f"{kind} {seed}: {len(snapshot.keyframe_ids)} keyframes, {np.count_nonzero(faces)} cells of faces seen, "
        f"{robot.truth.path_length_m:.0f} m, {robot.truth.collisions} collisions, mission {system.mission.outcome}; "
        f"densify {np.median(cpu):.2f} s (p95 {np.quantile(cpu, 0.95):.2f}), map {times[0]:.0f} and {times[1]:.0f} ms"
    )
    return qualities, line


def words(name: str, of: list[ObstacleQuality]) -> str:
    """Medians, and the worst in brackets."""

    def two(values: list[float], worst: float) -> str:
        return f"{np.median(values):.3f} ({worst:.3f})"

    f1, into = [q.f1 or 0.0 for q in of], [q.free_inside or 0.0 for q in of]
    surface = [q.surface_free or 0.0 for q in of]
    return (
        f"  {name}: F1 {two(f1, min(f1))}, precision {np.median([q.precision for q in of]):.3f}, recall "
        f"{np.median([q.recall for q in of]):.3f}, surface called free {two(surface, max(surface))}, free inside "
        f"{two(into, max(into))}, phantom {two([q.phantom_m2 for q in of], max(q.phantom_m2 for q in of))} m2"
    )


def rebuild(n: int, half_length_m: float, half_width_m: float) -> float:
    """Processor time [ms] of a map of n keyframes along a way through a room."""
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
            cameras, at, np.concatenate(keyframe), np.concatenate(point), trail=poses, start=SE2(), surfaces=surfaces
        )
        times.append(1e3 * (time.thread_time() - began))
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="lab", help="lab, office or corridor (default lab)")
    parser.add_argument("--seeds", default="100-102", metavar="A-B", help="worlds (default 100-102)")
    parser.add_argument("--seconds", type=float, default=90.0, help="emulated time of each exploration (default 90)")
    parser.add_argument("--rebuild", action="store_true", help="only time maps of many keyframes")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.rebuild:
        for n, size, must in ((300, (4.0, 2.5), 20), (3000, (18.0, 11.0), 200)):
            print(f"map of {n} keyframes: {rebuild(n, *size):.0f} ms cpu (must {must})")
        return
    first, _, last = args.seeds.partition("-")
    every = list[list[ObstacleQuality]]()
    for seed in range(int(first), int(last or first) + 1):
        qualities, line = explored(args.world, seed, args.seconds)
        every.append(qualities)
        print("\n".join([line, words("sparse", qualities[:1]), words("dense ", qualities[1:])]), flush=True)
    print(f"all {len(every)}: median (worst)")
    print("\n".join(words(name, [pair[k] for pair in every]) for k, name in enumerate(("sparse", "dense "))))


if __name__ == "__main__":
    main()
