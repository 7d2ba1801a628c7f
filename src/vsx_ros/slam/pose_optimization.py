"""Robust six-degree pose of one image from its matches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Pixels, Points3
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.pose import optimize_pose
from vsx_ros.kernels.projection import unproject_pixels
from vsx_ros.vision.patch_search import kernel_camera

SIGMA_MIN_PX = 0.4


class PoseEstimate(NamedTuple):
    """weights (N,): Tukey weight per match, 0 is an outlier. information (6, 6): inverse covariance in the camera's
    tangent (translation, rotation)."""

    T_cam_world: SE3
    weights: FloatArray
    information: FloatArray
    sigma_px: float


class PoseOptimizer:
    """Gauss-Newton with Tukey weights (PTAM 1.4), on pixels freed from distortion."""

    def __init__(self, camera: PinholeCamera) -> None:
        self._K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._array = kernel_camera(camera)

    def optimize(self, start: SE3, points: Points3, uv: Pixels, level: IntArray, prior: FloatArray) -> PoseEstimate:
        """T_cam_world of matches: points (N, 3) world, uv (N, 2) distorted px, level (N,); prior (6,): diagonal
        information that pulls towards the start."""
        plane = unproject_pixels(self._array, uv)
        R, t, weights, information, sigma = optimize_pose(
            self._K,
            start.rotation,
            start.translation,
            points,
            plane * self._K[:2] + self._K[2:],
            0.5 ** level.astype(float),
            prior,
            12,
            SIGMA_MIN_PX,
        )
        return PoseEstimate(SE3(R, t), weights, information, float(sigma))
