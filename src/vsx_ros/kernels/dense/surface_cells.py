"""Whether small squares of a plane look the same from several keyframes (paper 5.1; Argiles, Civera, Montesano, IROS
2011), and through which of them rays pass.

Frame (3, 3) of a plane: right, up, normal (towards its observers), world."""

import math

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Int32Array, IntArray
from vsx_ros.kernels import kernel
from vsx_ros.kernels.dense.view_choice import VIEWS, Limits, Views, choose_views
from vsx_ros.kernels.geometry import transform

LEVELS = 4
SIDE = 8  # samples along the square that is compared
_NEAR_SHARE = 0.25  # of the least distance at which cells are judged; hypotheses of other depths come nearer


@kernel
def sample(pixels: NDArray[np.uint8], offset: int, height: int, width: int, u: float, v: float) -> float:
    """Bilinear grey value at pixel (u, v) of the level that begins at an offset; negative outside of it."""
    if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
        return -1.0
    c, r = int(u), int(v)
    fu, fv = u - c, v - r
    at = offset + r * width + c
    top = pixels[at] * (1.0 - fu) + pixels[at + 1] * fu
    bottom = pixels[at + width] * (1.0 - fu) + pixels[at + width + 1] * fu
    return float(top * (1.0 - fv) + bottom * fv)


@kernel
def _sample_patch(
    views: Views, k: int, frame: FloatArray, x: float, y: float, z: float, half: float, near: float, out: FloatArray
) -> bool:
    """Fill out (SIDE * SIDE,) with the grey values of a square centred at (x, y, z), ``half`` from its middle to its
    outer samples; False where any lies outside the image, behind the camera or close to it: the middle nearer than
    ``near``, or a sample than half of that. Lengths are those of the map."""
    pixels, R, t, K = views.store[views.slots[k]], views.R[k], views.t[k], views.K
    px, py, pz = transform(R, t, x, y, z)
    if pz < near:
        return False
    rx = R[0, 0] * frame[0, 0] + R[0, 1] * frame[0, 1] + R[0, 2] * frame[0, 2]
    ry = R[1, 0] * frame[0, 0] + R[1, 1] * frame[0, 1] + R[1, 2] * frame[0, 2]
    rz = R[2, 0] * frame[0, 0] + R[2, 1] * frame[0, 1] + R[2, 2] * frame[0, 2]
    ux = R[0, 0] * frame[1, 0] + R[0, 1] * frame[1, 1] + R[0, 2] * frame[1, 2]
    uy = R[1, 0] * frame[1, 0] + R[1, 1] * frame[1, 1] + R[1, 2] * frame[1, 2]
    uz = R[2, 0] * frame[1, 0] + R[2, 1] * frame[1, 1] + R[2, 2] * frame[1, 2]
    step = 2.0 * half / (SIDE - 1)
    spacing = K[0] * step / pz
    level = 0
    while level < LEVELS - 1 and spacing > 1.5:
        spacing *= 0.5
        level += 1
    offset, height, width = views.table[level, 0], views.table[level, 1], views.table[level, 2]
    shrink = 1.0 / (1 << level)
    for i in range(SIDE):
        b = half - i * step
        for j in range(SIDE):
            a = j * step - half
            qz = pz + a * rz + b * uz
            if qz < 0.5 * near:
                return False
            u = ((px + a * rx + b * ux) / qz * K[0] + K[2] + 0.5) * shrink - 0.5
            v = ((py + a * ry + b * uy) / qz * K[1] + K[3] + 0.5) * shrink - 0.5
            value = sample(pixels, offset, height, width, u, v)
            if value < 0.0:
                return False
            out[i * SIDE + j] = value
    return True


@kernel
def _standardise(patch: FloatArray) -> None:
    """Make the patch zero mean and unit norm in place."""
    n = patch.shape[0]
    mean = 0.0
    for i in range(n):
        mean += patch[i]
    mean /= n
    squares = 0.0
    for i in range(n):
        patch[i] -= mean
        squares += patch[i] * patch[i]
    scale = 1.0 / math.sqrt(squares + 1e-9)
    for i in range(n):
        patch[i] *= scale


@kernel
def _inner_texture(patch: FloatArray) -> float:
    """Standard deviation [grey levels] of a patch without its outermost samples, so that an edge beside the cell does
    not count."""
    total = squares = 0.0
    for i in range(1, SIDE - 1):
        for j in range(1, SIDE - 1):
            value = patch[i * SIDE + j]
            total += value
            squares += value * value
    n = (SIDE - 2) * (SIDE - 2)
    return math.sqrt(max(0.0, squares / n - (total / n) ** 2))


@kernel
def _second_best(values: FloatArray, n: int) -> float:
    best = second = -1.0
    for i in range(n):
        if values[i] > best:
            best, second = values[i], best
        elif values[i] > second:
            second = values[i]
    return second


@kernel
def judge_cells(
    views: Views, frame: FloatArray, cells: FloatArray, half: float, limits: Limits, gates: tuple[float, float],
    depths: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, IntArray]:  # fmt: skip
    """Compare cells (N, 3) between the keyframes; half: half of the square's side [m], limits: see choose_views.

    depths (D,): relative depths in the reference at which the comparison is repeated; a match that is as good there
    proves nothing. gates: least texture [grey levels] and least score to do that.
    Returns texture (N,) [grey levels], score (N,) and rival (N,): second best ZNCC over the views at the cell and at
    the best of the other depths, -1 where fewer than two views see it; views (N,): how many, without the reference;
    reference (N,): keyframe, -1 without."""
    n = cells.shape[0]
    texture, score, rival = np.zeros(n), np.full(n, -1.0), np.full(n, -1.0)
    counts, reference = np.zeros(n, np.int64), np.full(n, -1, np.int64)
    chosen, centres = np.zeros(VIEWS + 1, np.int64), views.centres
    look, other = np.zeros(SIDE * SIDE), np.zeros(SIDE * SIDE)
    alike, near = np.zeros(VIEWS), _NEAR_SHARE * limits[0]
    worth = np.zeros(centres.shape[0])
    for i in range(n):
        x, y, z = cells[i, 0], cells[i, 1], cells[i, 2]
        count = choose_views(views, frame, x, y, z, half, limits, worth, chosen)
        if count == 0:
            continue
        k = chosen[0]
        if not _sample_patch(views, k, frame, x, y, z, half, near, look):
            continue
        reference[i] = k
        texture[i] = _inner_texture(look)
        _standardise(look)
        if texture[i] < gates[0]:
            counts[i] = count - 1
            continue
        for d in range(-1, depths.shape[0]):
            depth = 1.0 if d < 0 else depths[d]
            cx = centres[k, 0] + depth * (x - centres[k, 0])
            cy = centres[k, 1] + depth * (y - centres[k, 1])
            cz = centres[k, 2] + depth * (z - centres[k, 2])
            seen = 0
            for m in range(1, count):
                if not _sample_patch(views, chosen[m], frame, cx, cy, cz, depth * half, near, other):
                    continue
                _standardise(other)
                dot = 0.0
                for s in range(SIDE * SIDE):
                    dot += look[s] * other[s]
                alike[seen] = dot
                seen += 1
            if d >= 0:
                rival[i] = max(rival[i], _second_best(alike, seen))
                continue
            counts[i] = seen
            score[i] = _second_best(alike, seen)
            if score[i] < gates[1]:
                break
    return texture, score, rival, counts, reference


@kernel
def count_passing(
    frame: FloatArray, offset: float, centres: FloatArray, points: FloatArray, obs_keyframe: Int32Array,
    obs_point: Int32Array, behind: FloatArray, low: IntArray, size: float, votes: IntArray,
) -> None:  # fmt: skip
    """Add to votes (W, H), the cells of a plane from index low (2,) on, how many keyframes see a point through each.

    Observations are sorted by keyframe. behind: least distance [m] of a point behind the plane, and least share of its
    distance from the camera."""
    width, height = votes.shape
    last = np.full((width, height), -1, np.int64)
    for o in range(obs_point.shape[0]):
        k, p = obs_keyframe[o], obs_point[o]
        before = after = -offset
        squares = 0.0
        for axis in range(3):
            before += frame[2, axis] * centres[k, axis]
            after += frame[2, axis] * points[p, axis]
            squares += (points[p, axis] - centres[k, axis]) ** 2
        if before < behind[0] or -after < max(behind[0], behind[1] * math.sqrt(squares)):
            continue
        share = before / (before - after)
        a = b = 0.0
        for axis in range(3):
            place = centres[k, axis] + share * (points[p, axis] - centres[k, axis])
            a += frame[0, axis] * place
            b += frame[1, axis] * place
        i, j = math.floor(a / size) - low[0], math.floor(b / size) - low[1]
        if 0 <= i < width and 0 <= j < height and last[i, j] != k:
            last[i, j] = k
            votes[i, j] += 1
