"""Shapes of SDF as triangles, and poses as 4 x 4 matrices."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray

PLANE_MOST_M = 200.0  # of a plane's side: Gazebo draws its ground_plane without end
_ROUND = 24  # faces of a cylinder


class Triangles(NamedTuple):
    """corners (T, 3, 3) [m]; uv (T, 3, 2), v upwards, repeating."""

    corners: FloatArray
    uv: FloatArray


def pose_matrix(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> FloatArray:
    """(4, 4) of an SDF pose: metres, and radians about the fixed axes x, y, z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def quaternion_matrix(x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float) -> FloatArray:
    """(4, 4) of a position [m] and a quaternion, which need not have length 1."""
    n = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw) or 1.0
    a, b, c, w = qx / n, qy / n, qz / n, qw / n
    return np.array(
        [
            [1 - 2 * (b * b + c * c), 2 * (a * b - c * w), 2 * (a * c + b * w), x],
            [2 * (a * b + c * w), 1 - 2 * (a * a + c * c), 2 * (b * c - a * w), y],
            [2 * (a * c - b * w), 2 * (b * c + a * w), 1 - 2 * (a * a + b * b), z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def inverse(T: FloatArray) -> FloatArray:
    """Of a pose (4, 4)."""
    return np.asarray(np.linalg.inv(T), float)


def placed(corners: FloatArray, T: FloatArray) -> FloatArray:
    """(T, 3, 3) corners moved by a (4, 4) matrix."""
    return np.asarray(corners @ T[:3, :3].T + T[:3, 3])


def _quads(corners: FloatArray, uv: FloatArray) -> Triangles:
    """(Q, 4, 3) and (Q, 4, 2), counter-clockwise from outside, as two triangles each."""
    order = [0, 1, 2, 0, 2, 3]
    return Triangles(corners[:, order].reshape(-1, 3, 3), uv[:, order].reshape(-1, 3, 2))


def box(x: float, y: float, z: float) -> Triangles:
    """A cuboid centred at the origin; each face shows the whole texture."""
    faces, uv = _unit_box()
    return _quads(faces * (0.5 * np.array([x, y, z])), uv)


@cache
def _unit_box() -> tuple[FloatArray, FloatArray]:
    """Of half sides 1: (6, 4, 3) corners and (6, 4, 2) uv."""
    faces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            n, u = np.zeros(3), np.zeros(3)
            n[axis], u[(axis + 1) % 3] = sign, 1.0
            v = np.cross(n, u)
            faces.append([n - u - v, n + u - v, n + u + v, n - u + v])
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return np.array(faces), np.repeat(uv[None], 6, axis=0)


def plane(normal: FloatArray, size_x: float, size_y: float) -> Triangles:
    """A rectangle through the origin, at most ``PLANE_MOST_M`` wide; one texture a metre."""
    n = normal / max(float(np.linalg.norm(normal)), 1e-12)
    side = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    u = side - n * (n @ side)
    u /= np.linalg.norm(u)
    half = 0.5 * np.minimum([size_x, size_y], PLANE_MOST_M)
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    corners = signs[:, :1] * u + signs[:, 1:] * np.cross(n, u)
    return _quads(corners[None], signs[None])


def cylinder(radius: float, length: float) -> Triangles:
    """A prism of 24 faces about z, centred at the origin."""
    angles = np.arange(_ROUND + 1) * (2.0 * math.pi / _ROUND)
    ring = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(_ROUND + 1)])
    up = np.array([0.0, 0.0, 0.5 * length])
    low, high = ring - up, ring + up
    turn = np.arange(_ROUND + 1) / _ROUND
    sides = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    edges = [np.column_stack([t, np.full(_ROUND, v)]) for t, v in zip((turn[:-1], turn[1:]) * 2, (0.0, 0.0, 1.0, 1.0))]
    wall = _quads(sides, np.stack([edges[0], edges[1], edges[3], edges[2]], axis=1))
    caps = [
        np.stack([np.broadcast_to(up, (_ROUND, 3)), high[:-1], high[1:]], axis=1),
        np.stack([np.broadcast_to(-up, (_ROUND, 3)), low[1:], low[:-1]], axis=1),
    ]
    corners = np.concatenate([wall.corners, *caps])
    flat = np.concatenate(caps)[..., :2] / (2.0 * radius) + 0.5
    return Triangles(corners, np.concatenate([wall.uv, flat]))


def sphere(radius: float) -> Triangles:
    """A globe of 24 x 12 faces, centred at the origin."""
    lon, lat = np.arange(_ROUND + 1) / _ROUND, np.arange(_ROUND // 2 + 1) / (_ROUND // 2)
    u, v = np.meshgrid(lon, lat)
    a, b = 2.0 * math.pi * u, math.pi * (v - 0.5)
    points = radius * np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    uv = np.stack([u, v], axis=-1)
    corners, texture = (
        np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2).reshape(-1, 4, grid.shape[-1])
        for grid in (points, uv)
    )
    return _quads(corners, texture)
