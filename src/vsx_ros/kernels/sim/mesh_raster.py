"""Which triangle each ray of an image meets first: a z-buffer over exact rays.

A triangle with corners a, b, c relative to the camera is met by the ray D if D has the same sign against b x c, c x a
and a x b (Olano and Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997). These are linear in D, so
the rays may be bent by any lens; the corners are taken relative to the camera of each row (rolling shutter). Triangles
that share an edge leave no gap: its form is the same to the last bit, with the other sign."""

import numpy as np

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.sim.mesh_boxes import HIGH, WIDE, Optics, box_of, group_is_hidden, is_hidden, note_depths
from vsx_ros.kernels.sim.mesh_scene import MeshScene, Rays

BLOCK = 16  # pixels of a row that are skipped together
_REFRESH = (3, 8, 16, 30, 60, 120, 240)  # groups of triangles after which the tiles' depths are noted
_HALF_ALPHA = 125
_EDGE_ON = 1e-13  # volume [m3] of a triangle with the camera, seen from its edge


@part
def edge_forms(corners: Float32Array, t: int, origins: FloatArray, row: int, forms: FloatArray) -> float:
    """forms (3, 3): b x c, c x a, a x b of triangle t, of (T, 9), relative to the origin of a row, with the sign that
    makes them positive for rays that meet the triangle in front. Returns six times its volume with the origin."""
    ox, oy, oz = origins[row, 0], origins[row, 1], origins[row, 2]
    ax, ay, az = corners[t, 0] - ox, corners[t, 1] - oy, corners[t, 2] - oz
    bx, by, bz = corners[t, 3] - ox, corners[t, 4] - oy, corners[t, 5] - oz
    cx, cy, cz = corners[t, 6] - ox, corners[t, 7] - oy, corners[t, 8] - oz
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
    place, uv, kind = scene.hole_places, scene.uv, scene.kinds[t]
    total = w0 + w1 + w2
    u = (w0 * uv[t, 0] + w1 * uv[t, 2] + w2 * uv[t, 4]) / total
    v = (w0 * uv[t, 1] + w1 * uv[t, 3] + w2 * uv[t, 5]) / total
    width, height = 1 << place[kind, 1], 1 << place[kind, 2]
    column, row = int(np.floor(u * width)) & (width - 1), int(np.floor((1.0 - v) * height)) & (height - 1)
    return bool(scene.holes[place[kind, 0] + (row << place[kind, 1]) + column] < _HALF_ALPHA)


@part
def _draw_row(
    scene: MeshScene, t: int, forms: FloatArray, volume: float, rays: Rays, y: int, first: int, last: int, bow: float,
    nearness: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Draw triangle t into the pixels first..last of row y."""
    a0, a1, a2 = np.float32(forms[0, 0]), np.float32(forms[0, 1]), np.float32(forms[0, 2])
    b0, b1, b2 = np.float32(forms[1, 0]), np.float32(forms[1, 1]), np.float32(forms[1, 2])
    c0, c1, c2 = np.float32(forms[2, 0]), np.float32(forms[2, 1]), np.float32(forms[2, 2])
    n0 = np.float32((forms[0, 0] + forms[1, 0] + forms[2, 0]) / volume)
    n1 = np.float32((forms[0, 1] + forms[1, 1] + forms[2, 1]) / volume)
    n2 = np.float32((forms[0, 2] + forms[1, 2] + forms[2, 2]) / volume)
    slack_a = -np.float32(bow) * (abs(a0) + abs(a1) + abs(a2))
    slack_b = -np.float32(bow) * (abs(b0) + abs(b1) + abs(b2))
    slack_c = -np.float32(bow) * (abs(c0) + abs(c1) + abs(c2))
    d = rays.directions
    holes, zero, label = scene.hole_places[scene.kinds[t], 0] >= 0, np.float32(0.0), np.int32(t)
    for begin in range(first, last + 1, BLOCK):
        end = min(begin + BLOCK, last + 1)
        p, q = begin, end - 1
        if end - begin > 4:
            p0, p1, p2, q0, q1, q2 = d[y, 0, p], d[y, 1, p], d[y, 2, p], d[y, 0, q], d[y, 1, q], d[y, 2, q]
            if max(a0 * p0 + a1 * p1 + a2 * p2, a0 * q0 + a1 * q1 + a2 * q2) < slack_a:
                continue
            if max(b0 * p0 + b1 * p1 + b2 * p2, b0 * q0 + b1 * q1 + b2 * q2) < slack_b:
                continue
            if max(c0 * p0 + c1 * p1 + c2 * p2, c0 * q0 + c1 * q1 + c2 * q2) < slack_c:
                continue
        for x in range(begin, end):
            wa = a0 * d[y, 0, x] + a1 * d[y, 1, x] + a2 * d[y, 2, x]
            wb = b0 * d[y, 0, x] + b1 * d[y, 1, x] + b2 * d[y, 2, x]
            wc = c0 * d[y, 0, x] + c1 * d[y, 1, x] + c2 * d[y, 2, x]
            near = n0 * d[y, 0, x] + n1 * d[y, 1, x] + n2 * d[y, 2, x]
            if (wa >= zero) & (wb >= zero) & (wc >= zero) & (near > nearness[y, x]):
                if holes and _is_hole(scene, t, wa, wb, wc):
                    continue
                nearness[y, x], ident[y, x] = near, label


@part
def _crossed(
    forms: FloatArray, rays: Rays, rows: tuple[int, int], columns: tuple[int, int], bow: float, drift: float
) -> tuple[int, int]:
    """The columns of a band of rows, first and last, that a triangle may reach; none if the first is the larger.
    drift: how much its forms differ between the rows of the band, for a ray of length 1."""
    d, a, b = rays.directions, rows[0], rows[1]
    begin, end = columns[1] + 1, columns[0] - 1
    for p in range(columns[0], columns[1] + 1, WIDE):
        q, outside = min(p + WIDE - 1, columns[1]), False
        for i in range(3):
            e0, e1, e2 = forms[i, 0], forms[i, 1], forms[i, 2]
            most = max(
                max(e0 * d[a, 0, p] + e1 * d[a, 1, p] + e2 * d[a, 2, p],
                    e0 * d[a, 0, q] + e1 * d[a, 1, q] + e2 * d[a, 2, q]),
                max(e0 * d[b, 0, p] + e1 * d[b, 1, p] + e2 * d[b, 2, p],
                    e0 * d[b, 0, q] + e1 * d[b, 1, q] + e2 * d[b, 2, q]),
            )  # fmt: skip
            if most < -(bow * (abs(e0) + abs(e1) + abs(e2)) + drift):
                outside = True
                break
        if not outside:
            begin, end = min(begin, p), q
    return begin, end


@part
def _draw(
    scene: MeshScene, t: int, box: tuple[int, int, int, int], rays: Rays, optics: Optics, forms: FloatArray,
    nearness: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Draw triangle t into a box of columns and rows, u0, v0, u1, v1. forms (3, 3): scratch memory."""
    u0, v0, u1, v1 = box
    corners, moving = scene.corners, optics.shift > 0.0  # else all rows see the triangle from one point
    volume = edge_forms(corners, t, rays.origins, v0, forms)
    for top in range(v0, v1 + 1, HIGH):
        bottom, begin, end = min(top + HIGH - 1, v1), u0, u1
        if u1 - u0 >= WIDE:
            middle = (top + bottom) // 2
            if moving:
                edge_forms(corners, t, rays.origins, middle, forms)
            reach = 0.0
            for i in range(9):
                reach = max(reach, abs(corners[t, i] - rays.origins[middle, i % 3]))
            drift = 8.0 * HIGH * optics.shift * (reach + HIGH * optics.shift)
            begin, end = _crossed(forms, rays, (top, bottom), (u0, u1), optics.bow, drift)
        for y in range(top, bottom + 1 if begin <= end else top):
            if moving:
                volume = edge_forms(corners, t, rays.origins, y, forms)
            if volume > _EDGE_ON:
                _draw_row(
                    scene, t, forms, volume, rays, y, begin, end, optics.bow, nearness, ident
                )  # fmt: skip


@kernel
def rasterise(
    scene: MeshScene, order: IntArray, rays: Rays, optics: Optics, first: int, last: int,
    nearness: Float32Array, ident: Int32Array,
) -> None:  # fmt: skip
    """Fill the rows first..last - 1 of nearness (H, W), 1 / depth [1/m] or 0, and of ident (H, W), triangle or -1.
    order: the groups of triangles to draw, near ones first."""
    height, width = nearness.shape
    nearness[first:last], ident[first:last] = np.float32(0.0), np.int32(-1)
    cam, forms, box, found = np.empty((3, 3)), np.empty((3, 3)), np.empty(4), np.empty(4)
    bounds = optics.bounds
    stretch = 1.0 + max(bounds[0] ** 2, bounds[2] ** 2) + max(bounds[1] ** 2, bounds[3] ** 2)
    floors = np.zeros(((height + HIGH - 1) // HIGH, (width + WIDE - 1) // WIDE), np.float32)
    for place in range(len(order)):
        k = order[place]
        for refresh in _REFRESH:
            if place == refresh:
                note_depths(nearness, first, last, floors)
        if group_is_hidden(scene.spheres[k], rays, optics, floors, first, last):
            continue
        for t in range(scene.chunks[k], scene.chunks[k + 1]):
            depth = box_of(scene.corners, t, rays, optics, stretch, cam, box, found)
            if depth <= 0.0:
                continue
            u0, u1 = max(int(np.ceil(found[0])), 0), min(int(np.floor(found[2])), width - 1)
            v0, v1 = max(int(np.ceil(found[1])), first), min(int(np.floor(found[3])), last - 1)
            if u0 <= u1 and v0 <= v1 and not is_hidden(floors, found, 1.0 / depth, first, last):
                _draw(scene, t, (u0, v0, u1, v1), rays, optics, forms, nearness, ident)
