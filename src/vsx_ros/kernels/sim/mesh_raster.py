"""Which triangle each ray of an image meets first: a z-buffer over exact rays.

A triangle with corners a, b, c relative to the camera is met by the ray D if D has the same sign against b x c, c x a
and a x b (Olano and Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997). These are linear in D, so
the rays may be bent by any lens; the corners are taken relative to the camera of each row (rolling shutter). Triangles
that share an edge leave no gap: its form is the same to the last bit, with the other sign."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.sim.mesh_scene import MeshScene, Rays

NEAR_M = 0.05  # nothing nearer is drawn
BLOCK = 16  # pixels of a row that are skipped together
_HALF_ALPHA = 125
_SMALL = 0.1  # extent on the plane z = 1 up to which four corners tell where a triangle lies
_EDGE_ON = 1e-13  # volume [m3] of a triangle with the camera, seen from its edge


class Optics(NamedTuple):
    """Where directions lie in the image: pixels (Y, X, 2) u, v at a lattice of the plane z = 1 over bounds (4,) x0, y0,
    x1, y1; curvature: largest second derivative of the pixels [px]. bow: how far a ray is from the mean of those half
    a block to its left and right, at most. turn, shift: motion of the camera from row to row [rad], [m]."""

    pixels: Float32Array
    bounds: FloatArray
    curvature: float
    bow: float
    turn: float
    shift: float


@part
def _seen_from(corners: Float32Array, rays: Rays, row: int, cam: FloatArray) -> None:
    """cam (3, 3): the corners (9,) in the camera of a row."""
    ox, oy, oz = rays.origins[row, 0], rays.origins[row, 1], rays.origins[row, 2]
    R = rays.turns[row]
    for i in range(3):
        x, y, z = corners[3 * i] - ox, corners[3 * i + 1] - oy, corners[3 * i + 2] - oz
        for j in range(3):
            cam[i, j] = R[0, j] * x + R[1, j] * y + R[2, j] * z


@kernel
def _extent(cam: FloatArray, box: FloatArray) -> float:
    """box (4,): least x, y and greatest x, y of the corners (3, 3) on the plane z = 1, cut off at ``NEAR_M``; returns
    their least depth, or 0 if all lie nearer."""
    box[0] = box[1] = np.inf
    box[2] = box[3] = -np.inf
    least = np.inf
    for i in range(3):
        j = (i + 1) % 3
        here, there = cam[i, 2] >= NEAR_M, cam[j, 2] >= NEAR_M
        if here:
            x, y = cam[i, 0] / cam[i, 2], cam[i, 1] / cam[i, 2]
            box[0], box[1], box[2], box[3] = min(box[0], x), min(box[1], y), max(box[2], x), max(box[3], y)
            least = min(least, cam[i, 2])
        if here != there:
            share = (NEAR_M - cam[i, 2]) / (cam[j, 2] - cam[i, 2])
            x = (cam[i, 0] + share * (cam[j, 0] - cam[i, 0])) / NEAR_M
            y = (cam[i, 1] + share * (cam[j, 1] - cam[i, 1])) / NEAR_M
            box[0], box[1], box[2], box[3] = min(box[0], x), min(box[1], y), max(box[2], x), max(box[3], y)
            least = NEAR_M
    return least if least < np.inf else 0.0


@part
def _pixel(optics: Optics, x: float, y: float, axis: int) -> float:
    """Pixel coordinate (0: u, 1: v) of a direction inside the bounds."""
    rows, columns = optics.pixels.shape[0] - 1, optics.pixels.shape[1] - 1
    gx = (x - optics.bounds[0]) / (optics.bounds[2] - optics.bounds[0]) * columns
    gy = (y - optics.bounds[1]) / (optics.bounds[3] - optics.bounds[1]) * rows
    i, j = min(max(int(gx), 0), columns - 1), min(max(int(gy), 0), rows - 1)
    fx, fy, p = gx - i, gy - j, optics.pixels
    upper = p[j, i, axis] + fx * (p[j, i + 1, axis] - p[j, i, axis])
    lower = p[j + 1, i, axis] + fx * (p[j + 1, i + 1, axis] - p[j + 1, i, axis])
    value: float = upper + fy * (lower - upper)
    return value


@kernel
def _pixel_box(optics: Optics, box: FloatArray, slack: float, found: FloatArray) -> bool:
    """found (4,): least u, v and greatest u, v that directions inside box, made wider by slack, may have. False if none
    lies in the image's bounds."""
    x0, y0 = max(box[0] - slack, optics.bounds[0]), max(box[1] - slack, optics.bounds[1])
    x1, y1 = min(box[2] + slack, optics.bounds[2]), min(box[3] + slack, optics.bounds[3])
    if x0 > x1 or y0 > y1:
        return False
    found[0] = found[1] = np.inf
    found[2] = found[3] = -np.inf
    span = max(x1 - x0, y1 - y0)
    steps = 1 if span < _SMALL else 2
    for i in range(steps + 1):
        for j in range(steps + 1):
            x, y = x0 + i * (x1 - x0) / steps, y0 + j * (y1 - y0) / steps
            u, v = _pixel(optics, x, y, 0), _pixel(optics, x, y, 1)
            found[0], found[1] = min(found[0], u), min(found[1], v)
            found[2], found[3] = max(found[2], u), max(found[3], v)
    margin = 1.0 + 0.125 * optics.curvature * (span / steps) ** 2
    found[0] -= margin
    found[1] -= margin
    found[2] += margin
    found[3] += margin
    return True


@kernel
def edge_forms(corners: Float32Array, origin: FloatArray, forms: FloatArray) -> float:
    """forms (3, 3): b x c, c x a, a x b of the corners relative to the origin, with the sign that makes them positive
    for rays that meet the triangle in front. Returns six times its volume with the origin, positive."""
    ax, ay, az = corners[0] - origin[0], corners[1] - origin[1], corners[2] - origin[2]
    bx, by, bz = corners[3] - origin[0], corners[4] - origin[1], corners[5] - origin[2]
    cx, cy, cz = corners[6] - origin[0], corners[7] - origin[1], corners[8] - origin[2]
    forms[0, 0], forms[0, 1], forms[0, 2] = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    forms[1, 0], forms[1, 1], forms[1, 2] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
    forms[2, 0], forms[2, 1], forms[2, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    volume: float = ax * forms[0, 0] + ay * forms[0, 1] + az * forms[0, 2]
    if volume < 0.0:
        for i in range(3):
            for j in range(3):
                forms[i, j] = -forms[i, j]
        volume = -volume
    return volume


@part
def _is_hole(scene: MeshScene, t: int, w0: np.float32, w1: np.float32, w2: np.float32) -> bool:
    """Whether the picture of triangle t is cut out where the weights of its corners are w."""
    place, uv = scene.hole_places[scene.kinds[t]], scene.uv[t]
    total = w0 + w1 + w2
    u = (w0 * uv[0] + w1 * uv[2] + w2 * uv[4]) / total
    v = (w0 * uv[1] + w1 * uv[3] + w2 * uv[5]) / total
    width, height = 1 << place[1], 1 << place[2]
    column, row = int(np.floor(u * width)) & (width - 1), int(np.floor((1.0 - v) * height)) & (height - 1)
    return bool(scene.holes[place[0] + (row << place[1]) + column] < _HALF_ALPHA)


@kernel
def _draw_row(
    scene: MeshScene, t: int, forms: FloatArray, volume: float, lines: Float32Array, first: int, last: int, bow: float,
    nearness: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Draw triangle t into the pixels first..last of a row. lines (3, W + 1): its rays; nearness, ident (W,)."""
    a0, a1, a2 = np.float32(forms[0, 0]), np.float32(forms[0, 1]), np.float32(forms[0, 2])
    b0, b1, b2 = np.float32(forms[1, 0]), np.float32(forms[1, 1]), np.float32(forms[1, 2])
    c0, c1, c2 = np.float32(forms[2, 0]), np.float32(forms[2, 1]), np.float32(forms[2, 2])
    n0 = np.float32((forms[0, 0] + forms[1, 0] + forms[2, 0]) / volume)
    n1 = np.float32((forms[0, 1] + forms[1, 1] + forms[2, 1]) / volume)
    n2 = np.float32((forms[0, 2] + forms[1, 2] + forms[2, 2]) / volume)
    slack_a = -np.float32(bow) * (abs(a0) + abs(a1) + abs(a2))
    slack_b = -np.float32(bow) * (abs(b0) + abs(b1) + abs(b2))
    slack_c = -np.float32(bow) * (abs(c0) + abs(c1) + abs(c2))
    dx, dy, dz = lines[0], lines[1], lines[2]
    holes, zero, label = scene.hole_places[scene.kinds[t], 0] >= 0, np.float32(0.0), np.int32(t)
    for begin in range(first, last + 1, BLOCK):
        end = min(begin + BLOCK, last + 1)
        p, q = begin, end - 1
        if max(a0 * dx[p] + a1 * dy[p] + a2 * dz[p], a0 * dx[q] + a1 * dy[q] + a2 * dz[q]) < slack_a:
            continue
        if max(b0 * dx[p] + b1 * dy[p] + b2 * dz[p], b0 * dx[q] + b1 * dy[q] + b2 * dz[q]) < slack_b:
            continue
        if max(c0 * dx[p] + c1 * dy[p] + c2 * dz[p], c0 * dx[q] + c1 * dy[q] + c2 * dz[q]) < slack_c:
            continue
        for x in range(begin, end):
            wa = a0 * dx[x] + a1 * dy[x] + a2 * dz[x]
            wb = b0 * dx[x] + b1 * dy[x] + b2 * dz[x]
            wc = c0 * dx[x] + c1 * dy[x] + c2 * dz[x]
            near = n0 * dx[x] + n1 * dy[x] + n2 * dz[x]
            if (wa >= zero) & (wb >= zero) & (wc >= zero) & (near > nearness[x]):
                if holes and _is_hole(scene, t, wa, wb, wc):
                    continue
                nearness[x], ident[x] = near, label


@kernel
def rasterise(
    scene: MeshScene, order: IntArray, rays: Rays, optics: Optics, first: int, last: int,
    nearness: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Fill the rows first..last - 1 of nearness (H, W), 1 / depth [1/m] or 0, and of ident (H, W), triangle or -1.
    order: the chunks to draw, near ones first."""
    height, width = nearness.shape
    nearness[first:last], ident[first:last] = np.float32(0.0), np.int32(-1)
    cam, forms, box, found = np.empty((3, 3)), np.empty((3, 3)), np.empty(4), np.empty(4)
    stretch = (
        1.0 + max(optics.bounds[0] ** 2, optics.bounds[2] ** 2) + max(optics.bounds[1] ** 2, optics.bounds[3] ** 2)
    )
    for k in order:
        for t in range(scene.chunks[k], scene.chunks[k + 1]):
            corners = scene.corners[t]
            row = height // 2
            _seen_from(corners, rays, row, cam)
            depth = _extent(cam, box)
            drift = 0.0 if depth <= 0.0 else (optics.turn * stretch + optics.shift / depth) * height
            if depth <= 0.0 or not _pixel_box(optics, box, 0.5 * drift, found):
                continue
            if drift > 0.0:  # once more with the camera of its own rows, which may differ less
                top, bottom = max(found[1], 0.0), min(found[3], height - 1.0)
                row = min(max(int(0.5 * (top + bottom)), 0), height - 1)
                _seen_from(corners, rays, row, cam)
                depth = _extent(cam, box)
                apart = 2.0 + 0.5 * max(bottom - top, 0.0)
                slack = (optics.turn * stretch + optics.shift / max(depth, NEAR_M)) * apart
                if depth <= 0.0 or not _pixel_box(optics, box, slack, found):
                    continue
            u0, u1 = max(int(np.floor(found[0])), 0), min(int(np.ceil(found[2])), width - 1)
            v0, v1 = max(int(np.floor(found[1])), first), min(int(np.ceil(found[3])), last - 1)
            for y in range(v0, v1 + 1 if u1 >= u0 else v0):
                volume = edge_forms(corners, rays.origins[y], forms)
                if volume > _EDGE_ON:
                    _draw_row(
                        scene, t, forms, volume, rays.directions[y], u0, u1, optics.bow, nearness[y], ident[y]
                    )  # fmt: skip
