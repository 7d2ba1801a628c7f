"""Binary descriptors of corners: what matches images whose relative pose is unknown (Rublee et al., ORB, 2011; upright,
because neither robots nor people hold a camera by its side)."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import IntArray, Pixels
from vsx_ros.vision.corners import Corners
from vsx_ros.vision.patch_search import from_level
from vsx_ros.vision.pyramid import LEVELS, Pyramid

BORDER_PX, PATCH_PX = 16, 31
MAX_DISTANCE_BITS, DISTINCT = 64, 0.9
_CORNERS, _SQUARE_PX = (220, 150, 90, 40), (20, 14, 12, 8)


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


def features_of(pyramid: Pyramid, corners: Corners) -> Features:
    """The strongest corner of every small square of the image, described."""
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
