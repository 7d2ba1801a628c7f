"""Distance to ground that is not known to be free, checks along curves through it, and shortest paths over cells."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Points2
from vsx_ros.kernels import kernel


class DistanceField(NamedTuple):
    """Values (H, W) [m] at the middles of cells; origin_x, origin_y: outer corner of cell (0, 0) [m]."""

    values: FloatArray
    resolution: float
    origin_x: float
    origin_y: float

    def at(self, points_world: Points2) -> FloatArray:
        """(N,) bilinear values [m] at (N, 2) points; outside, the edge's value minus the distance to it.

        They are copied: numba takes an array that is read-only for another type."""
        return interpolate_many(self, np.array(points_world, float, order="C").reshape(-1, 2))

    def gradient(self, points_world: Points2) -> FloatArray:
        """(N, 2) central differences over one cell [m/m]."""
        return gradient_many(self, np.array(points_world, float, order="C").reshape(-1, 2))

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell at a position [m]; may lie outside."""
        return math.floor((y - self.origin_y) / self.resolution), math.floor((x - self.origin_x) / self.resolution)


@kernel
def _lower(best: FloatArray, left: FloatArray, right: FloatArray, side: float) -> None:
    """Lower best (N,) to left (N,) or right (N,) plus side where that is less."""
    for j in range(best.shape[0]):
        d = left[j] if left[j] < right[j] else right[j]
        best[j] = side + d if side + d < best[j] else best[j]


@kernel
def _distance_to(mask: BoolArray, reach: int) -> FloatArray:
    """(H, W) distance [cells] from the middle of each cell to the nearest square cell of the mask, at most reach."""
    rows, columns = mask.shape
    far = float(reach)
    vertical = np.empty((rows, columns))
    # Row by row, in memory order: down, then up.
    for j in range(columns):
        vertical[0, j] = 0.0 if mask[0, j] else far
    for i in range(1, rows):
        for j in range(columns):
            before = vertical[i - 1, j]
            vertical[i, j] = 0.0 if mask[i, j] else min(far, before + (0.5 if before == 0.0 else 1.0))
    for i in range(rows - 2, -1, -1):
        for j in range(columns):
            before = vertical[i + 1, j]
            vertical[i, j] = min(vertical[i, j], before + (0.5 if before == 0.0 else 1.0))
    squares = np.full(columns + 2 * reach, far * far)
    best = np.empty(columns)
    for i in range(rows):
        most = 0.0
        for j in range(columns):
            best[j] = vertical[i, j] * vertical[i, j]
            squares[reach + j] = best[j]
            most = max(most, best[j])
        # All cells of the row at once, one column further with every step, until none can improve.
        for k in range(1, reach + 1):
            side = (k - 0.5) * (k - 0.5)
            if k % 4 == 0:
                most = best.max()
            if side >= most:
                break
            left, right = squares[reach - k : reach - k + columns], squares[reach + k : reach + k + columns]
            _lower(best, left, right, side)
        for j in range(columns):
            vertical[i, j] = min(far, math.sqrt(best[j]))  # of this row alone, which no other row needs
    return vertical


@kernel
def signed_distance(blocked: BoolArray, reach: int) -> FloatArray:
    """(H, W) distance [cells] to the nearest blocked square, negative inside by the distance to the nearest open one.

    blocked (H, W) bool. Distances are measured from the middle of the cell and cut off at ``reach`` cells."""
    outside = _distance_to(blocked, reach)
    inside = _distance_to(~blocked, reach)
    for i in range(blocked.shape[0]):
        for j in range(blocked.shape[1]):
            if blocked[i, j]:
                outside[i, j] = -inside[i, j]
    return outside


@kernel
def interpolate(field: DistanceField, x: float, y: float) -> float:
    """Bilinear value of a field; beyond the middles of the outermost cells, their value minus the distance to them."""
    values, resolution, x0, y0 = field
    rows, columns = values.shape
    u = (x - x0) / resolution - 0.5
    w = (y - y0) / resolution - 0.5
    cu = min(max(u, 0.0), columns - 1.0)
    cw = min(max(w, 0.0), rows - 1.0)
    j = min(int(cu), max(columns - 2, 0))
    i = min(int(cw), max(rows - 2, 0))
    j1, i1 = min(j + 1, columns - 1), min(i + 1, rows - 1)
    fu, fw = cu - j, cw - i
    low = values[i, j] * (1.0 - fu) + values[i, j1] * fu
    high = values[i1, j] * (1.0 - fu) + values[i1, j1] * fu
    value: float = low * (1.0 - fw) + high * fw
    if u != cu or w != cw:
        value -= math.hypot(u - cu, w - cw) * resolution
    return value


@kernel
def interpolate_many(field: DistanceField, points: FloatArray) -> FloatArray:
    """(N,) ``interpolate`` at points (N, 2)."""
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        out[i] = interpolate(field, points[i, 0], points[i, 1])
    return out


@kernel
def gradient_many(field: DistanceField, points: FloatArray) -> FloatArray:
    """(N, 2) central differences of ``interpolate`` over one cell at points (N, 2)."""
    out = np.empty((points.shape[0], 2))
    h = 0.5 * field.resolution
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = (interpolate(field, x + h, y) - interpolate(field, x - h, y)) / field.resolution
        out[i, 1] = (interpolate(field, x, y + h) - interpolate(field, x, y - h)) / field.resolution
    return out


@kernel
def least_on_curve(field: DistanceField, table: FloatArray, direction: float, step: float) -> float:
    """Least value of the field on a curve given by knots (M, 5) of s, x, y, theta, kappa, at most ``step`` apart.

    Between knots that lie further apart the positions are interpolated by cubics with the knots' exact tangents."""
    least = interpolate(field, table[0, 1], table[0, 2])
    for k in range(table.shape[0] - 1):
        h = table[k + 1, 0] - table[k, 0]
        n = max(1, int(math.ceil(h / step)))
        for m in range(1, n):
            u = m / n
            blend, before, after = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u) ** 2, h * u * u * (1.0 - u)
            before, after = direction * before, direction * after
            x = table[k, 1] + blend * (table[k + 1, 1] - table[k, 1])
            x += before * math.cos(table[k, 3]) - after * math.cos(table[k + 1, 3])
            y = table[k, 2] + blend * (table[k + 1, 2] - table[k, 2])
            y += before * math.sin(table[k, 3]) - after * math.sin(table[k + 1, 3])
            least = min(least, interpolate(field, x, y))
        least = min(least, interpolate(field, table[k + 1, 1], table[k + 1, 2]))
    return least


@kernel
def wavefront(open_cells: BoolArray, row: int, column: int) -> FloatArray:
    """(H, W) length [cells] of the shortest 8-connected way from a cell through open cells; inf where there is none.

    open_cells (H, W) bool. A diagonal step needs both cells beside it open, except from the start. Exact."""
    rows, columns = open_cells.shape
    size = rows * columns
    distance = np.full((rows, columns), np.inf)
    queued = np.zeros((rows, columns), np.bool_)
    ring = np.empty(size + 1, np.int64)
    head, tail = 0, 1
    ring[0] = row * columns + column
    distance[row, column] = 0.0
    queued[row, column] = True
    diagonal = math.sqrt(2.0)
    while head != tail:
        i, j = ring[head] // columns, ring[head] % columns
        head = head + 1 if head < size else 0
        queued[i, j] = False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= rows or b >= columns or not open_cells[a, b]:
                    continue
                corner = di != 0 and dj != 0
                if corner and not (open_cells[i, b] and open_cells[a, j]) and not (i == row and j == column):
                    continue
                d = distance[i, j] + (diagonal if corner else 1.0)
                if d < distance[a, b] - 1e-9:
                    distance[a, b] = d
                    if not queued[a, b]:
                        queued[a, b] = True
                        ring[tail] = a * columns + b
                        tail = tail + 1 if tail < size else 0
    return distance
