"""Templates of map points: patches cut from keyframes, from several directions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, GrowingArray, IntArray
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
        basis, offset, patches = np.zeros((0, 4)), np.zeros((0, 2)), np.zeros((0, PATCH, PATCH), np.uint8)
        self._of_point = GrowingArray(np.zeros((0, VIEWS), np.int64))
        self._columns = [GrowingArray[Any](rows) for rows in (np.zeros(0, np.int64), basis, offset, patches)]

    @staticmethod
    def resumed(templates: Templates) -> TemplateStore:
        """A store that continues from the templates of a view."""
        store = TemplateStore()
        store._of_point = GrowingArray(templates.of_point.copy())
        store._columns = [GrowingArray(rows) for rows in templates[1:]]
        return store

    def add_points(self, count: int) -> None:
        """Add ``count`` points without templates."""
        self._of_point.append(np.full((count, VIEWS), -1))

    def add(self, rows: IntArray, templates: NewTemplates, source: int) -> None:
        """Add templates of points (rows) from keyframe ``source``; a new one replaces the oldest but the first."""
        of_point, first = self._of_point.rows, len(self._columns[0].rows)
        more: list[NDArray[Any]] = [np.full(len(rows), source), *templates]
        for column, new in zip(self._columns, more):
            column.append(new)
        free = of_point[rows] < 0
        full = ~free.any(axis=1)
        of_point[rows[full], 1:-1] = of_point[rows[full], 2:]
        slot = np.where(full, VIEWS - 1, free.argmax(axis=1))
        of_point[rows, slot] = first + np.arange(len(rows))

    def live_view(self) -> Templates:
        """All templates, for searching; valid until some are added."""
        return Templates._make([self._of_point.rows, *(column.rows for column in self._columns)])
