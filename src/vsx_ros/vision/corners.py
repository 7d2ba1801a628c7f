"""FAST corners on every pyramid level, the strongest of them as candidates for new map points, and binary descriptors
to match images of unknown relative pose (Rublee et al., ORB, 2011; upright, because cameras are not held sideways)."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, GrayImage, IntArray, Pixels
from vsx_ros.kernels.vision.fast import fast_corners
from vsx_ros.vision.pyramid import LEVELS, Pyramid, from_level

_REFERENCE_PIXELS = 640 * 480  # size of the image that numbers of corners refer to
_CORNERS_AT = (1300, 700, 350, 175)  # numbers of corners on the levels, in proportion
_FIRST_THRESHOLDS = (12, 15, 15, 10)  # FAST, grey levels, by pyramid level, for an ordinary room; they adapt
_THRESHOLDS = (5, 120)  # least (above the sensor's noise) and most
_FAST_MAXIMA = cv2.FastFeatureDetector.create(7, nonmaxSuppression=True)  # of ``strongest``
BORDER_PX, PATCH_PX = 16, 31  # ORB (Rublee et al.): patch of 31 px; distance to the border is half of it, rounded up
MAX_DISTANCE_BITS, DISTINCT = 64, 0.9  # of 256; largest ratio to the second best (Lowe's ratio test)
_MIN_EIGENVALUE = 3e-4  # of a corner [squared grey levels per px], grey in [0, 1]
_CORNERS, _SQUARE_PX = (220, 150, 90, 40), (20, 14, 12, 8)  # by level: most to describe, one per square (level px)


class Corners(NamedTuple):
    """positions (N, 2) level px by level and row; row_table: first corner of every row; counts (4,): per level."""

    positions: NDArray[np.int32]
    row_table: NDArray[np.int64]
    counts: tuple[int, ...]


class PackedCorners(NamedTuple):
    """The same in a quarter of the memory. columns (N,): x of each [level px]; per_row: how many lie in each row;
    first_rows (4,): of each level."""

    columns: NDArray[np.int16]
    per_row: NDArray[np.uint16]
    first_rows: NDArray[np.int64]
    counts: tuple[int, ...]

    @staticmethod
    def of(corners: Corners | PackedCorners, table: NDArray[np.int64]) -> PackedCorners:
        """table: that of the corners' ``Pyramid``."""
        columns, per_row = corners.positions[:, 0].astype(np.int16), np.diff(corners.row_table).astype(np.uint16)
        return PackedCorners(columns, per_row, table[:, 3], corners.counts)

    @property
    def positions(self) -> NDArray[np.int32]:
        """See ``Corners``."""
        y = np.repeat(np.arange(len(self.per_row)), self.per_row) - np.repeat(self.first_rows, self.counts)
        return np.stack([self.columns, y], axis=1).astype(np.int32)

    @property
    def row_table(self) -> NDArray[np.int64]:
        """See ``Corners``."""
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(self.per_row, dtype=np.int64)])


class CornerDetector:
    """FAST-9 whose thresholds follow the scene: each level steers its corner count towards a target."""

    def __init__(self, corners: int = _CORNERS_AT[0]) -> None:
        """corners: wanted on the finest level of a VGA image."""
        self._share = corners / _CORNERS_AT[0]
        self._thresholds = list(_FIRST_THRESHOLDS)

    def detect(self, pyramid: Pyramid, steer: bool = True) -> Corners:
        """All corners of the four levels, without suppression. steer: whether their number adapts the thresholds."""
        wanted = self._share * _vga_images(pyramid)
        levels = []
        for level in range(LEVELS):
            found = fast_corners(pyramid.level(level), self._thresholds[level])
            levels.append(found)
            if steer:
                self._steer(level, len(found), wanted * _CORNERS_AT[level])
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


def dense_corners(pyramid: Pyramid, corners: int) -> Corners:
    """About as many corners as wanted (on the finest level of a VGA image), from this image alone: more than tracking
    needs, for new points."""
    wanted = corners / _CORNERS_AT[0] * _vga_images(pyramid)
    targets = [wanted * count for count in _CORNERS_AT]
    return indexed([_about(pyramid.level(k), _FIRST_THRESHOLDS[k], targets[k]) for k in range(LEVELS)], pyramid)


def _vga_images(pyramid: Pyramid) -> float:
    """The size of the image, in VGA images."""
    return float(pyramid.table[0, 1] * pyramid.table[0, 2]) / _REFERENCE_PIXELS


def _about(image: GrayImage, threshold: int, target: float) -> NDArray[np.int32]:
    """Corners at a threshold that gives about the wanted number, found in at most five trials."""
    low, high = _THRESHOLDS
    for _ in range(5):
        found = fast_corners(image, threshold)
        low, high = (threshold, high) if len(found) > target else (low, threshold)
        # Counts fall about with the square of the threshold; where they do not, halving the interval helps.
        wanted = round(threshold * math.sqrt(max(len(found), 1) / target))
        wanted = wanted if low < wanted < high else round(math.sqrt(low * high))
        if wanted == threshold or 0.8 * target < len(found) < 1.25 * target:
            break
        threshold = wanted
    return found


def indexed(levels: list[NDArray[np.int32]], pyramid: Pyramid) -> Corners:
    """Corners from their level px, one (n, 2) array per level, sorted by row."""
    counts = tuple(len(found) for found in levels)
    positions = np.concatenate(levels)
    heights, first_rows = pyramid.table[:, 1], pyramid.table[:, 3]
    rows = np.repeat(first_rows, counts) + positions[:, 1]
    per_row = np.bincount(rows, minlength=first_rows[-1] + heights[-1])
    return Corners(positions, np.concatenate([[0], np.cumsum(per_row)]), counts)


def no_corners(pyramid: Pyramid) -> Corners:
    """No corners, for an image that is not searched."""
    return indexed([np.zeros((0, 2), np.int32)] * LEVELS, pyramid)


def strongest(image: GrayImage, occupied: BoolArray, count: int, spacing_px: int = 8) -> NDArray[np.int32]:
    """Up to ``count`` well-spread corners (N, 2) of one level, best first: FAST maxima by their smaller eigenvalue.

    occupied (H, W): where no corner is wanted."""
    border, (height, width) = 14, image.shape
    found = np.array(cv2.KeyPoint.convert(_FAST_MAXIMA.detect(image)), np.int32).reshape(-1, 2)
    found = found[((found >= border) & (found < [width - border, height - border])).all(axis=1)]
    found = found[~occupied[found[:, 1], found[:, 0]]]
    strength = np.asarray(cv2.cornerMinEigenVal(image, 7))[found[:, 1], found[:, 0]]
    order = np.argsort(-strength, kind="stable")
    order = order[strength[order] > _MIN_EIGENVALUE]
    return _spread(found[order], count, spacing_px, (height, width))


def _spread(ranked: NDArray[np.int32], count: int, spacing_px: int, shape: tuple[int, int]) -> NDArray[np.int32]:
    """Greedy: take the best, block its neighbourhood, repeat."""
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


class Features(NamedTuple):
    """uv (n, 2) level-0 px, level (n,), bits (n, 32) uint8: 256-bit descriptors."""

    uv: Pixels
    level: IntArray
    bits: NDArray[np.uint8]


def describe(pyramid: Pyramid, uv: Pixels, level: IntArray) -> tuple[IntArray, Features]:
    """Descriptors of the given places that are not too near to the border: (their indices, features)."""
    orb = cv2.ORB.create(len(uv) + 1, 2.0, LEVELS, BORDER_PX, 0, 2, cv2.ORB_HARRIS_SCORE, PATCH_PX, 20)
    points = [
        cv2.KeyPoint(float(u), float(v), float(PATCH_PX << int(k)), 0.0, 1.0, int(k), number)
        for number, ((u, v), k) in enumerate(zip(uv, level))
    ]
    kept, bits = orb.compute(pyramid.level(0), points)
    index = np.array([point.class_id for point in kept], np.int64)
    bits = np.zeros((0, 32), np.uint8) if bits is None else np.asarray(bits, np.uint8)
    order = np.argsort(index, kind="stable")
    index = index[order]
    return index, Features(uv[index], level[index], bits[order])


def features_of(pyramid: Pyramid, corners: Corners | PackedCorners) -> Features:
    """Features of the strongest corner in every small square of the image."""
    uv, level = [], []
    first = 0
    for k, count in enumerate(corners.counts):
        at = corners.positions[first : first + count].astype(np.int64)
        first += count
        strength = np.asarray(cv2.cornerMinEigenVal(pyramid.level(k), 7))[at[:, 1], at[:, 0]]
        square = (at[:, 1] // _SQUARE_PX[k]) * pyramid.level(k).shape[1] + at[:, 0] // _SQUARE_PX[k]
        order = np.lexsort((-strength, square))
        best = order[np.diff(square[order], prepend=-1) != 0]
        best = np.sort(best[np.argsort(-strength[best], kind="stable")[: _CORNERS[k]]])
        uv.append(from_level(at[best].astype(float), k))
        level.append(np.full(len(best), k, np.int64))
    return describe(pyramid, np.concatenate(uv), np.concatenate(level))[1]


def match(a: Features, b: Features) -> tuple[IntArray, IntArray]:
    """Indices into a and b of mutually nearest descriptors that are near enough, and nearer than the second nearest."""
    none = np.zeros(0, np.int64)
    if len(a.bits) < 2 or len(b.bits) < 2:
        return none, none
    distance, nearest = cv2.batchDistance(a.bits, b.bits, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=2)
    _, back = cv2.batchDistance(b.bits, a.bits, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=1)
    mutual = back[nearest[:, 0], 0] == np.arange(len(a.bits))
    keep = mutual & (distance[:, 0] <= MAX_DISTANCE_BITS) & (distance[:, 0] < DISTINCT * distance[:, 1])
    index = np.flatnonzero(keep)
    return index, nearest[index, 0].astype(np.int64)
