"""Pictures of a few rectangles, cast ray by ray: what the dense room is shown where the truth must be exact."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.snapshot import MapSnapshot

CAMERA = PinholeCamera(320, 240, 260.0, 260.0, 159.5, 119.5)
MOUNT = mount_pose(0.0, 0.0, 0.4, 0.1)


class Rectangle(NamedTuple):
    """corner, right and up (3,) [m], size (2,) [m], grey: mean, contrast, seed of a random texture of 2 cm texels;
    stripes: along the right axis alone constant."""

    corner: tuple[float, float, float]
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    size: tuple[float, float]
    grey: float
    contrast: float
    seed: int
    stripes: bool = False

    def shade(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(self.seed)
        table = rng.uniform(-1.0, 1.0, (600, 600))
        if self.stripes:
            table[:] = table[:1]
        a, b = np.clip(a / 0.02, 0, 598), np.clip(b / 0.02, 0, 598)
        i, j = a.astype(int), b.astype(int)
        fa, fb = a - i, b - j
        low = table[i, j] * (1 - fa) + table[i + 1, j] * fa
        high = table[i, j + 1] * (1 - fa) + table[i + 1, j + 1] * fa
        return self.grey + self.contrast * (low * (1 - fb) + high * fb)


def wall(x: float, y_from: float, y_to: float, height: float, **look: object) -> Rectangle:
    """A wall across the x axis, seen from the origin."""
    return Rectangle((x, y_to, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (y_to - y_from, height), **look)


def floor(**look: object) -> Rectangle:
    return Rectangle((-1.0, 5.0, 0.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (10.0, 11.0), **look)


def pose(x: float, y: float, theta: float) -> SE3:
    """T_world_cam of the camera on a base at x, y, theta."""
    c, s = math.cos(theta), math.sin(theta)
    base = SE3(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))
    return base @ MOUNT


DRIVE = [pose(0.2 * k, y, 0.25 * -y) for k in range(4) for y in (-0.45, -0.15, 0.15, 0.45)]


def picture(scene: list[Rectangle], T_world_cam: SE3) -> np.ndarray:
    """(240, 320) uint8; black where nothing is."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = CAMERA.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float)) @ T_world_cam.rotation.T
    eye = T_world_cam.translation
    grey, nearest = np.zeros(len(rays)), np.full(len(rays), np.inf)
    for piece in scene:
        corner, right, up = (np.array(a) for a in (piece.corner, piece.right, piece.up))
        normal = np.cross(right, up)
        along = rays @ normal
        depth = np.where(np.abs(along) > 1e-9, ((corner - eye) @ normal) / np.where(along == 0.0, 1.0, along), -1.0)
        at = eye + depth[:, None] * rays - corner
        a, b = at @ right, at @ up
        hit = (depth > 0) & (depth < nearest) & (a >= 0) & (a <= piece.size[0]) & (b >= 0) & (b <= piece.size[1])
        grey[hit], nearest[hit] = piece.shade(a[hit], b[hit]), depth[hit]
    return np.rint(np.clip(grey, 0, 255)).astype(np.uint8).reshape(v.shape)


def snapshot(scene: list[Rectangle], poses: list[SE3], points: np.ndarray, version: int = 1) -> MapSnapshot:
    """A map of points (N, 3), which all keyframes see that have them in front and in the picture."""
    keyframe, point, uv = [], [], []
    for k, T in enumerate(poses):
        pixels = CAMERA.project(T.inverse() @ points)
        inside = np.flatnonzero(((pixels > 5) & (pixels < [CAMERA.width - 6, CAMERA.height - 6])).all(axis=1))
        keyframe.append(np.full(len(inside), k))
        point.append(inside)
        uv.append(pixels[inside])
    n = len(poses)
    return MapSnapshot(
        version,
        np.arange(n),
        np.arange(n) * 10**8,
        tuple(poses),
        tuple(picture(scene, T) for T in poses),
        np.arange(len(points)),
        points,
        np.concatenate([np.zeros(0, np.int32), *keyframe]).astype(np.int32),
        np.concatenate([np.zeros(0, np.int32), *point]).astype(np.int32),
        np.concatenate([np.zeros((0, 2)), *uv]),
        np.zeros(sum(map(len, point)), np.int8),
    )
