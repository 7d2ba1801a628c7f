"""Two views of a rigid scene: essential matrix, homography, the motions they allow, and points from both."""

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, Points2, Points3
from vsx_ros.geometry.se3 import SE3, skew

_CHI2_LINE, _CHI2_POINT = 3.84, 5.99  # 95 % of chi-squared, one and two degrees of freedom (as ORB-SLAM)


def two_view_motions(rays_a: Points2, rays_b: Points2, tolerance: float) -> list[SE3]:
    """Motions T_b_a with unit translation that explain matched rays (N, 2) on the planes z = 1, N >= 8, that of the
    essential matrix first; tolerance: standard deviation on that plane.

    Five-point essential matrix (Nister 2004) with local optimisation (Barath and Matas 2018), because plain RANSAC may
    stop at a wrong one, and homography. Both use OpenCV's fixed seed and are compared by truncated chi-square scores
    (Mur-Artal et al. 2015). A planar scene also yields the decompositions of the homography."""
    E, mask = cv2.findEssentialMat(rays_a, rays_b, np.eye(3), cv2.USAC_ACCURATE, 0.999, tolerance)
    H, _ = cv2.findHomography(rays_a, rays_b, cv2.RANSAC, 2.5 * tolerance, maxIters=1000, confidence=0.999)
    motions: list[SE3] = []
    score_e = score_h = 0.0
    inliers = np.zeros(len(rays_a), np.bool_)
    if E is not None and E.shape == (3, 3):
        error = epipolar_error(E, rays_a, rays_b) / tolerance**2
        score_e = _support(error, _CHI2_LINE)
        inliers = error.max(axis=1) < _CHI2_LINE
        _, R, t, _ = cv2.recoverPose(E, rays_a, rays_b, np.eye(3), mask=mask.copy())
        motions.append(SE3(R, t.ravel()))
    if H is not None:
        error = transfer_error(H, rays_a, rays_b) / tolerance**2
        score_h = _support(error, _CHI2_POINT)
        if score_h > score_e:
            inliers = error.max(axis=1) < _CHI2_POINT
    if score_h / max(score_h + score_e, 1e-9) > 0.40:
        motions += _of_homography(H, rays_a[inliers])
    return motions


def _of_homography(H: FloatArray, rays_a: Points2) -> list[SE3]:
    """The decompositions (Malis and Vargas 2007) that keep most points in front of the first camera."""
    _, rotations, translations, normals = cv2.decomposeHomographyMat(H, np.eye(3))
    a = homogeneous(rays_a)
    found = []
    for R, t, normal in zip(rotations, translations, normals):
        size = float(np.linalg.norm(t))
        if size > 1e-9 and (a @ normal > 0).mean() > 0.9:
            found.append(SE3(R, t.ravel() / size))
    return found


def _support(squared: FloatArray, limit: float) -> float:
    """Sum over both images of 5.99 minus each error below the limit (errors (N, 2) in squared sigmas)."""
    return float(np.where(squared < limit, _CHI2_POINT - squared, 0.0).sum())


def epipolar_error(E: FloatArray, rays_a: Points2, rays_b: Points2) -> FloatArray:
    """(N, 2) squared distances of b's rays to their epipolar lines, and of a's to theirs."""
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    lines_b, lines_a = a @ E.T, b @ E
    product = (b * lines_b).sum(axis=1) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        both = [product / (lines[:, :2] ** 2).sum(axis=1) for lines in (lines_b, lines_a)]
    return np.asarray(np.nan_to_num(np.stack(both, axis=1), nan=np.inf, posinf=np.inf))


def transfer_error(H: FloatArray, rays_a: Points2, rays_b: Points2) -> FloatArray:
    """(N, 2) squared distances of b from H a, and of a from H^-1 b."""
    columns = []
    for M, x, y in ((H, rays_a, rays_b), (np.linalg.inv(H), rays_b, rays_a)):
        mapped = homogeneous(x) @ M.T
        with np.errstate(divide="ignore", invalid="ignore"):
            columns.append(((mapped[:, :2] / mapped[:, 2:] - y) ** 2).sum(axis=1))
    return np.asarray(np.nan_to_num(np.stack(columns, axis=1), nan=np.inf, posinf=np.inf))


def homogeneous(rays: Points2) -> Points3:
    """(N, 3) rays with z = 1."""
    return np.column_stack([rays, np.ones(len(rays))])


def essential_matrix(T_b_a: SE3) -> FloatArray:
    """(3, 3) E with b^T E a = 0 for rays a, b of the same point."""
    return skew(T_b_a.translation) @ T_b_a.rotation


def triangulate(T_b_a: SE3, rays_a: Points2, rays_b: Points2) -> tuple[Points3, FloatArray]:
    """Linear triangulation of rays on the planes z = 1 of two cameras.

    T_b_a: camera a in b. rays (N, 2). Returns (points_a (N, 3) in camera a, parallax (N,) [rad]). Points may lie
    behind a camera or be non-finite where the rays are parallel: the caller checks."""
    R, t = T_b_a.rotation, T_b_a.translation
    a, b = homogeneous(rays_a), homogeneous(rays_b)
    turned = a @ R.T
    # z_b b = z_a R a + t: the cross product with b eliminates z_b; least squares for z_a.
    left, right = np.cross(b, turned), -np.cross(b, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (left * right).sum(axis=1) / (left * left).sum(axis=1)
    sine = np.linalg.norm(left, axis=1) / (np.linalg.norm(turned, axis=1) * np.linalg.norm(b, axis=1))
    return a * depth[:, None], np.arcsin(np.clip(sine, 0.0, 1.0))


def reprojection_error(T_c_w: SE3, points: Points3, rays: Points2) -> FloatArray:
    """(N,) distance at z = 1 between points (N, 3) seen from c and rays (N, 2); infinite behind the camera."""
    cam = T_c_w @ points
    with np.errstate(divide="ignore", invalid="ignore"):
        error: FloatArray = np.linalg.norm(cam[:, :2] / cam[:, 2:] - rays, axis=1)
    error[~(cam[:, 2] > 0)] = np.inf
    return np.nan_to_num(error, nan=np.inf, posinf=np.inf)
