"""Bundle adjustment problems with known truth: a camera that turns on a ring, and drives around a building."""

from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.templates import NewTemplates

K = np.array([525.0, 525.0, 319.5, 239.5])
CAMERA = PinholeCamera(640, 480, *K.tolist())
MOUNT = mount_pose(0.0, 0.0, 0.3, 0.0, 0.0)


class Problem(NamedTuple):
    """truth: T_cam_world; true_points (M, 3), in the order in which they are first seen; point (O,), sorted, frame
    (O,), xy (O, 2) px: the observations; poses, points: initial values of the adjustment."""

    truth: list[SE3]
    true_points: np.ndarray
    point: np.ndarray
    frame: np.ndarray
    xy: np.ndarray
    poses: list[SE3]
    points: np.ndarray

    def pose_error_m(self, poses: list[SE3]) -> float:
        """Median distance of cameras from the truth."""
        pairs = zip(poses, self.truth, strict=True)
        return float(np.median([np.linalg.norm(a.inverse().translation - b.inverse().translation) for a, b in pairs]))


def _seen(truth: list[SE3], points: np.ndarray, nearest_m: float, farthest_m: float) -> tuple[np.ndarray, np.ndarray]:
    """(frames, points) bool: in the image and within range; (frames, points, 2) px."""
    seen, uv = [], []
    for T in truth:
        cam = points @ T.rotation.T + T.translation
        ok = (cam[:, 2] > nearest_m) & (cam[:, 2] < farthest_m)
        pixel = cam[:, :2] / np.where(ok, cam[:, 2], 1.0)[:, None] * K[:2] + K[2:]
        seen.append(ok & (pixel > 0).all(axis=1) & (pixel < [640, 480]).all(axis=1))
        uv.append(pixel)
    return np.array(seen), np.array(uv)


def _problem(
    truth: list[SE3],
    points: np.ndarray,
    seen: np.ndarray,
    uv: np.ndarray,
    rng: np.random.Generator,
    pose_sigma: np.ndarray,
    point_sigma_m: float,
    gross_share: float = 0.03,
) -> Problem:
    """Noise of 0.6 px and a share of gross outliers of 30 px; the first two cameras start at the truth."""
    seen = seen & (seen.sum(axis=0) >= 2)
    kept = np.flatnonzero(seen.any(axis=0))
    kept = kept[np.argsort(seen[:, kept].argmax(axis=0), kind="stable")]
    point, frame = np.nonzero(seen[:, kept].T)
    noise = rng.normal(0, 0.6, (len(point), 2))
    gross = rng.random(len(point)) < gross_share
    noise[gross] = rng.normal(0, 30.0, (int(gross.sum()), 2))
    poses = [T if k < 2 else SE3.exp(rng.normal(0, 1, 6) * pose_sigma) @ T for k, T in enumerate(truth)]
    start = points[kept] + rng.normal(0, point_sigma_m, (len(kept), 3))
    return Problem(truth, points[kept], point, frame, uv[frame, kept[point]] + noise, poses, start)


def ring(frames: int, points: int, observations: int, seed: int = 0, gross_share: float = 0.03) -> Problem:
    """Cameras on a circle of 2 m, 3.6 degrees apart, looking outwards at points 4 to 7 m from its centre. About
    ``observations`` of the visible points are observed. The cameras start 17 mm off."""
    rng, step = np.random.default_rng(seed), np.deg2rad(3.6)
    truth = [
        (SE3.from_se2(SE2(2.0 * np.cos(step * k), 2.0 * np.sin(step * k), step * k)) @ MOUNT).inverse()
        for k in range(frames)
    ]
    margin = 0.0 if frames >= 100 else 0.3
    angle, distance = rng.uniform(-margin, step * frames + margin, points), rng.uniform(4.0, 7.0, points)
    height = rng.uniform(-0.8, 1.4, points)
    cloud = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), height])
    seen, uv = _seen(truth, cloud, 0.5, 20.0)
    seen &= rng.random(seen.shape) < observations / seen.sum()
    return _problem(truth, cloud, seen, uv, rng, np.full(6, 0.01) * [1, 1, 1, 0.7, 0.7, 0.7], 0.05, gross_share)


def _walls(half_x: float, half_y: float, inwards: float) -> list[tuple[float, ...]]:
    """x0, y0, x1, y1 and normal of a rectangle's sides."""
    x, y, n = half_x, half_y, inwards
    return [(-x, -y, x, -y, 0, n), (x, -y, x, y, -n, 0), (x, y, -x, y, 0, -n), (-x, y, -x, -y, n, 0)]


def building(frames: int, points: int, per_frame: int, seed: int = 0) -> Problem:
    """A drive around a corridor of 4 m around a block of 8 m x 4 m; 0.2 m per keyframe, 36 m per lap. Points on the
    walls are seen up to 7 m away, each with its own probability. Initial errors as after local adjustment: 5 mm, and 3
    cm in the points."""
    rng = np.random.default_rng(seed)
    walls = np.array(_walls(8.0, 6.0, 1.0) + _walls(4.0, 2.0, -1.0))
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    wall = walls[rng.choice(len(walls), points, p=length / length.sum())]
    along, normal = rng.random((points, 1)), wall[:, 4:]
    flat = wall[:, :2] + along * (wall[:, 2:4] - wall[:, :2]) + normal * rng.uniform(0.0, 0.5, (points, 1))
    cloud = np.column_stack([flat, rng.uniform(0.0, 2.5, points)])
    truth = []
    for d in 0.2 * np.arange(frames):
        a = 2.0 * np.pi * d / 36.0
        heading = np.arctan2(4.0 * np.cos(a), -6.0 * np.sin(a)) + 0.3 * np.sin(1.3 * d)
        base = SE2(6.0 * np.cos(a) + 0.2 * np.sin(0.7 * d), 4.0 * np.sin(a), float(heading))
        truth.append((SE3.from_se2(base) @ MOUNT).inverse())
    seen, uv = _seen(truth, cloud, 0.4, 7.0)
    for k, T in enumerate(truth):
        view = flat - T.inverse().translation[:2]
        seen[k] &= -(view * normal).sum(axis=1) > 0.1 * np.linalg.norm(view, axis=1)
    strength = np.where(seen, rng.beta(2, 3, points), 0.0)
    seen &= rng.random(seen.shape) < strength * np.minimum(1.0, per_frame / strength.sum(axis=1))[:, None]
    return _problem(truth, cloud, seen, uv, rng, 0.005 * np.array([1, 1, 1, 0.3, 0.3, 0.3]), 0.03)


def driven_map(problem: Problem, seed: int = 0) -> Map:
    """The problem as a SLAM map, with wheel errors of 0.5 % and 2 mrad per step."""
    rng, world = np.random.default_rng(seed), Map()
    bases = [(T.inverse() @ MOUNT.inverse()).to_se2() for T in problem.truth]
    wheels = bases[0]
    for k, T in enumerate(problem.poses):
        if k:
            step = bases[k - 1].inverse() @ bases[k]
            slip = rng.normal(0, 1, 3) * [0.001, 0.0005, 0.002]
            wheels = wheels @ SE2(1.005 * step.x + slip[0], step.y + slip[1], step.theta + slip[2])
        world.add_keyframe(FrameData.without_image(k, wheels), T.inverse(), Observations.none())
    first = problem.frame[np.searchsorted(problem.point, np.arange(len(problem.points)))]
    for k in range(len(problem.poses)):
        made = problem.points[first == k]
        templates = NewTemplates(
            np.zeros((len(made), 4)), np.zeros((len(made), 2)), np.zeros((len(made), PATCH, PATCH), np.uint8)
        )
        world.add_points(made, templates, k)
        mine = problem.frame == k
        uv, level = problem.xy[mine], np.zeros(int(mine.sum()), np.int64)
        world.observe(k, Observations(problem.point[mine], uv, uv, level))
    return world
