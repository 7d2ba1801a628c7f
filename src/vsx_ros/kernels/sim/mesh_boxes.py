"""Where in an image triangles may lie, and whether they are hidden: what is left out before anything is drawn."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.sim.mesh_scene import Rays

NEAR_M = 0.05  # nothing nearer is drawn
WIDE, HIGH = 32, 16  # columns and rows of a tile that is skipped together
_SMALL = 0.1  # extent on the plane z = 1 up to which four corners tell where a triangle lies


class Optics(NamedTuple):
    """Where directions lie in the image: pixels (Y, X, 2) u, v at a lattice of the plane z = 1 over bounds (4,) x0, y0,
    x1, y1; per_step (2,): its steps in one unit; slack: what interpolation may be wrong by [px]; curvature: largest
    second derivative of the pixels [px]. bow: how far a ray is from what the corners of its tile give, at most. jitter:
    where in a pixel its ray passes, from the centre [px]. turn, shift: motion of the camera from row to row [rad],
    [m]."""

    pixels: Float32Array
    bounds: FloatArray
    per_step: FloatArray
    slack: float
    curvature: float
    bow: float
    jitter: FloatArray
    turn: float
    shift: float


@part
def _seen_from(corners: Float32Array, t: int, rays: Rays, row: int, cam: FloatArray) -> None:
    """cam (3, 3): the corners of triangle t, of (T, 9), in the camera of a row."""
    R, o = rays.turns, rays.origins
    ox, oy, oz = o[row, 0], o[row, 1], o[row, 2]
    for i in range(3):
        x, y, z = corners[t, 3 * i] - ox, corners[t, 3 * i + 1] - oy, corners[t, 3 * i + 2] - oz
        for j in range(3):
            cam[i, j] = R[row, 0, j] * x + R[row, 1, j] * y + R[row, 2, j] * z


@part
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
def _pixel(optics: Optics, x: float, y: float) -> tuple[float, float]:
    """u, v of a direction inside the bounds."""
    p, bounds, per_step = optics.pixels, optics.bounds, optics.per_step
    gx, gy = (x - bounds[0]) * per_step[0], (y - bounds[1]) * per_step[1]
    i, j = min(max(int(gx), 0), p.shape[1] - 2), min(max(int(gy), 0), p.shape[0] - 2)
    fx, fy = gx - i, gy - j
    upper_u = p[j, i, 0] + fx * (p[j, i + 1, 0] - p[j, i, 0])
    lower_u = p[j + 1, i, 0] + fx * (p[j + 1, i + 1, 0] - p[j + 1, i, 0])
    upper_v = p[j, i, 1] + fx * (p[j, i + 1, 1] - p[j, i, 1])
    lower_v = p[j + 1, i, 1] + fx * (p[j + 1, i + 1, 1] - p[j + 1, i, 1])
    return upper_u + fy * (lower_u - upper_u), upper_v + fy * (lower_v - upper_v)


@part
def _pixel_box(optics: Optics, box: FloatArray, slack: float, found: FloatArray) -> bool:
    """found (4,): least u, v and greatest u, v that directions inside box, made wider by slack, may have. False if none
    lies in the image's bounds."""
    bounds = optics.bounds
    x0, y0 = max(box[0] - slack, bounds[0]), max(box[1] - slack, bounds[1])
    x1, y1 = min(box[2] + slack, bounds[2]), min(box[3] + slack, bounds[3])
    if x0 > x1 or y0 > y1:
        return False
    found[0] = found[1] = np.inf
    found[2] = found[3] = -np.inf
    span = max(x1 - x0, y1 - y0)
    steps = 1 if span < _SMALL else 2
    for i in range(steps + 1):
        for j in range(steps + 1):
            x, y = x0 + i * (x1 - x0) / steps, y0 + j * (y1 - y0) / steps
            u, v = _pixel(optics, x, y)
            found[0], found[1] = min(found[0], u), min(found[1], v)
            found[2], found[3] = max(found[2], u), max(found[3], v)
    margin = optics.slack + 0.125 * optics.curvature * (span / steps) ** 2
    jitter = optics.jitter
    found[0], found[1] = found[0] - margin - jitter[0], found[1] - margin - jitter[1]
    found[2], found[3] = found[2] + margin - jitter[0], found[3] + margin - jitter[1]
    return True


@part
def box_of(
    corners: Float32Array, t: int, rays: Rays, optics: Optics, stretch: float, cam: FloatArray, box: FloatArray,
    found: FloatArray,
) -> float:  # fmt: skip
    """found (4,): box of pixels that triangle t, of (T, 9), may reach; returns its least depth [m], or 0 if it is out
    of view. cam (3, 3), box (4,): scratch memory."""
    height = rays.origins.shape[0] - 1
    _seen_from(corners, t, rays, height // 2, cam)
    depth = _extent(cam, box)
    if depth <= 0.0:
        return 0.0
    drift = (optics.turn * stretch + optics.shift / depth) * height
    if not _pixel_box(optics, box, 0.5 * drift, found):
        return 0.0
    if drift <= 0.0:
        return depth
    # Once more with the camera of its own rows, which may differ less.
    top, bottom = min(max(found[1], 0.0), height - 1.0), max(min(found[3], height - 1.0), 0.0)
    _seen_from(corners, t, rays, int(0.5 * (top + bottom)), cam)
    least = _extent(cam, box)
    apart = 2.0 + 0.5 * max(bottom - top, 0.0)
    slack = (optics.turn * stretch + optics.shift / max(least, NEAR_M)) * apart
    if least <= 0.0 or not _pixel_box(optics, box, slack, found):
        return 0.0
    nearest: float = max(min(least, depth) - optics.shift * height, NEAR_M)
    return nearest


@kernel
def note_depths(nearness: Float32Array, first: int, last: int, floors: Float32Array) -> None:
    """floors (ceil(H / 16), ceil(W / 32)): least nearness of each tile in the rows first..last - 1."""
    floors[:] = np.float32(np.inf)
    for y in range(first, last):
        line, floor = nearness[y], floors[y // HIGH]
        for i in range(floor.shape[0]):
            least = floor[i]
            for x in range(i * WIDE, min(i * WIDE + WIDE, line.shape[0])):
                least = min(least, line[x])
            floor[i] = least


@part
def is_hidden(floors: Float32Array, found: FloatArray, nearest: float, first: int, last: int) -> bool:
    """Whether everything that is drawn in a box (4,) of pixels is at least so near [1/m]."""
    i0 = min(max(int(found[0]), 0) // WIDE, floors.shape[1] - 1)
    i1 = min(max(int(np.ceil(found[2])), 0) // WIDE, floors.shape[1] - 1)
    j0, j1 = max(int(found[1]), first) // HIGH, min(int(np.ceil(found[3])), last - 1) // HIGH
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if floors[j, i] < 1.0001 * nearest:  # against rounding
                return False
    return True


@kernel
def group_is_hidden(
    sphere: FloatArray, rays: Rays, optics: Optics, floors: Float32Array, first: int, last: int
) -> bool:
    """Whether a group of triangles lies outside of the image or behind what is drawn."""
    row = rays.origins.shape[0] // 2
    R, o = rays.turns[row], rays.origins[row]
    dx, dy, dz = sphere[0] - o[0], sphere[1] - o[1], sphere[2] - o[2]
    x, y = R[0, 0] * dx + R[1, 0] * dy + R[2, 0] * dz, R[0, 1] * dx + R[1, 1] * dy + R[2, 1] * dz
    z, r = R[0, 2] * dx + R[1, 2] * dy + R[2, 2] * dz, sphere[3] + optics.shift * rays.origins.shape[0]
    if z - r < 2.0 * NEAR_M:
        return False
    box, found = np.empty(4), np.empty(4)
    box[0], box[1] = min((x - r) / (z - r), (x - r) / (z + r)), min((y - r) / (z - r), (y - r) / (z + r))
    box[2], box[3] = max((x + r) / (z - r), (x + r) / (z + r)), max((y + r) / (z - r), (y + r) / (z + r))
    stretch = 1.0 + max(box[0] ** 2, box[2] ** 2) + max(box[1] ** 2, box[3] ** 2)
    if not _pixel_box(optics, box, optics.turn * stretch * rays.origins.shape[0], found):
        return True
    return is_hidden(floors, found, 1.0 / (z - r), first, last)
