"""Points from two views."""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import FloatArray, Points2, Points3
from vsx_ros.geometry.se3 import SE3


def triangulate(T_b_a: SE3, rays_a: Points2, rays_b: Points2) -> tuple[Points3, FloatArray]:
    """Linear triangulation of rays on the planes z = 1 of two cameras.

    T_b_a: camera a in b. rays (N, 2). Returns (points_a (N, 3) in camera a, parallax (N,) [rad]). Points may lie
    behind a camera or be non-finite where the rays are parallel: the caller checks.
    """
    R, t = T_b_a.rotation, T_b_a.translation
    a, b = np.column_stack([rays_a, np.ones(len(rays_a))]), np.column_stack([rays_b, np.ones(len(rays_b))])
    turned = a @ R.T
    # z_b b = z_a R a + t: eliminate z_b by the cross product with b, least squares in 1 / z_a's reciprocal.
    left, right = np.cross(b, turned), -np.cross(b, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (left * right).sum(axis=1) / (left * left).sum(axis=1)
    sine = np.linalg.norm(left, axis=1) / (np.linalg.norm(turned, axis=1) * np.linalg.norm(b, axis=1))
    return a * depth[:, None], np.arcsin(np.clip(sine, 0.0, 1.0))


def reprojection_error(T_c_w: SE3, points: Points3, rays: Points2) -> FloatArray:
    """(N,) distance on the plane z = 1 between points (N, 3) seen from c and rays (N, 2); infinite behind the
    camera."""
    cam = T_c_w @ points
    with np.errstate(divide="ignore", invalid="ignore"):
        error: FloatArray = np.linalg.norm(cam[:, :2] / cam[:, 2:] - rays, axis=1)
    error[~(cam[:, 2] > 0)] = np.inf
    return np.nan_to_num(error, nan=np.inf, posinf=np.inf)
