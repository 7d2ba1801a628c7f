"""The grid on one plane: evidence about each cell, which cells are surface, and why they are believed."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, IntArray, Points2, Points3, array_bytes
from vsx_ros.config import DenseConfig
from vsx_ros.dense.cells import CellKind, Cells
from vsx_ros.dense.photoconsistency import Judgement, judge
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.dense.region_growing import Contact, enclosed, fill_heights, floor_contact, grow_regions, supported_runs
from vsx_ros.kernels.dense.surface_cells import count_passing
from vsx_ros.kernels.dense.view_choice import Views
from vsx_ros.occupancy.virtual_scan import FOOT_M

_MARGIN_M = 0.3  # around a plane's points, which do not reach its edge
_BEHIND_M, _BEHIND_SHARE = 0.15, 0.08  # a point this far behind a cell, and this share of its range, is against it
_OTHER_M = 0.3  # A plane that moves so far is another
_GUESSED_SCORE = 0.5  # of cells that were filled in and not measured: between refuted and accepted
_ALIKE, _LOOKED_THROUGH = (0.75, 0.35), (0.05, 0.30)  # shares of the cells with points, on true planes and on others
_UNJUDGED = (0.0, -1.0, -1.0, 0, -1)  # Judgement


class Surface:
    """Evidence about the cells of a plane, in (W, H) arrays: columns along its right axis, rows up. Row 0 of a wall
    stands on the floor. ``due``: cells to judge (again); so are columns whose foot a new keyframe shows. What was
    judged is believed until it is judged again, also when the plane moves."""

    def __init__(self, plane: Plane, config: DenseConfig, unit: float, has_floor: bool) -> None:
        """unit: length of a metre in the map. has_floor: whether z = 0 is the floor."""
        self.judged_at = plane
        self._config, self._unit, self._size = config, unit, config.cell_m * unit
        self._stands = has_floor and plane.kind is PlaneKind.WALL
        self.low, shape = self._bounds(plane)
        self.due, self._passing = np.ones(shape, np.bool_), np.zeros(shape, np.int64)
        self._said = Judgement._make(np.full(shape, blank) for blank in _UNJUDGED)
        self._untested, self._contact = np.full(shape[0], self._stands), Contact.none(shape[0])

    @property
    def nbytes(self) -> int:
        """Size of the evidence [bytes]."""
        return array_bytes((self.due, self._untested, self._passing, self._said, self._contact))

    def _bounds(self, plane: Plane) -> tuple[NDArray[np.int64], tuple[int, int]]:
        margin = _MARGIN_M * self._unit
        low = np.floor((plane.extent[[0, 2]] - margin) / self._size).astype(np.int64)
        high = np.ceil((plane.extent[[1, 3]] + margin) / self._size).astype(np.int64)
        if self._stands:
            low[1] = 0
        shape = np.maximum(high - low, 1)
        return low, (int(shape[0]), int(shape[1]))

    def extended(self, plane: Plane) -> bool:
        """Enlarge the grid for a plane that has grown; new cells are due. Returns whether it was enlarged: then
        ``look_through`` must begin afresh, as keyframes of before also look through the new cells."""
        low, shape = self._bounds(plane)
        before = np.maximum(self.low - low, 0)
        after = np.maximum(low + shape - self.low - self.due.shape, 0)
        if not before.any() and not after.any():
            return False
        pad = [(int(before[0]), int(after[0])), (int(before[1]), int(after[1]))]
        self.low = self.low - before
        self.due = np.pad(self.due, pad, constant_values=True)
        self._said = Judgement._make(np.pad(a, pad, constant_values=blank) for a, blank in zip(self._said, _UNJUDGED))
        known, self._contact = self._contact, Contact.none(len(self.due))
        for column, before_it in zip(self._contact, known):
            column[before[0] : before[0] + len(before_it)] = before_it
        self._untested = np.pad(self._untested, pad[0], constant_values=self._stands)
        return True

    def is_of(self, plane: Plane) -> bool:
        """Whether the plane may be the one that was judged. Ids follow points, and those may change to another wall."""
        return plane.kind is self.judged_at.kind and not has_moved(self.judged_at, plane, _OTHER_M * self._unit)

    def move(self, plane: Plane) -> None:
        """Take the plane's new place, with all cells due. What was judged stays believed until it is judged again."""
        self.extended(plane)
        self.judged_at = plane
        self.due[:], self._untested[:] = True, self._stands

    def centres(self, plane: Plane, cells: IntArray) -> Points3:
        """(N, 3) world positions of cells (N, 2), indices of the arrays."""
        coordinates: Points2 = np.asarray((cells + self.low + 0.5) * self._size, np.float64)
        return plane.points_at(coordinates)

    def look_through(
        self, plane: Plane, centres: Points3, points: Points3, keyframe: Int32Array, point: Int32Array, afresh: bool
    ) -> None:
        """Count the keyframes that see a point behind the plane through each cell. keyframe, point (O,): rows of
        centres and of points for each observation, ordered by keyframe. afresh: forget those counted before."""
        if afresh:
            self._passing = np.zeros(self.due.shape, np.int64)
        behind = np.array([_BEHIND_M * self._unit, _BEHIND_SHARE])
        frame = np.vstack([plane.axes, plane.normal])
        count_passing(
            frame, plane.offset, centres, points, keyframe, point, behind, self.low, self._size, self._passing
        )

    def mark_seen(self, plane: Plane, views: Views, moved: IntArray) -> None:
        """Mark as due again what is visible in some of the views: cells that are not yet consistent, and the foot; and
        what was judged in keyframes that have moved (ids)."""
        self.due |= np.isin(self._said.keyframe, moved)
        self._untested |= np.isin(self._contact.keyframe, moved)
        open_cells = np.argwhere(~self.due & ~self._said.consistent(self._config))
        self.due[tuple(open_cells[self._shown(plane, open_cells, views)].T)] = True
        if self._stands:
            self._untested |= self._shown(plane, _bottom(self.due), views)

    def _shown(self, plane: Plane, cells: IntArray, views: Views) -> BoolArray:
        """(N,) which cells (N, 2) are visible in some of the views."""
        near, (_, height_px, width_px) = self._config.max_range_m * self._unit, views.table[0]
        centres, shown = self.centres(plane, cells), np.zeros(len(cells), np.bool_)
        for R, t in zip(views.R, views.t):
            x, y, z = R @ centres.T + t[:, None]
            ahead = np.maximum(z, 1e-6)
            u, v = views.K[0] * x / ahead + views.K[2], views.K[1] * y / ahead + views.K[3]
            shown |= (z > 0.0) & (z < near) & (u > 0.0) & (v > 0.0) & (u < width_px) & (v < height_px)
        return shown

    @property
    def is_due(self) -> bool:
        """Whether there is anything to judge."""
        return bool(self.due.any() or self._untested.any())

    def work(self, plane: Plane, views: Views, budget: int, load: Callable[[Views], Views]) -> int:
        """Judge at most ``budget`` of the due cells, and of the columns whose foot is due; returns how many in all.
        load: gives the views that are needed their images."""
        cells, columns = np.argwhere(self.due)[:budget], np.flatnonzero(self._untested)[:budget]
        centres = self.centres(plane, np.vstack([cells, _bottom(self.due)[columns]]))
        views = load(views.at(self._useful(plane, views, plane.coordinates(centres))))
        said = judge(views, np.vstack([plane.axes, plane.normal]), centres[: len(cells)], self._config, self._unit)
        where = tuple(cells.T)
        self.due[where], self._untested[columns] = False, False
        for known, new in zip(self._said, said):
            known[where] = new
        if len(columns):
            contact = floor_contact(views, plane, columns + self.low[0], self._config)
            for column, tested in zip(self._contact, contact):
                column[columns] = tested
        return len(cells) + len(columns)

    def _useful(self, plane: Plane, views: Views, cells: Points2) -> IntArray:
        """Rows of the views that may show some of the cells: in front of them and in reach. cells (N, 2): their
        coordinates on the plane."""
        reach, there = self._config.max_range_m * self._unit, plane.coordinates(views.centres)
        beside = np.maximum(cells.min(axis=0) - there, there - cells.max(axis=0)).max(axis=1)
        ahead = plane.distances(views.centres)
        return np.flatnonzero((beside < reach) & (ahead > 0.0) & (ahead < reach))

    def cells(self, plane: Plane, points: Points3, seen_by: IntArray, ids: IntArray) -> Cells:
        """The surface cells. points (M, 3): those of the plane. seen_by (M,): ids of living keyframes that see them, -1
        for none. ids: those of all keyframes, ascending; the cells' keyframe is an index into it."""
        seed, seed_keyframe = self._seeds(plane, points, seen_by)
        said, strong = self._said, self._said.consistent(self._config)
        weak = (said.score >= self._config.grow_zncc) & (said.score > said.rival)
        against = said.refuted(self._passing)
        believed = grow_regions(seed & ~(against & ~strong), strong, weak, self._passing)
        filled = self._standing(believed, against)
        holes = enclosed(believed | filled, against)
        kind = np.full(seed.shape, -1, np.int64)
        for mask, why in ((holes, CellKind.ENCLOSED), (filled, CellKind.CONTACT), (believed, CellKind.PHOTO)):
            kind[mask] = why
        kind[believed & seed] = CellKind.SEED
        keyframe = np.where((said.keyframe < 0) | (seed & ~strong), seed_keyframe, said.keyframe)
        keyframe = np.where(kind == CellKind.CONTACT, self._contact.keyframe[:, None], keyframe)
        keyframe = _nearest_known(keyframe, np.isin(keyframe, ids))
        kind[keyframe < 0] = -1
        score = np.where((kind == CellKind.PHOTO) | (kind == CellKind.SEED), said.score, _GUESSED_SCORE)
        where = np.nonzero(kind >= 0)
        shown = self._contact.touches[where[0]] & (self._size * where[1] < FOOT_M)
        witnesses = np.where(shown[:, None], self._contact.witnesses[where[0]], -1)
        witnesses[~np.isin(witnesses, ids)] = -1
        cells = np.stack(where, axis=1).astype(np.int64)
        return Cells(
            plane=np.full(len(cells), plane.id, np.int64),
            cell=cells + self.low,
            centre=self.centres(plane, cells),
            kind=kind[where],
            score=np.clip(score[where], 0.0, 1.0),
            keyframe=np.searchsorted(ids, keyframe[where]).astype(np.int64),
            witnesses=np.where(witnesses < 0, -1, np.searchsorted(ids, witnesses)).astype(np.int64),
        )

    def evidence(self, plane: Plane, points: Points3) -> float:
        """Log likelihood ratio, from images and rays at the plane's own points (M, 3): a true surface against a plane
        that only crosses other surfaces there. On the latter most cells look unlike, or keyframes look through them."""
        seed, _ = self._seeds(plane, points, np.zeros(len(points), np.int64))
        said, through = self._said, self._passing > 0
        judged = seed & (said.texture >= self._config.min_texture) & (said.views >= 2) & ~through
        alike = (said.score >= self._config.grow_zncc) & (said.score > said.rival)
        return _log_ratio(judged, alike, _ALIKE) + _log_ratio(seed, through, _LOOKED_THROUGH)

    def _seeds(self, plane: Plane, points: Points3, seen_by: IntArray) -> tuple[BoolArray, NDArray[np.int64]]:
        cells = np.floor(plane.coordinates(points) / self._size).astype(np.int64) - self.low
        inside = ((cells >= 0) & (cells < self.due.shape)).all(axis=1)
        seed, keyframe = np.zeros(self.due.shape, np.bool_), np.full(self.due.shape, -1, np.int64)
        seed[tuple(cells[inside].T)] = True
        keyframe[tuple(cells[inside].T)] = seen_by[inside]
        return seed, keyframe

    def _standing(self, believed: BoolArray, against: BoolArray) -> BoolArray:
        """Cells filled from the floor up where the wall touches it."""
        if not self._stands:
            return np.zeros_like(believed)
        support: BoolArray = np.any(believed, axis=1)
        runs = supported_runs(self._contact.touches, support, self._config)
        rows = np.arange(believed.shape[1])
        filled: BoolArray = (rows < fill_heights(believed, runs, self._config)[:, None]) & ~believed
        return filled & ~(against & (self._passing > 0))


def _bottom(cells: BoolArray) -> IntArray:
    """(W, 2) the lowest cell of each column of (W, H) ones."""
    return np.stack([np.arange(len(cells)), np.zeros(len(cells), np.int64)], axis=1)


def _log_ratio(asked: BoolArray, yes: BoolArray, shares: tuple[float, float]) -> float:
    """Log likelihood ratio of the number of yes among those asked, for the first share against the second."""
    agree, all_of = np.count_nonzero(asked & yes), np.count_nonzero(asked)
    first, second = shares
    return agree * math.log(first / second) + (all_of - agree) * math.log((1.0 - first) / (1.0 - second))


def has_moved(before: Plane, now: Plane, limit: float) -> bool:
    """Whether any corner of the plane's former extent has moved by more than ``limit``."""
    a, b, c, d = before.extent
    corners: FloatArray = np.array([[a, c], [a, d], [b, c], [b, d]])
    return bool((np.linalg.norm(before.points_at(corners) - now.points_at(corners), axis=1) > limit).any())


def _nearest_known(values: NDArray[np.int64], known: BoolArray) -> NDArray[np.int64]:
    """(W, H) values, each unknown one replaced by the nearest known one; all -1 if none is known."""
    if not known.any():
        return np.full_like(values, -1)
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of_label = np.zeros(int(labels.max()) + 1, np.int64)
    of_label[labels[known]] = values[known]
    return np.asarray(of_label[labels])
