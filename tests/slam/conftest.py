"""Drives of the emulated robot through a generated lab, rendered once per session."""

import math
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry, VelocityCommand
from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.world import Start, World

RATE_HZ = 15


class Drive(NamedTuple):
    camera: PinholeCamera
    T_base_cam: SE3
    frames: list[tuple[Frame, Odometry, SE3]]


def course(parts: list[tuple[float, float, float]]) -> np.ndarray:
    """(N, 2) positions of (v, omega, seconds) from the origin."""
    x = y = theta = 0.0
    out = [(0.0, 0.0)]
    for v, omega, seconds in parts:
        for _ in range(max(1, int(seconds / 0.1))):
            theta += omega * 0.1
            x, y = x + v * 0.1 * math.cos(theta), y + v * 0.1 * math.sin(theta)
            out.append((x, y))
    return np.array(out)


def clear_start(world: World, parts: list[tuple[float, float, float]]) -> Start:
    """A pose from which the course keeps its distance from everything; the clearest of 600 drawn ones."""
    segments = np.asarray(world.obstacle_segments(0.0, 0.45)).reshape(-1, 4)
    rng, path = np.random.default_rng(0), course(parts)
    x0, y0, x1, y1 = world.bounds
    best, chosen = -1.0, None
    for _ in range(600):
        x, y, theta = rng.uniform(x0, x1), rng.uniform(y0, y1), rng.uniform(-math.pi, math.pi)
        c, s = math.cos(theta), math.sin(theta)
        at = path @ np.array([[c, s], [-s, c]]) + [x, y]
        if at.min(axis=0)[0] < x0 or at.min(axis=0)[1] < y0 or at.max(axis=0)[0] > x1 or at.max(axis=0)[1] > y1:
            continue
        a, d = segments[:, :2], segments[:, 2:] - segments[:, :2]
        ratio = np.clip(((at[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-12), 0, 1)
        clearance = float(np.linalg.norm(at[:, None] - a - ratio[..., None] * d, axis=2).min())
        if clearance > best:
            best, chosen = clearance, Start(x=x, y=y, theta_rad=theta)
    assert chosen is not None
    assert best > 0.3, "the generated lab has no room for this course"
    return chosen


def record(
    seed: int,
    parts: list[tuple[float, float, float]],
    config: SimulationConfig = SimulationConfig(),  # noqa: B008 (immutable)
) -> Drive:
    world = generate_world("lab", seed)
    world = msgspec.structs.replace(world, start=clear_start(world, parts))
    robot = EmulatedRobot(world, seed, config)
    frames = []
    for v, omega, seconds in [(0.0, 0.0, 0.2), *parts]:
        for _ in range(round(seconds * RATE_HZ)):
            seen = robot.step(VelocityCommand(v, omega))
            frames.append((seen.frame, seen.odometry, robot.truth.T_world_cam))
    assert robot.truth.collisions == 0
    return Drive(robot.camera_given, robot.T_base_cam_given, frames)


@pytest.fixture(scope="session")
def arc_drive() -> Drive:
    """0.6 m straight, then 100 degrees on a radius of 0.4 m."""
    return record(12, [(0.2, 0.0, 3.0), (0.14, 0.35, 5.0)])


@pytest.fixture(scope="session")
def straight_drive() -> Drive:
    """1.6 m straight ahead."""
    return record(12, [(0.2, 0.0, 8.0)])


@pytest.fixture(scope="session")
def spin_drive() -> Drive:
    """0.6 m straight, then 90 degrees in place."""
    return record(13, [(0.2, 0.0, 3.0), (0.0, 0.26, 6.0)])


@pytest.fixture(scope="session")
def wrong_wheels_drive() -> Drive:
    """Weaving for 3 m by wheels that roll 10 % too far and a gyro that is 5 % and 1 deg/s wrong."""
    body = BodySettings(true_way=1.1, true_track=0.9, gyro_scale=1.05, gyro_zero_rad_s=math.radians(1.0))
    weave = [(0.2, 0.35, 2.5), (0.2, -0.35, 2.5)] * 2
    return record(12, [(0.2, 0.0, 3.0), *weave], SimulationConfig(body=body))
