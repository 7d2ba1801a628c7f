"""Points into pixels and back, one point or many. Camera arrays are (12,): fx, fy, cx, cy, k1, k2, p1, p2, k3,
largest valid squared radius on the plane z = 1, width, height."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel


@kernel
def project_normalized(camera: Any, x: float, y: float) -> tuple[float, float]:
    """(u, v) [px] of the point (x, y, 1), with plumb-bob distortion."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (camera[4] + r2 * (camera[5] + r2 * camera[8]))
    xd = x * radial + 2.0 * camera[6] * x * y + camera[7] * (r2 + 2.0 * x * x)
    yd = y * radial + camera[6] * (r2 + 2.0 * y * y) + 2.0 * camera[7] * x * y
    return camera[0] * xd + camera[2], camera[1] * yd + camera[3]


@kernel
def unproject_pixel(camera: Any, u: float, v: float) -> tuple[float, float]:
    """(x, y) on the plane z = 1 that projects to the pixel: fixed-point iteration on the distortion."""
    xd = (u - camera[2]) / camera[0]
    yd = (v - camera[3]) / camera[1]
    x, y = xd, yd
    for _ in range(40):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (camera[4] + r2 * (camera[5] + r2 * camera[8]))
        dx = 2.0 * camera[6] * x * y + camera[7] * (r2 + 2.0 * x * x)
        dy = camera[6] * (r2 + 2.0 * y * y) + 2.0 * camera[7] * x * y
        xn = (xd - dx) / radial
        yn = (yd - dy) / radial
        step = abs(xn - x) + abs(yn - y)
        x, y = xn, yn
        if step < 1e-12:
            break
    return x, y


@kernel
def unproject_pixels(camera: Any, pixels: Any) -> Any:
    """(N, 2) points on the plane z = 1 of (N, 2) pixels."""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        out[i, 0], out[i, 1] = unproject_pixel(camera, pixels[i, 0], pixels[i, 1])
    return out


@kernel
def predict(
    camera: Any,
    R: Any,
    t: Any,
    points: Any,
    rows: Any,
    templates: Any,
    source: Any,
    basis: Any,
    source_R: Any,
    source_centre: Any,
    margin_px: float,
) -> tuple[Any, Any, Any, Any]:
    """Where map points appear, at which level, which of their templates fits best and how it is warped.

    R, t: T_cam_world of the image. points (P, 3): world; rows (C,): the points to predict. templates (P, V): template
    numbers of each point, -1 for none. source (T,): the keyframe a template comes from, as row of source_R (K, 3, 3) =
    R_world_cam and source_centre (K, 3). basis (T, 4): right and down step of one source-level pixel on the plane z
    = 1 of the source camera.
    Returns level (C,) (-1: not visible), uv (C, 2) level-0 px, inverse_warp (C, 4): level px -> source px,
    row-major, and template (C,). The level is the one where the warp's determinant lies in [0.25, 3] (PTAM's rule);
    the template the one seen from the most similar direction and distance, at most 53 degrees away.
    """
    n = rows.shape[0]
    level = np.full(n, -1, np.int64)
    template = np.full(n, -1, np.int64)
    uv = np.zeros((n, 2))
    inverse_warp = np.zeros((n, 4))
    cx0 = -(R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2])
    cy0 = -(R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2])
    cz0 = -(R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2])
    for c in range(n):
        i = rows[c]
        X, Y, Z = points[i, 0], points[i, 1], points[i, 2]
        z = R[2, 0] * X + R[2, 1] * Y + R[2, 2] * Z + t[2]
        if z < 1e-3:
            continue
        x = R[0, 0] * X + R[0, 1] * Y + R[0, 2] * Z + t[0]
        y = R[1, 0] * X + R[1, 1] * Y + R[1, 2] * Z + t[1]
        xn, yn = x / z, y / z
        if xn * xn + yn * yn > camera[9]:
            continue
        u, v = project_normalized(camera, xn, yn)
        if u < margin_px or v < margin_px or u > camera[10] - 1 - margin_px or v > camera[11] - 1 - margin_px:
            continue
        nx, ny, nz = X - cx0, Y - cy0, Z - cz0
        n2 = nx * nx + ny * ny + nz * nz
        best, closest = -1, np.inf
        for slot in range(templates.shape[1]):
            candidate = templates[i, slot]
            if candidate < 0:
                continue
            k = source[candidate]
            sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
            s2 = sx * sx + sy * sy + sz * sz
            cosine = (sx * nx + sy * ny + sz * nz) / math.sqrt(s2 * n2)
            zoom = math.log(s2 / n2)
            unlike = 2.0 * (1.0 - cosine) + 0.05 * zoom * zoom
            if cosine > 0.6 and unlike < closest:
                best, closest = candidate, unlike
        if best < 0:
            continue
        k = source[best]
        sx, sy, sz = X - source_centre[k, 0], Y - source_centre[k, 1], Z - source_centre[k, 2]
        depth = sx * source_R[k, 0, 2] + sy * source_R[k, 1, 2] + sz * source_R[k, 2, 2]
        if depth <= 0.0:
            continue
        A = np.empty(4)
        good = True
        for step in range(2):
            bx, by = basis[best, 2 * step] * depth, basis[best, 2 * step + 1] * depth
            wx = source_R[k, 0, 0] * bx + source_R[k, 0, 1] * by
            wy = source_R[k, 1, 0] * bx + source_R[k, 1, 1] * by
            wz = source_R[k, 2, 0] * bx + source_R[k, 2, 1] * by
            zz = z + R[2, 0] * wx + R[2, 1] * wy + R[2, 2] * wz
            if zz < 1e-3:
                good = False
                break
            xx = (x + R[0, 0] * wx + R[0, 1] * wy + R[0, 2] * wz) / zz
            yy = (y + R[1, 0] * wx + R[1, 1] * wy + R[1, 2] * wz) / zz
            uu, vv = project_normalized(camera, xx, yy)
            A[step] = uu - u
            A[2 + step] = vv - v
        if not good:
            continue
        det = A[0] * A[3] - A[1] * A[2]
        chosen = 0
        while det > 3.0 and chosen < 3:
            det *= 0.25
            chosen += 1
        if not (0.25 <= det <= 3.0):
            continue
        scale = 2.0**chosen
        level[c] = chosen
        template[c] = best
        uv[c, 0], uv[c, 1] = u, v
        full = A[0] * A[3] - A[1] * A[2]
        inverse_warp[c, 0] = A[3] / full * scale
        inverse_warp[c, 1] = -A[1] / full * scale
        inverse_warp[c, 2] = -A[2] / full * scale
        inverse_warp[c, 3] = A[0] / full * scale
    return level, uv, inverse_warp, template
