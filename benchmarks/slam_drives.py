"""Drives of the emulated robot along given courses, with the truth: the input of the SLAM benchmarks.

Everything is as in the standard emulator: generated labs, the Kinect's lens, rolling shutter, exposure, noise and
motion blur, a slightly wrong calibration and mount, wheels and gyro calibrated to 0.5 % and 0.3 %, slip. Only the
steering is idealised: it uses the true pose, so that the course is the same in every world.
"""

import itertools
import math
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.planning.path import Path as Way
from vsx_ros.planning.path import Plan
from vsx_ros.planning.planner import Planner
from vsx_ros.robot import Frame, Odometry, VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import Start, World

EMULATION = SimulationConfig()
RATE_HZ = EMULATION.frame_rate_hz
DRAWS = 1000
CLEAR_M = 0.28
TOUR_M, DEAD_END_AFTER = 26.0, 30
STEER_LATERAL, STEER_HEADING = 8.0, 4.0


class Leg(NamedTuple):
    """length_m ahead while turning by turn_rad (at most half a turn); on the spot if length_m is 0; then standing for
    rest_s. step: metres per frame, or radians per frame on the spot."""

    length_m: float
    turn_rad: float = 0.0
    rest_s: float = 0.0
    step: float = 0.01


class Drive(NamedTuple):
    """images (N, H, W) uint8; odometry (N, 6): x, y, theta, v, omega, turn by the wheels, at the stamp; truth (N, 4,
    4): T_world_cam."""

    camera: PinholeCamera
    T_base_cam: SE3
    stamps_ns: list[int]
    images: np.ndarray
    odometry: np.ndarray
    truth: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def frame(self, k: int) -> Frame:
        return Frame(self.stamps_ns[k], self.images[k])

    def odometry_at(self, k: int) -> Odometry:
        x, y, theta, v, omega, wheel_turn = self.odometry[k].tolist()
        return Odometry(self.stamps_ns[k], SE2(x, y, theta), v, omega, wheel_turn=wheel_turn)

    def true_pose(self, k: int) -> SE3:
        return SE3.from_matrix(self.truth[k])


def seconds_to_frames(seconds: float) -> int:
    return round(seconds * RATE_HZ)


def driven(start: SE2, leg: Leg, share: float) -> SE2:
    """The pose after this share of the leg."""
    return start @ SE2.exp(share * leg.length_m, share * leg.turn_rad)


def course(legs: list[Leg]) -> np.ndarray:
    """(N, 2) positions from the origin, every 10 cm."""
    at, out = SE2(), [(0.0, 0.0)]
    for leg in legs:
        n = max(1, math.ceil(leg.length_m / 0.1))
        out += [(p.x, p.y) for p in (driven(at, leg, (k + 1) / n) for k in range(n))]
        at = driven(at, leg, 1.0)
    return np.array(out)


def clearest_start(world: World, legs: list[Leg]) -> tuple[float, Start]:
    """(distance to the nearest obstacle [m], pose) of the clearest of some drawn places for the course."""
    segments = np.asarray(world.obstacle_segments(0.0, RobotConfig().height_m)).reshape(-1, 4)
    a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
    rng, path = np.random.default_rng(0), course(legs)
    x0, y0, x1, y1 = world.bounds
    best, chosen = -1.0, Start(x=0.0, y=0.0, theta_rad=0.0)
    for _ in range(DRAWS):
        x, y, theta = rng.uniform(x0, x1), rng.uniform(y0, y1), rng.uniform(-math.pi, math.pi)
        c, s = math.cos(theta), math.sin(theta)
        at = path @ np.array([[c, s], [-s, c]]) + [x, y]
        if (at.min(axis=0) < (x0, y0)).any() or (at.max(axis=0) > (x1, y1)).any():
            continue
        ratio = np.clip(((at[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-12), 0, 1)
        clearance = float(np.linalg.norm(at[:, None] - a - ratio[..., None] * d, axis=2).min())
        if clearance > best:
            best, chosen = clearance, Start(x=x, y=y, theta_rad=theta)
    return best, chosen


def command(start: SE2, leg: Leg, pose: SE2) -> VelocityCommand | None:
    """Steering along the leg from the true pose; None at its end."""
    if leg.length_m == 0.0:
        left = leg.turn_rad - (pose.theta - start.theta)
        done = left * leg.turn_rad <= 0.0
        return None if done else VelocityCommand(0.0, math.copysign(leg.step * RATE_HZ, leg.turn_rad))
    local = start.inverse() @ pose
    curvature = leg.turn_rad / leg.length_m
    along, aside, heading = local.x, local.y, local.theta
    if curvature:
        side, radius = math.copysign(1.0, curvature), 1.0 / abs(curvature)
        angle = math.atan2(local.x, radius - side * local.y)
        along, aside = radius * angle, side * (radius - math.hypot(local.x, radius - side * local.y))
        heading = local.theta - side * angle
    if along >= leg.length_m:
        return None
    v = leg.step * RATE_HZ
    heading = math.remainder(heading, 2.0 * math.pi)
    return VelocityCommand(v, v * (curvature - STEER_LATERAL * aside - STEER_HEADING * heading))


def record(
    world: World, seed: int, legs: list[Leg], config: SimulationConfig = EMULATION,
    prepare: Callable[[EmulatedRobot], None] = lambda robot: None,
) -> Drive:  # fmt: skip
    """Drive the course from the world's start pose, with the robot as ``prepare`` leaves it. Raises RuntimeError when
    the robot touches something."""
    robot = EmulatedRobot(world, seed, config)
    prepare(robot)
    seen, truth = [], []

    def step(wanted: VelocityCommand) -> None:
        seen.append(robot.step(wanted))
        truth.append(robot.truth.T_world_cam.matrix())

    for _ in range(3):
        step(VelocityCommand(0.0, 0.0))
    planned = world.start_pose
    for leg in legs:
        while (wanted := command(planned, leg, robot.truth.T_world_base)) is not None:
            step(wanted)
        for _ in range(seconds_to_frames(leg.rest_s)):
            step(VelocityCommand(0.0, 0.0))
        planned = driven(planned, leg, 1.0)
    if robot.truth.collisions:
        raise RuntimeError(f"seed {seed}: the robot touched something; the course needs more room")
    odometry = [(*o.T_odom_base.as_array().tolist(), o.v, o.omega, o.wheel_turn or 0.0) for _, o in seen]
    images = np.stack([frame.image for frame, _ in seen])
    stamps = [frame.stamp_ns for frame, _ in seen]
    return Drive(robot.camera_given, robot.T_base_cam_given, stamps, images, np.array(odometry), np.array(truth))


def kept(name: str, keep: Path | None, make: Callable[[], Drive | None]) -> Drive | None:
    """The drive of that name from the folder ``keep``; else a new one, which is stored there."""
    file = keep / f"{name}.pickle" if keep else None
    if file and file.exists():
        found: Drive = pickle.loads(file.read_bytes())
        return found
    drive = make()
    if file and drive:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(drive, protocol=5))
    return drive


def lab_drive(
    name: str, seed: int, courses: list[list[Leg]], keep: Path | None, config: SimulationConfig = EMULATION
) -> Drive | None:
    """The first course that fits into lab ``seed``, driven from its clearest place; None if none fits."""

    def make() -> Drive | None:
        world = generate_world("lab", seed)
        for legs in courses:
            clearance, start = clearest_start(world, legs)
            if clearance >= CLEAR_M:
                return record(msgspec.structs.replace(world, start=start), seed, legs, config)
        print(f"{name}, seed {seed}: no room for the course, left out", file=sys.stderr)
        return None

    return kept(f"{name}_{seed}", keep, make)


def tour_legs(world: World, seed: int, length_m: float) -> list[Leg]:
    """Planned paths (1 rad/m, forward only) between random places until the length is reached; a path into a dead end
    is removed."""
    grid = ground_truth_grid(world, 0.05, 0.0, RobotConfig().height_m)
    planner, rng = Planner(PlannerConfig(), RobotConfig()), np.random.default_rng(seed)
    x0, y0, x1, y1 = world.bounds
    ways, vain = list[Way](), 0
    while sum(way.length_m for way in ways) < length_m:
        at = ways[-1].end.wrapped() if ways else world.start_pose
        goal = SE2(rng.uniform(x0, x1), rng.uniform(y0, y1), rng.uniform(-math.pi, math.pi))
        plan = planner.plan(at, goal, grid, np.random.default_rng(1))
        if isinstance(plan, Plan) and not plan.path.reverse_m and not plan.path.turn_on_spot_rad:
            ways.append(plan.path)
            vain = 0
        elif (vain := vain + 1) == DEAD_END_AFTER:
            ways, vain = ways[:-1], 0
    legs = list[Leg]()
    for way in ways:
        for (xa, ya, ta), (xb, yb, tb) in itertools.pairwise(way.sample(0.05)[:, :3].tolist()):
            if (xa, ya) != (xb, yb) and sum(leg.length_m for leg in legs) < length_m:
                legs.append(Leg(math.hypot(xb - xa, yb - ya), tb - ta))
    return legs


def tour_drive(seed: int, keep: Path | None) -> Drive:
    """A long path through an office at 1 cm per frame."""
    world = generate_world("office", seed)
    drive = kept(f"tour_{seed}", keep, lambda: record(world, seed, tour_legs(world, seed, TOUR_M)))
    assert drive is not None
    return drive
