"""A map of given surfaces, seen by keyframes with the noise of a corner detector."""

import numpy as np

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.snapshot import MapSnapshot

FOCAL_PX = 520.0


def looking(x: float, y: float, yaw: float) -> SE3:
    """T_world_cam of a camera 0.3 m above the floor."""
    forward, left = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return SE3(np.column_stack([-left, [0.0, 0.0, -1.0], forward]), np.array([x, y, 0.3]))


def on_wall(a: tuple[float, float], b: tuple[float, float], count: int, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) points of the wall above the segment from a to b, 0.1 to 1.2 m high."""
    share = rng.random(count)[:, None]
    return np.column_stack([np.array(a) + share * (np.array(b) - np.array(a)), rng.uniform(0.1, 1.2, count)])


def on_floor(count: int, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) points of the floor in front."""
    return np.column_stack([rng.uniform(0.5, 2.5, count), rng.uniform(-1.0, 1.0, count), np.zeros(count)])


def seen(
    points: np.ndarray, cameras: list[SE3], rng: np.random.Generator, watchers: np.ndarray | None = None,
    noise_px: float = 0.4, first_id: int = 0,
) -> MapSnapshot:  # fmt: skip
    """Every keyframe sees every point, or those that watchers (N, K) says; the points are off as far as that makes
    them. first_id: of the points."""
    centres = np.array([T.translation for T in cameras])
    watchers = np.ones((len(points), len(cameras)), bool) if watchers is None else watchers
    noisy = points.copy()
    for i, point in enumerate(points):
        rays = centres[watchers[i]] - point
        r = np.linalg.norm(rays, axis=1)
        d = rays / r[:, None]
        information = ((FOCAL_PX / (r * noise_px)) ** 2)[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
        noisy[i] += np.linalg.cholesky(np.linalg.inv(information.sum(axis=0))) @ rng.normal(size=3)
    point, keyframe = (index.astype(np.int32) for index in np.nonzero(watchers))
    order = np.argsort(keyframe, kind="stable")
    k, n = len(cameras), len(order)
    image = np.zeros((48, 64), np.uint8)
    return MapSnapshot(
        1, np.arange(k), np.arange(k), tuple(cameras), (image,) * k, first_id + np.arange(len(points)), noisy,
        keyframe[order], point[order], np.zeros((n, 2)), np.zeros(n, np.int8),
    )  # fmt: skip


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Between two unit vectors."""
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))
