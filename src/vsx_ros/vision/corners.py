"""FAST corners on every pyramid level, and the strongest of them as candidates for new map points."""

import math
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, GrayImage
from vsx_ros.kernels.slam.tracking import index_rows
from vsx_ros.vision.pyramid import LEVELS, Pyramid

_REFERENCE_PIXELS = 640 * 480
_TRACKED, _DENSE = (1300, 700, 350, 175), (2600, 1400, 700, 350)
_FIRST_THRESHOLDS = (12, 15, 15, 10)
_THRESHOLDS = (5, 120)


class Corners(NamedTuple):
    """positions (N, 2) int32 level px, sorted by level and row; row_table: index of every row's first corner;
    counts (4,): corners per level."""

    positions: NDArray[np.int32]
    row_table: NDArray[np.int64]
    counts: tuple[int, ...]


class CornerDetector:
    """FAST-9 whose thresholds follow the scene: each level steers its corner count towards a target."""

    def __init__(self) -> None:
        self._thresholds = list(_FIRST_THRESHOLDS)

    def detect(self, pyramid: Pyramid, steer: bool = True) -> Corners:
        """All corners of the four levels, without non-maximum suppression. steer: whether their number shall move the
        thresholds."""
        area = float(pyramid.table[0, 1] * pyramid.table[0, 2]) / _REFERENCE_PIXELS
        levels = []
        for level in range(LEVELS):
            found = _fast(pyramid.level(level), self._thresholds[level], suppress=False)
            levels.append(found)
            if steer:
                self._steer(level, len(found), _TRACKED[level] * area)
        return indexed(levels, pyramid)

    def _steer(self, level: int, count: int, target: float) -> None:
        lowest, highest = _THRESHOLDS
        threshold = self._thresholds[level]
        if count > 2.5 * target:
            threshold += max(4, threshold // 4)
        elif count > 1.2 * target:
            threshold += 1
        elif count < 0.4 * target:
            threshold -= 3
        elif count < 0.8 * target:
            threshold -= 1
        self._thresholds[level] = min(max(threshold, lowest), highest)


def dense_corners(pyramid: Pyramid) -> Corners:
    """Twice as many corners as tracking needs, for an image in which new points are looked for."""
    area = float(pyramid.table[0, 1] * pyramid.table[0, 2]) / _REFERENCE_PIXELS
    return indexed([_about(pyramid.level(k), _FIRST_THRESHOLDS[k], _DENSE[k] * area) for k in range(LEVELS)], pyramid)


def _about(image: GrayImage, threshold: int, target: float) -> NDArray[np.int32]:
    """Corners at the threshold that gives about the wanted number of them, as near as five trials come."""
    low, high = _THRESHOLDS
    for _ in range(5):
        found = _fast(image, threshold, suppress=False)
        low, high = (threshold, high) if len(found) > target else (low, threshold)
        # Counts fall about with the square of the threshold; where they do not, halving the interval helps.
        wanted = round(threshold * math.sqrt(max(len(found), 1) / target))
        wanted = wanted if low < wanted < high else round(math.sqrt(low * high))
        if wanted == threshold or 0.8 * target < len(found) < 1.25 * target:
            break
        threshold = wanted
    return found


def indexed(levels: list[NDArray[np.int32]], pyramid: Pyramid) -> Corners:
    """Corners from their level px, one (n, 2) a level, sorted by row."""
    counts = tuple(len(found) for found in levels)
    positions = np.concatenate(levels)
    return Corners(positions, index_rows(positions, np.array(counts), pyramid.table), counts)


def _fast(image: GrayImage, threshold: int, suppress: bool) -> NDArray[np.int32]:
    keypoints = _fast_detector(threshold, suppress).detect(image)
    if not keypoints:
        return np.zeros((0, 2), np.int32)
    positions: NDArray[np.int32] = np.asarray(cv2.KeyPoint.convert(keypoints)).astype(np.int32)
    return positions


@lru_cache(maxsize=256)
def _fast_detector(threshold: int, suppress: bool) -> cv2.FastFeatureDetector:
    return cv2.FastFeatureDetector.create(threshold, suppress)


def strongest(
    image: GrayImage, occupied: BoolArray, count: int, spacing_px: int = 8, min_eigenvalue: float = 3e-4
) -> NDArray[np.int32]:
    """Up to ``count`` well-spread corners (N, 2) of one level, best first: FAST maxima by their smaller eigenvalue.

    occupied (H, W): where no corner is wanted. min_eigenvalue in squared grey levels per px, grey in [0, 1].
    """
    border = 14
    found: NDArray[np.int32] = _fast(image, 7, suppress=True)
    height, width = image.shape
    inside = (
        (found[:, 0] >= border)
        & (found[:, 1] >= border)
        & (found[:, 0] < width - border)
        & (found[:, 1] < height - border)
    )
    found = found[inside]
    found = found[~occupied[found[:, 1], found[:, 0]]]
    strength = np.asarray(cv2.cornerMinEigenVal(image, 7))[found[:, 1], found[:, 0]]
    order = np.argsort(-strength, kind="stable")
    order = order[strength[order] > min_eigenvalue]
    return _spread(found[order], count, spacing_px, (height, width))


def _spread(ranked: NDArray[np.int32], count: int, spacing_px: int, shape: tuple[int, int]) -> NDArray[np.int32]:
    """Greedy: take the best, forbid its neighbourhood, go on."""
    taken = np.zeros(shape, np.bool_)
    chosen = []
    for x, y in ranked:
        if taken[y, x]:
            continue
        chosen.append((x, y))
        if len(chosen) == count:
            break
        taken[max(0, y - spacing_px) : y + spacing_px + 1, max(0, x - spacing_px) : x + spacing_px + 1] = True
    return np.array(chosen, np.int32).reshape(-1, 2)
