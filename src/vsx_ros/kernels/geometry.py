"""Rigid motions (tangent vectors are xi = (rho, omega)), and points to pixels and back, one point or many.

Camera arrays are (CAMERA,), laid out as in ``lens``. Their motion is the camera's rotation vector [rad] and translation
[m], in its own frame, while the rows of the image are read out from top to bottom.

Each row is seen from the camera's pose at that row's time; all else refers to the middle row. At 15 deg/s and 26 ms the
difference is 1.8 px at the edges, much more than the precision of patches. Translation matters less (0.3 px at 0.3 m/s
and 3 m) and only with known depth: for poses and observations, not for predictions."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.lens import CX, CY, FX, FY, HEIGHT, MOTION, PLANE_R2, WIDTH, distort, undistort


@kernel
def exp_se3(xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and translation (3,) of the tangent vector (6,)."""
    wx, wy, wz = xi[3], xi[4], xi[5]
    angle2 = wx * wx + wy * wy + wz * wz
    if angle2 < 1e-10:
        a, b, c = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        angle = math.sqrt(angle2)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / angle2
        c = (1.0 - a) / angle2
    W = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    R = np.empty((3, 3))
    t = np.zeros(3)
    for i in range(3):
        for j in range(3):
            w2 = W[i, 0] * W[0, j] + W[i, 1] * W[1, j] + W[i, 2] * W[2, j]
            unit = 1.0 if i == j else 0.0
            R[i, j] = unit + a * W[i, j] + b * w2
            t[i] += (unit + b * W[i, j] + c * w2) * xi[j]
    return R, t


@part
def transform(R: FloatArray, t: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The point (x, y, z) after the rigid motion R, t."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0],
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1],
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2],
    )


@part
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Fill out (3,) with the cross product of two vectors (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def compose(Ra: FloatArray, ta: FloatArray, Rb: FloatArray, tb: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, t) of the product of two rigid motions."""
    R = np.empty((3, 3))
    t = np.empty(3)
    for i in range(3):
        for j in range(3):
            R[i, j] = Ra[i, 0] * Rb[0, j] + Ra[i, 1] * Rb[1, j] + Ra[i, 2] * Rb[2, j]
        t[i] = Ra[i, 0] * tb[0] + Ra[i, 1] * tb[1] + Ra[i, 2] * tb[2] + ta[i]
    return R, t


@kernel
def orthonormalize(R: FloatArray) -> None:
    """Make the rows of a nearly orthonormal (3, 3) matrix exactly orthonormal, in place.

    Poses are composed thousands of times; without this, rounding errors grow."""
    for i in range(3):
        for k in range(i):
            dot = R[i, 0] * R[k, 0] + R[i, 1] * R[k, 1] + R[i, 2] * R[k, 2]
            for j in range(3):
                R[i, j] -= dot * R[k, j]
        norm = math.sqrt(R[i, 0] * R[i, 0] + R[i, 1] * R[i, 1] + R[i, 2] * R[i, 2])
        for j in range(3):
            R[i, j] /= norm


@kernel
def log_se3(R: FloatArray, t: FloatArray) -> FloatArray:
    """Tangent vector (6,) of a rigid motion whose rotation stays well below pi."""
    xi = np.empty(6)
    sx, sy, sz = 0.5 * (R[2, 1] - R[1, 2]), 0.5 * (R[0, 2] - R[2, 0]), 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(sx * sx + sy * sy + sz * sz)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    k = 1.0 if sine < 1e-9 else angle / sine
    wx, wy, wz = k * sx, k * sy, k * sz
    if angle < 1e-5:
        c = 1.0 / 12.0
    else:
        c = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    cx, cy, cz = wy * t[2] - wz * t[1], wz * t[0] - wx * t[2], wx * t[1] - wy * t[0]
    xi[0] = t[0] - 0.5 * cx + c * (wy * cz - wz * cy)
    xi[1] = t[1] - 0.5 * cy + c * (wz * cx - wx * cz)
    xi[2] = t[2] - 0.5 * cz + c * (wx * cy - wy * cx)
    xi[3], xi[4], xi[5] = wx, wy, wz
    return xi


@kernel
def row_share(camera: FloatArray, v: float) -> float:
    """When row v [px] is exposed, as a share of the readout after the middle row, in [-0.5, 0.5]."""
    return float((v + 0.5) / camera[HEIGHT] - 0.5)


@kernel
def project_normalized(camera: FloatArray, x: float, y: float) -> tuple[float, float]:
    """(u, v) [px] of the point (x, y, 1) as its row sees it. The row is that of a camera at rest: precise to half a
    pixel at 0.6 rad/s, enough for predictions."""
    xd, yd = distort(camera, x, y)
    wx, wy, wz = camera[MOTION], camera[MOTION + 1], camera[MOTION + 2]
    if wx != 0.0 or wy != 0.0 or wz != 0.0:
        share = row_share(camera, camera[FY] * yd + camera[CY])
        z = 1.0 - share * (wx * y - wy * x)
        xd, yd = distort(camera, (x - share * (wy - wz * y)) / z, (y - share * (wz * x - wx)) / z)
    return camera[FX] * xd + camera[CX], camera[FY] * yd + camera[CY]


@kernel
def unproject_pixel(camera: FloatArray, u: float, v: float) -> tuple[float, float]:
    """(x, y) on the plane z = 1 that projects to the pixel: undo the lens, then the rotation of the row."""
    x, y = undistort(camera, (u - camera[CX]) / camera[FX], (v - camera[CY]) / camera[FY])
    wx, wy, wz = camera[MOTION], camera[MOTION + 1], camera[MOTION + 2]
    if wx != 0.0 or wy != 0.0 or wz != 0.0:
        share = row_share(camera, v)
        z = 1.0 + share * (wx * y - wy * x)
        x, y = (x + share * (wy - wz * y)) / z, (y + share * (wz * x - wx)) / z
    return x, y


@kernel
def project_points(camera: FloatArray, plane: FloatArray) -> FloatArray:
    """(N, 2) pixels of (N, 2) points on the plane z = 1."""
    out = np.empty((plane.shape[0], 2))
    for i in range(plane.shape[0]):
        out[i, 0], out[i, 1] = project_normalized(camera, plane[i, 0], plane[i, 1])
    return out


@kernel
def unproject_pixels(camera: FloatArray, pixels: FloatArray) -> FloatArray:
    """(N, 2) points on the plane z = 1 of (N, 2) pixels."""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        out[i, 0], out[i, 1] = unproject_pixel(camera, pixels[i, 0], pixels[i, 1])
    return out


@kernel
def ideal_pixels(camera: FloatArray, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """(N, 2) undistorted pixels of points as if the whole image were exposed with its middle row. pixels (N, 2): where
    they were seen, depth (N,) [m]."""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        x, y = unproject_pixel(camera, pixels[i, 0], pixels[i, 1])
        share = row_share(camera, pixels[i, 1]) / depth[i]
        z = 1.0 + share * camera[MOTION + 5]
        out[i, 0] = (x + share * camera[MOTION + 3]) / z * camera[FX] + camera[CX]
        out[i, 1] = (y + share * camera[MOTION + 4]) / z * camera[FY] + camera[CY]
    return out


@kernel
def project_rows(
    camera: FloatArray, R: FloatArray, t: FloatArray, points: FloatArray, rows: IntArray, margin_px: float
) -> tuple[FloatArray, BoolArray]:
    """Level-0 pixels (S, 2) of map points (rows (S,) of points (P, 3)) in a camera at T_cam_world = R, t, and which of
    them (S,) lie in the image, margin_px inside its border."""
    n = rows.shape[0]
    uv = np.zeros((n, 2))
    inside = np.zeros(n, np.bool_)
    right, bottom = camera[WIDTH] - 1 - margin_px, camera[HEIGHT] - 1 - margin_px
    for i in range(n):
        x, y, z = transform(R, t, points[rows[i], 0], points[rows[i], 1], points[rows[i], 2])
        if z < 1e-3 or (x / z) * (x / z) + (y / z) * (y / z) > camera[PLANE_R2]:
            continue
        u, v = project_normalized(camera, x / z, y / z)
        uv[i, 0], uv[i, 1] = u, v
        inside[i] = margin_px <= u <= right and margin_px <= v <= bottom
    return uv, inside
