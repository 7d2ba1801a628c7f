"""Points into pixels and back, one point or many. Camera arrays are (18,): fx, fy, cx, cy, k1, k2, p1, p2, k3,
largest valid squared radius on the plane z = 1, width, height; then the rotation vector [rad] by which the camera turns
and the way [m] it goes, in its own frame, while the rows of the image are read out from top to bottom.

A row is seen from where the camera was at that row's own time; all else refers to the middle row. At 15 deg/s and 26 ms
that is 1.8 px at the edges, much more than what patches are located to. The way matters less (0.3 px at 0.3 m/s and
3 m) and only where the depth is known: for poses and observations, not for where to look.
"""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels import kernel


@kernel
def row_share(camera: FloatArray, v: float) -> float:
    """What part of the readout after the middle row, in [-0.5, 0.5], the row v [px] is exposed."""
    share: float = (v + 0.5) / camera[11] - 0.5
    return share


@kernel
def project_normalized(camera: FloatArray, x: float, y: float) -> tuple[float, float]:
    """(u, v) [px] of the point (x, y, 1), with plumb-bob distortion and the turn of its row, which is guessed
    before the distortion: good to half a pixel at 0.6 rad/s, for looking there."""
    wx, wy, wz = camera[12], camera[13], camera[14]
    if wx != 0.0 or wy != 0.0 or wz != 0.0:
        share = row_share(camera, camera[1] * y + camera[3])
        z = 1.0 - share * (wx * y - wy * x)
        x, y = (x - share * (wy - wz * y)) / z, (y - share * (wz * x - wx)) / z
    r2 = x * x + y * y
    radial = 1.0 + r2 * (camera[4] + r2 * (camera[5] + r2 * camera[8]))
    xd = x * radial + 2.0 * camera[6] * x * y + camera[7] * (r2 + 2.0 * x * x)
    yd = y * radial + camera[6] * (r2 + 2.0 * y * y) + 2.0 * camera[7] * x * y
    return camera[0] * xd + camera[2], camera[1] * yd + camera[3]


@kernel
def unproject_pixel(camera: FloatArray, u: float, v: float) -> tuple[float, float]:
    """(x, y) on the plane z = 1 that projects to the pixel: Newton steps on the distortion, then the row's turn."""
    k1, k2, p1, p2, k3 = camera[4], camera[5], camera[6], camera[7], camera[8]
    xd = (u - camera[2]) / camera[0]
    yd = (v - camera[3]) / camera[1]
    x, y = xd, yd
    for _ in range(20):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        ex = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - xd
        ey = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - yd
        if abs(ex) + abs(ey) < 1e-13:
            break
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        jxx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        jxy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        jyy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        det = jxx * jyy - jxy * jxy
        if det < 0.05:
            # Beyond where the model is one to one: the slower fixed-point step stays on its near side.
            x -= ex / max(radial, 0.1)
            y -= ey / max(radial, 0.1)
            continue
        x -= (jyy * ex - jxy * ey) / det
        y -= (jxx * ey - jxy * ex) / det
    wx, wy, wz = camera[12], camera[13], camera[14]
    if wx != 0.0 or wy != 0.0 or wz != 0.0:
        share = row_share(camera, v)
        z = 1.0 + share * (wx * y - wy * x)
        x, y = (x + share * (wy - wz * y)) / z, (y + share * (wz * x - wx)) / z
    return x, y


@kernel
def unproject_pixels(camera: FloatArray, pixels: FloatArray) -> FloatArray:
    """(N, 2) points on the plane z = 1 of (N, 2) pixels."""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        out[i, 0], out[i, 1] = unproject_pixel(camera, pixels[i, 0], pixels[i, 1])
    return out


@kernel
def ideal_pixels(camera: FloatArray, pixels: FloatArray, depth: FloatArray) -> FloatArray:
    """(N, 2) undistorted pixels at which points would be seen, had the whole image been exposed with its middle row;
    pixels (N, 2): where they were seen, depth (N,) [m]."""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        x, y = unproject_pixel(camera, pixels[i, 0], pixels[i, 1])
        share = row_share(camera, pixels[i, 1]) / depth[i]
        z = 1.0 + share * camera[17]
        out[i, 0] = (x + share * camera[15]) / z * camera[0] + camera[2]
        out[i, 1] = (y + share * camera[16]) / z * camera[1] + camera[3]
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
    right, bottom = camera[10] - 1 - margin_px, camera[11] - 1 - margin_px
    for i in range(n):
        X, Y, Z = points[rows[i], 0], points[rows[i], 1], points[rows[i], 2]
        z = R[2, 0] * X + R[2, 1] * Y + R[2, 2] * Z + t[2]
        if z < 1e-3:
            continue
        x = (R[0, 0] * X + R[0, 1] * Y + R[0, 2] * Z + t[0]) / z
        y = (R[1, 0] * X + R[1, 1] * Y + R[1, 2] * Z + t[1]) / z
        if x * x + y * y > camera[9]:
            continue
        u, v = project_normalized(camera, x, y)
        uv[i, 0], uv[i, 1] = u, v
        inside[i] = margin_px <= u <= right and margin_px <= v <= bottom
    return uv, inside


@kernel
def best_template(
    templates: IntArray, source: IntArray, source_centre: FloatArray, X: float, Y: float, Z: float, nx: float,
    ny: float, nz: float,
) -> int:  # fmt: skip
    """Of a point's templates (V,) the one seen from the most similar direction and distance, at most 53 degrees away;
    -1 without. (nx, ny, nz): the point (X, Y, Z) minus the camera's centre."""
    n2 = nx * nx + ny * ny + nz * nz
    best, closest = -1, np.inf
    for slot in range(templates.shape[0]):
        candidate = templates[slot]
        if candidate < 0:
            continue
        k = source[candidate]
        sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
        s2 = sx * sx + sy * sy + sz * sz
        cosine = (sx * nx + sy * ny + sz * nz) / math.sqrt(s2 * n2)
        ratio = s2 / n2
        # The second term is log(ratio)^2 to second order.
        unlike = 2.0 * (1.0 - cosine) + 0.05 * (ratio + 1.0 / ratio - 2.0)
        if cosine > 0.6 and unlike < closest:
            best, closest = candidate, unlike
    return best


@kernel
def predict(
    camera: FloatArray, R: FloatArray, t: FloatArray, points: FloatArray, rows: IntArray, templates: IntArray,
    source: IntArray, basis: FloatArray, source_R: FloatArray, source_centre: FloatArray, margin_px: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, IntArray]:  # fmt: skip
    """Where map points appear, at which level, which of their templates fits best and how it is warped.

    R, t: T_cam_world of the image. points (P, 3): world; rows (C,): the points to predict. templates (P, V): template
    numbers of each point, -1 for none. source (T,): the keyframe a template comes from, as row of source_R (K, 3, 3) =
    R_world_cam and source_centre (K, 3). basis (T, 4): right and down step of one source-level pixel on the plane z
    = 1 of the source camera.
    Returns of the S visible ones rows (S,), level (S,), uv (S, 2) level-0 px, inverse_warp (S, 4): level px -> source
    px, row-major, and template (S,). The level is the one where the warp's determinant lies in [0.25, 3] (PTAM's
    rule).
    """
    pixels, inside = project_rows(camera, R, t, points, rows, margin_px)
    n = rows.shape[0]
    visible = np.empty(n, np.int64)
    level = np.empty(n, np.int64)
    template = np.empty(n, np.int64)
    uv = np.empty((n, 2))
    inverse_warp = np.empty((n, 4))
    A = np.empty(4)
    cx0 = -(R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2])
    cy0 = -(R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2])
    cz0 = -(R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2])
    m = 0
    for c in range(n):
        if not inside[c]:
            continue
        i = rows[c]
        X, Y, Z = points[i, 0], points[i, 1], points[i, 2]
        best = best_template(templates[i], source, source_centre, X, Y, Z, X - cx0, Y - cy0, Z - cz0)
        if best < 0:
            continue
        k = source[best]
        sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
        depth = sx * source_R[k, 0, 2] + sy * source_R[k, 1, 2] + sz * source_R[k, 2, 2]
        if depth <= 0.0:
            continue
        good = True
        for step in range(2):
            bx, by = basis[best, 2 * step] * depth, basis[best, 2 * step + 1] * depth
            wx = X + source_R[k, 0, 0] * bx + source_R[k, 0, 1] * by
            wy = Y + source_R[k, 1, 0] * bx + source_R[k, 1, 1] * by
            wz = Z + source_R[k, 2, 0] * bx + source_R[k, 2, 1] * by
            zz = R[2, 0] * wx + R[2, 1] * wy + R[2, 2] * wz + t[2]
            if zz < 1e-3:
                good = False
                break
            xx = (R[0, 0] * wx + R[0, 1] * wy + R[0, 2] * wz + t[0]) / zz
            yy = (R[1, 0] * wx + R[1, 1] * wy + R[1, 2] * wz + t[1]) / zz
            uu, vv = project_normalized(camera, xx, yy)
            A[step] = uu - pixels[c, 0]
            A[2 + step] = vv - pixels[c, 1]
        if not good:
            continue
        full = A[0] * A[3] - A[1] * A[2]
        det = full
        chosen = 0
        while det > 3.0 and chosen < 3:
            det *= 0.25
            chosen += 1
        if not (0.25 <= det <= 3.0):
            continue
        scale = 2.0**chosen
        visible[m], level[m], template[m] = i, chosen, best
        uv[m, 0], uv[m, 1] = pixels[c, 0], pixels[c, 1]
        inverse_warp[m, 0] = A[3] / full * scale
        inverse_warp[m, 1] = -A[1] / full * scale
        inverse_warp[m, 2] = -A[2] / full * scale
        inverse_warp[m, 3] = A[0] / full * scale
        m += 1
    return visible[:m], level[:m], uv[:m], inverse_warp[:m], template[:m]
