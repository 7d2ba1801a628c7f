"""Light baked into a lattice: lamps with their shadows, and how much of the surroundings each node sees."""

import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray
from vsx_ros.kernels import kernel

BOUNCE = 0.45  # of the ambient light comes from surfaces that are near
_SOFT2_M2 = 0.04  # square of a lamp's radius


@kernel
def fill_cells(corners: Float32Array, frame: FloatArray, solid: BoolArray) -> None:
    """Set the cells of solid (Z, Y, X) that triangles (T, 9) touch. frame (4,): origin and spacing of the cells'
    centres [m]."""
    step = frame[3]
    for t in range(corners.shape[0]):
        p = corners[t]
        ux, uy, uz = p[3] - p[0], p[4] - p[1], p[5] - p[2]
        vx, vy, vz = p[6] - p[0], p[7] - p[1], p[8] - p[2]
        longest = np.sqrt(max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz))
        n = max(1, int(np.ceil(longest / (0.5 * step))))
        for i in range(n + 1):
            for j in range(n + 1 - i):
                a, b = i / n, j / n
                x = int(np.floor((p[0] + a * ux + b * vx - frame[0]) / step + 0.5))
                y = int(np.floor((p[1] + a * uy + b * vy - frame[1]) / step + 0.5))
                z = int(np.floor((p[2] + a * uz + b * vz - frame[2]) / step + 0.5))
                if 0 <= z < solid.shape[0] and 0 <= y < solid.shape[1] and 0 <= x < solid.shape[2]:
                    solid[z, y, x] = True


@kernel
def _free_way(
    solid: BoolArray, x: float, y: float, z: float, dx: float, dy: float, dz: float, cells: float, spare: float
) -> bool:
    """Whether a ray from a node meets no solid cell within so many cells, without the first and the last ones."""
    s = 1.0 + spare
    while s < cells - spare:
        i, j, k = int(x + s * dx + 0.5), int(y + s * dy + 0.5), int(z + s * dz + 0.5)
        if not (0 <= k < solid.shape[0] and 0 <= j < solid.shape[1] and 0 <= i < solid.shape[2]):
            return True
        if solid[k, j, i]:
            return False
        s += 0.7
    return True


@kernel
def _add(node: Float32Array, dx: float, dy: float, dz: float, amount: float) -> None:
    """Add light that comes from the direction d to the six faces of a node."""
    node[0 if dx > 0.0 else 1] += np.float32(amount * abs(dx))
    node[2 if dy > 0.0 else 3] += np.float32(amount * abs(dy))
    node[4 if dz > 0.0 else 5] += np.float32(amount * abs(dz))


@kernel
def bake(
    solid: BoolArray, frame: FloatArray, sky: FloatArray, reach: float, ambient: float, lamps: FloatArray,
    light: Float32Array,
) -> None:  # fmt: skip
    """Fill light (Z, Y, X, 6) at nodes that are not solid. sky (N, 3): directions spread evenly; a solid within reach
    [cells] reflects ``BOUNCE`` of the ambient light. lamps (L, 13): kind (0 point, 1 spot, 2 directional), position,
    direction, strength, range, constant, linear, quadratic, cosine of the half angle."""
    step, share = frame[3], 4.0 * ambient / sky.shape[0]
    for k in range(solid.shape[0]):
        for j in range(solid.shape[1]):
            for i in range(solid.shape[2]):
                node = light[k, j, i]
                node[:] = np.float32(0.0)
                if solid[k, j, i]:
                    continue
                for n in range(sky.shape[0]):
                    dx, dy, dz = sky[n, 0], sky[n, 1], sky[n, 2]
                    free = _free_way(solid, i, j, k, dx, dy, dz, reach, 0.0)
                    _add(node, dx, dy, dz, share if free else BOUNCE * share)
                for lamp in lamps:
                    dx, dy, dz, far = -lamp[4], -lamp[5], -lamp[6], 1e9
                    if lamp[0] < 2.0:
                        dx, dy = lamp[1] - frame[0] - i * step, lamp[2] - frame[1] - j * step
                        dz = lamp[3] - frame[2] - k * step
                        far = np.sqrt(dx * dx + dy * dy + dz * dz + 1e-9)
                        dx, dy, dz = dx / far, dy / far, dz / far
                        if far > lamp[8]:
                            continue
                        if lamp[0] == 1.0 and -(dx * lamp[4] + dy * lamp[5] + dz * lamp[6]) < lamp[12]:
                            continue
                    fade = 1.0
                    if lamp[0] < 2.0:
                        fade = 1.0 / (lamp[9] + lamp[10] * far + lamp[11] * far * far + _SOFT2_M2)
                    if _free_way(solid, i, j, k, dx, dy, dz, min(far / step, 400.0), 1.0):
                        _add(node, dx, dy, dz, lamp[7] * min(fade, 4.0))


@kernel
def smooth(known: BoolArray, light: Float32Array) -> tuple[BoolArray, Float32Array]:
    """The mean light of each node and its 26 neighbours, of those that are known (Z, Y, X); and which are known now."""
    filled, mean, total = known.copy(), light.copy(), np.zeros(6)
    for k in range(known.shape[0]):
        for j in range(known.shape[1]):
            for i in range(known.shape[2]):
                count = 0
                total[:] = 0.0
                for c in range(max(k - 1, 0), min(k + 2, known.shape[0])):
                    for b in range(max(j - 1, 0), min(j + 2, known.shape[1])):
                        for a in range(max(i - 1, 0), min(i + 2, known.shape[2])):
                            if known[c, b, a]:
                                count += 1
                                for f in range(6):
                                    total[f] += light[c, b, a, f]
                if count:
                    filled[k, j, i] = True
                    for f in range(6):
                        mean[k, j, i, f] = np.float32(total[f] / count)
    return filled, mean
