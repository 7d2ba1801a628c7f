"""Robust six-degree pose of one image from its matches."""

from __future__ import annotations

from typing import NamedTuple

from vsx_ros.arrays import BoolArray, FloatArray, Pixels, Points3
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam.pose import optimize_pose
from vsx_ros.vision.patch_search import Predictions

SIGMA_MIN_PX = 0.4


class PoseEstimate(NamedTuple):
    """weights (S,): Tukey weight per prediction, 0 is an outlier or was not found. information (6, 6): inverse
    covariance in the camera's tangent (translation, rotation)."""

    T_cam_world: SE3
    weights: FloatArray
    information: FloatArray
    sigma_px: float


def optimized(
    camera: FloatArray,
    start: SE3,
    points: Points3,
    predictions: Predictions,
    found: BoolArray,
    uv: Pixels,
    prior: FloatArray,
    effort: tuple[int, int],
) -> PoseEstimate:
    """Gauss-Newton with Tukey weights (PTAM 1.4) from the predictions found (S,) at uv (S, 2) px of an image, of points
    (P, 3) world. camera (18,): the image's; prior (6,): diagonal information that pulls towards the start; effort:
    iterations that accept residuals of many pixels, and iterations in all."""
    R, t, weights, information, sigma = optimize_pose(
        camera,
        start.rotation,
        start.translation,
        points,
        predictions.rows,
        uv,
        predictions.level,
        found,
        prior,
        *effort,
        SIGMA_MIN_PX,
    )
    return PoseEstimate(SE3(R, t), weights, information, float(sigma))
