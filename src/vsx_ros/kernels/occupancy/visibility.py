"""What a camera on the robot would see from candidate poses: unknown cells, and known landmarks."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2
from vsx_ros.kernels import kernel

OCCUPIED, UNKNOWN = 100, -1  # of nav_msgs/OccupancyGrid
_MOST_HALVES = 32_767  # of int16; after far fewer half looks no weight is left


class Looks(NamedTuple):
    """Looks at cells so far. halves (H, W, S): half looks at each cell from each of S equal sectors of bearings; left
    (N,): the weight of another look after n half ones; wanted (H, W): cells that have a weight."""

    halves: NDArray[np.int16]
    left: FloatArray
    wanted: BoolArray


@kernel
def unknown_area_by_bearing(
    data: NDArray[np.int8], looks: Looks, resolution: float, origin_x: float, origin_y: float,
    positions: Points2, bearings: FloatArray, range_m: float, mean_free_path_m: float,
) -> FloatArray:  # fmt: skip
    """(N, B) area [m2], weighted by the looks so far, of the unknown cells seen from each position (N, 2) around each
    of B equally spaced bearings; the weight depends on which sector the bearing is in.

    A ray runs to the first occupied cell, the edge of the grid or range_m. Unknown cells may be obstacles: cells behind
    them count by the probability that they are seen, exp(-s / mean_free_path_m) after s metres of unknown ground. Each
    step counts the area of its ring sector, so near cells are not counted twice."""
    rows, columns = data.shape
    n, b, sectors = positions.shape[0], bearings.shape[0], looks.halves.shape[2]
    width = 2.0 * math.pi / b
    step = resolution
    passed = math.exp(-step / mean_free_path_m)
    area = np.zeros((n, b))
    for i in range(n):
        for j in range(b):
            c, s = math.cos(bearings[j]), math.sin(bearings[j])
            k = int(math.floor(bearings[j] * sectors / (2.0 * math.pi))) % sectors
            total, seen = 0.0, 1.0
            r = 0.5 * step
            while r < range_m:
                column = int(math.floor((positions[i, 0] + r * c - origin_x) / resolution))
                row = int(math.floor((positions[i, 1] + r * s - origin_y) / resolution))
                if row < 0 or column < 0 or row >= rows or column >= columns:
                    break
                value = data[row, column]
                if value == OCCUPIED:
                    break
                if value == UNKNOWN:
                    if looks.wanted[row, column]:
                        total += seen * looks.left[looks.halves[row, column, k]] * step * r * width
                    seen *= passed
                r += step
            area[i, j] = total
    return area


@kernel
def count_half_looks(
    data: NDArray[np.int8], resolution: float, origin_x: float, origin_y: float, poses: FloatArray, half_fov: float,
    range_m: float, sectors: int,
) -> NDArray[np.int16]:  # fmt: skip
    """(H, W, S) half looks at each cell, at most 32767, separately for each of S equal sectors of the bearing to it.
    Each pose (N, 3: x, y, theta) with the cell in the field of view, in range and not hidden adds two, and one in each
    of the two sectors beside."""
    rows, columns = data.shape
    halves = np.zeros((rows, columns, sectors), np.int16)
    last = np.full((rows, columns), -1, np.int32)
    rays = int(math.ceil(2.0 * half_fov * range_m / resolution))
    for i in range(poses.shape[0]):
        for j in range(rays + 1):
            angle = poses[i, 2] - half_fov + 2.0 * half_fov * j / rays
            c, s = math.cos(angle), math.sin(angle)
            k = int(math.floor(angle * sectors / (2.0 * math.pi))) % sectors
            r = 0.5 * resolution
            while r < range_m:
                column = int(math.floor((poses[i, 0] + r * c - origin_x) / resolution))
                row = int(math.floor((poses[i, 1] + r * s - origin_y) / resolution))
                if row < 0 or column < 0 or row >= rows or column >= columns or data[row, column] == OCCUPIED:
                    break
                if last[row, column] != i:
                    last[row, column] = i
                    for sector, more in ((k, 2), ((k - 1) % sectors, 1), ((k + 1) % sectors, 1)):
                        halves[row, column, sector] = min(halves[row, column, sector] + more, _MOST_HALVES)
                r += resolution
    return halves


@kernel
def visible_landmarks(
    data: NDArray[np.int8], resolution: float, origin_x: float, origin_y: float, poses: FloatArray, landmarks: Points2,
    half_fov: float, range_min: float, range_max: float,
) -> IntArray:  # fmt: skip
    """(N,) how many landmarks (M, 2) each pose (N, 3: x, y, theta) would see: within the field of view and
    range, and not behind an occupied cell (cells within 0.2 m of the landmark do not count: it sits on them)."""
    rows, columns = data.shape
    counts = np.zeros(poses.shape[0], np.int64)
    for i in range(poses.shape[0]):
        x, y, theta = poses[i, 0], poses[i, 1], poses[i, 2]
        for k in range(landmarks.shape[0]):
            dx, dy = landmarks[k, 0] - x, landmarks[k, 1] - y
            distance = math.sqrt(dx * dx + dy * dy)
            if distance < range_min or distance > range_max:
                continue
            off = math.atan2(dy, dx) - theta
            off -= 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))
            if abs(off) > half_fov:
                continue
            ux, uy = dx / distance, dy / distance
            r, hidden = resolution, False
            while r < distance - 0.2:
                column = int(math.floor((x + r * ux - origin_x) / resolution))
                row = int(math.floor((y + r * uy - origin_y) / resolution))
                if 0 <= row < rows and 0 <= column < columns and data[row, column] == OCCUPIED:
                    hidden = True
                    break
                r += resolution
            if not hidden:
                counts[i] += 1
    return counts


@kernel
def seen_cells(opaque: BoolArray, viewers: IntArray, reach: float, n_rays: int) -> BoolArray:
    """(H, W) bool: cells that a ray from any viewer (V, 2: row, column) meets within ``reach`` cells.

    opaque: (H, W) bool; a ray sees the first opaque cell it meets and ends there."""
    rows, columns = opaque.shape
    seen = np.zeros((rows, columns), np.bool_)
    for v in range(viewers.shape[0]):
        for r in range(n_rays):
            angle = 2.0 * math.pi * r / n_rays
            dy, dx = 0.5 * math.sin(angle), 0.5 * math.cos(angle)
            y, x = viewers[v, 0] + 0.5, viewers[v, 1] + 0.5
            for _ in range(int(2.0 * reach)):
                y += dy
                x += dx
                row, column = math.floor(y), math.floor(x)
                if row < 0 or row >= rows or column < 0 or column >= columns:
                    break
                seen[row, column] = True
                if opaque[row, column]:
                    break
    return seen
