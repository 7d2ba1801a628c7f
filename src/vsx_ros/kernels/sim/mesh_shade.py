"""The radiance of the pixels whose triangles are known: trilinear texture times light.

Along a row, neighbouring pixels of one triangle share its forms; light and level of detail, which are smooth, are
found where short runs begin and interpolated; a run ends where the next one begins."""

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Float32Array, FloatArray, Int32Array
from vsx_ros.kernels import kernel, part
from vsx_ros.kernels.sim.mesh_raster import edge_forms
from vsx_ros.kernels.sim.mesh_scene import MIP_LEVELS, MeshScene, Rays
from vsx_ros.kernels.sim.raycast_pixels import tint_index

RUN = 10  # most pixels between two looks at the light
OFFSET = 0.7  # of the light's spacing: how far in front of a surface its light is taken
F0, F1, HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
PER_255 = np.float32(1.0 / 255.0)
BYTE = np.uint32(255)


@part
def _texel(
    texels: NDArray[np.uint32], begin: int, lw: int, lh: int, u: np.float32, v: np.float32, shift: np.uint32
) -> np.float32:
    """Bilinear value (0..255) of one channel of a mip level at u, v (v downwards), which repeat."""
    width, height = 1 << lw, 1 << lh
    x, y = u * np.float32(width) - HALF, v * np.float32(height) - HALF
    x_floor, y_floor = np.floor(x), np.floor(y)
    fx, fy = x - x_floor, y - y_floor
    i0, j0 = int(x_floor) & (width - 1), int(y_floor) & (height - 1)
    i1, j1 = (i0 + 1) & (width - 1), (j0 + 1) & (height - 1)
    upper, lower = begin + (j0 << lw), begin + (j1 << lw)
    t00 = np.float32((texels[upper + i0] >> shift) & BYTE)
    t01 = np.float32((texels[upper + i1] >> shift) & BYTE)
    t10 = np.float32((texels[lower + i0] >> shift) & BYTE)
    t11 = np.float32((texels[lower + i1] >> shift) & BYTE)
    top, bottom = t00 + fx * (t01 - t00), t10 + fx * (t11 - t10)
    value: np.float32 = top + fy * (bottom - top)
    return value


@part
def _trilinear(
    texels: NDArray[np.uint32], levels: Int32Array, place: tuple[int, int, int], u: np.float32, v: np.float32,
    lod: np.float32, shift: np.uint32,
) -> np.float32:  # fmt: skip
    """Reflectance in one channel of a picture, between the two mip levels around lod. place: a row of ``pictures``."""
    row, lw, lh = place
    coarsest = max(lw, lh)
    level = min(int(lod), coarsest)
    value = _texel(texels, levels[row, level], max(lw - level, 0), max(lh - level, 0), u, v, shift)
    share = lod - np.float32(level)
    if share > F0 and level < coarsest:
        begin, a, b = levels[row, level + 1], max(lw - level - 1, 0), max(lh - level - 1, 0)
        value += share * (_texel(texels, begin, a, b, u, v, shift) - value)
    value *= PER_255
    return value * value


@part
def light_at(scene: MeshScene, x: float, y: float, z: float, nx: float, ny: float, nz: float) -> np.float32:
    """Irradiance of a surface with the unit normal n at a point [m], taken a little in front of it."""
    light, frame = scene.light, scene.light_frame
    step = frame[3]
    gx = min(max((x - frame[0]) / step + OFFSET * nx, 0.0), light.shape[2] - 1.001)
    gy = min(max((y - frame[1]) / step + OFFSET * ny, 0.0), light.shape[1] - 1.001)
    gz = min(max((z - frame[2]) / step + OFFSET * nz, 0.0), light.shape[0] - 1.001)
    i, j, k = int(gx), int(gy), int(gz)
    fx, fy, fz = gx - i, gy - j, gz - k
    a, b, c = (0 if nx > 0.0 else 1), (2 if ny > 0.0 else 3), (4 if nz > 0.0 else 5)
    wa, wb, wc = nx * nx, ny * ny, nz * nz
    total = 0.0
    for dk in range(2):
        for dj in range(2):
            for di in range(2):
                weight = (fx if di else 1.0 - fx) * (fy if dj else 1.0 - fy) * (fz if dk else 1.0 - fz)
                p, q, r = k + dk, j + dj, i + di
                total += weight * (wa * light[p, q, r, a] + wb * light[p, q, r, b] + wc * light[p, q, r, c])
    return np.float32(total)


@part
def _uv_forms(scene: MeshScene, t: int, rays: Rays, y: int, forms: FloatArray, uv: FloatArray) -> None:
    """uv (3, 3): forms of u, v and 1 of triangle t for the rays of row y. forms (3, 3): scratch memory."""
    edge_forms(scene.corners, t, rays.origins, y, forms)
    for j in range(3):
        uv[2, j] = forms[0, j] + forms[1, j] + forms[2, j]
    length = np.sqrt(uv[2, 0] ** 2 + uv[2, 1] ** 2 + uv[2, 2] ** 2)
    for j in range(3):
        uv[2, j] /= length  # keeps tiny triangles within the range of float32
        for i in range(2):
            uv[i, j] = 0.0
            for corner in range(3):
                uv[i, j] += scene.uv[t, 2 * corner + i] * forms[corner, j] / length


@part
def _light_of_pixel(scene: MeshScene, rays: Rays, y: int, x: int, uv: FloatArray, nearness: np.float32) -> np.float32:
    """Light on the triangle that pixel (y, x) sees. uv (3, 3): its last row is the normal, away from the camera."""
    far = 1.0 / nearness
    d, o = rays.directions, rays.origins
    px, py, pz = o[y, 0] + far * d[y, 0, x], o[y, 1] + far * d[y, 1, x], o[y, 2] + far * d[y, 2, x]
    return light_at(scene, px, py, pz, -uv[2, 0], -uv[2, 1], -uv[2, 2])


@part
def _level_of_detail(
    scene: MeshScene, kind: int, uv: FloatArray, rays: Rays, y: int, x: int, sharpness: np.float32
) -> np.float32:
    """The mip level that pixel (y, x) wants of its triangle's picture; between 0 and the last one. 0 without one."""
    if scene.pictures[kind, 0] < 0:
        return F0
    d = rays.directions
    wide, high = float(1 << scene.pictures[kind, 1]), float(1 << scene.pictures[kind, 2])
    d0, d1, d2 = d[y, 0, x], d[y, 1, x], d[y, 2, x]
    x0, x1, x2 = d[y, 0, x + 1] - d0, d[y, 1, x + 1] - d1, d[y, 2, x + 1] - d2
    y0, y1, y2 = d[y + 1, 0, x] - d0, d[y + 1, 1, x] - d1, d[y + 1, 2, x] - d2
    inverse = 1.0 / (uv[2, 0] * d0 + uv[2, 1] * d1 + uv[2, 2] * d2)
    u = (uv[0, 0] * d0 + uv[0, 1] * d1 + uv[0, 2] * d2) * inverse
    v = (uv[1, 0] * d0 + uv[1, 1] * d1 + uv[1, 2] * d2) * inverse
    cx, cy = uv[2, 0] * x0 + uv[2, 1] * x1 + uv[2, 2] * x2, uv[2, 0] * y0 + uv[2, 1] * y1 + uv[2, 2] * y2
    ux = (uv[0, 0] * x0 + uv[0, 1] * x1 + uv[0, 2] * x2 - u * cx) * inverse * wide
    uy = (uv[0, 0] * y0 + uv[0, 1] * y1 + uv[0, 2] * y2 - u * cy) * inverse * wide
    vx = (uv[1, 0] * x0 + uv[1, 1] * x1 + uv[1, 2] * x2 - v * cx) * inverse * high
    vy = (uv[1, 0] * y0 + uv[1, 1] * y1 + uv[1, 2] * y2 - v * cy) * inverse * high
    area = abs(ux * vy - uy * vx)  # of the pixel, in texels
    longest = ux * ux + uy * uy + vx * vx + vy * vy
    return np.float32(min(0.5 * np.log2(max(max(area, longest * sharpness), 1.0)), MIP_LEVELS - 1.0))


@part
def _shade_run(
    scene: MeshScene, kind: int, uv: FloatArray, rays: Rays, y: int, begin: int, end: int, ends: Float32Array,
    bayer: bool, share: np.float32, radiance: Float32Array,
) -> None:  # fmt: skip
    """Add the pixels begin..end - 1 of a row, all on one triangle. uv (3, 3): forms of u, v and 1. ends (2, 2): light
    and level of detail at begin, and how much they grow from pixel to pixel."""
    U0, U1, U2 = np.float32(uv[0, 0]), np.float32(uv[0, 1]), np.float32(uv[0, 2])
    V0, V1, V2 = np.float32(uv[1, 0]), np.float32(uv[1, 1]), np.float32(uv[1, 2])
    C0, C1, C2 = np.float32(uv[2, 0]), np.float32(uv[2, 1]), np.float32(uv[2, 2])
    light, lod, rise, fall = ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1]
    plain = scene.pictures[kind, 0] < 0
    d, texels, levels, colours = rays.directions, scene.texels, scene.levels, scene.colours
    place = scene.pictures[kind, 0], scene.pictures[kind, 1], scene.pictures[kind, 2]
    for x in range(begin, end):
        channel = tint_index(y, x, bayer)
        value = colours[kind, channel]
        if not plain:
            d0, d1, d2 = d[y, 0, x], d[y, 1, x], d[y, 2, x]
            inverse = F1 / (C0 * d0 + C1 * d1 + C2 * d2)
            u, v = (U0 * d0 + U1 * d1 + U2 * d2) * inverse, (V0 * d0 + V1 * d1 + V2 * d2) * inverse
            value *= _trilinear(texels, levels, place, u, F1 - v, max(lod, F0), np.uint32(8 * channel))
        radiance[y, x] += share * value * light
        light += rise
        lod += fall


@kernel
def shade_rows(
    scene: MeshScene, rays: Rays, nearness: Float32Array, ident: Int32Array, first: int, last: int, sharpness: float,
    bayer: bool, share: float, radiance: Float32Array,
) -> None:  # fmt: skip
    """Add share times the radiance of the rows first..last - 1 to radiance (H, W). sharpness: square of the shortest
    edge of a texture's footprint in relation to its longest, for the choice of the mip level."""
    width = ident.shape[1]
    forms, uv, ends, weight = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 2), np.float32), np.float32(share)
    for y in range(first, last):
        x, before = 0, np.int32(-1)
        while x < width:
            t = ident[y, x]
            if t < 0:
                radiance[y, x] += weight * np.float32(scene.sky)
                x, before = x + 1, t
                continue
            end = x + 1
            while end < width and end - x < RUN and ident[y, end] == t:
                end += 1
            kind, light, lod = scene.kinds[t], ends[1, 0], ends[1, 1]
            if t != before:
                _uv_forms(scene, t, rays, y, forms, uv)
                light = _light_of_pixel(scene, rays, y, x, uv, nearness[y, x])
                lod = _level_of_detail(scene, kind, uv, rays, y, x, np.float32(sharpness))
                before = t
            stop, light_end, lod_end = end if end < width and ident[y, end] == t else end - 1, light, lod
            if stop > x:
                light_end = _light_of_pixel(scene, rays, y, stop, uv, nearness[y, stop])
                lod_end = _level_of_detail(scene, kind, uv, rays, y, stop, np.float32(sharpness))
            per_pixel = F1 / np.float32(max(stop - x, 1))
            ends[0, 0], ends[0, 1] = light, lod
            ends[1, 0], ends[1, 1] = (light_end - light) * per_pixel, (lod_end - lod) * per_pixel
            _shade_run(scene, kind, uv, rays, y, x, end, ends, bayer, weight, radiance)
            ends[1, 0], ends[1, 1] = light_end, lod_end
            x = end
