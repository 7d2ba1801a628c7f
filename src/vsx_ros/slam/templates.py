"""Templates of map points: patches cut from keyframes, from several directions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray, grown
from vsx_ros.kernels.vision.patches import PATCH

VIEWS = 5  # templates kept per point, from different sides; a new one replaces the oldest but the first


class Templates(NamedTuple):
    """Templates of points from several directions. of_point (P, V): template numbers, -1 for none; source (T,):
    keyframe index; basis (T, 4): see ``predict``; offset (T, 2) and patches (T, 24, 24): see ``warp_template``."""

    of_point: IntArray
    source: IntArray
    basis: FloatArray
    offset: FloatArray
    patches: NDArray[np.uint8]


class NewTemplates(NamedTuple):
    """Templates to add to the map: basis (N, 4), offset (N, 2), patches (N, 24, 24)."""

    basis: FloatArray
    offset: FloatArray
    patches: NDArray[np.uint8]


class TemplateStore:
    """Templates are written once and shared with views; only their assignment to points changes."""

    def __init__(self) -> None:
        self._points = self._count = 0
        self._of_point: IntArray = np.full((1024, VIEWS), -1, np.int64)
        basis, offset, patches = np.zeros((1024, 4)), np.zeros((1024, 2)), np.zeros((1024, PATCH, PATCH), np.uint8)
        self._columns: list[NDArray[Any]] = [np.zeros(1024, np.int64), basis, offset, patches]

    @staticmethod
    def resumed(templates: Templates) -> TemplateStore:
        """A store that continues from the templates of a view."""
        store = TemplateStore()
        store._points, store._of_point = len(templates.of_point), templates.of_point.copy()
        store._count, store._columns = len(templates.source), list(templates[1:])
        return store

    def add_points(self, count: int) -> None:
        """Add ``count`` points without templates."""
        self._points += count
        self._of_point = grown(self._of_point, self._points)
        self._of_point[self._points - count : self._points] = -1

    def add(self, rows: IntArray, templates: NewTemplates, source: int) -> None:
        """Add templates of points (rows) from keyframe ``source``; a new one replaces the oldest but the first."""
        first = self._count
        self._count += len(rows)
        self._columns = [grown(column, self._count) for column in self._columns]
        for column, new in zip(self._columns, (source, *templates)):
            column[first : self._count] = new
        free = self._of_point[rows] < 0
        full = ~free.any(axis=1)
        self._of_point[rows[full], 1:-1] = self._of_point[rows[full], 2:]
        slot = np.where(full, VIEWS - 1, free.argmax(axis=1))
        self._of_point[rows, slot] = np.arange(first, self._count)

    def view(self) -> Templates:
        """All templates, for searching."""
        return Templates._make(
            [self._of_point[: self._points].copy(), *(rows[: self._count] for rows in self._columns)]
        )
