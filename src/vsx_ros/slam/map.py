"""Keyframes, points and who saw what. The Map belongs to the mapper; everybody else gets immutable views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, GrayImage, IntArray, Pixels, Points3
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.patches import PATCH
from vsx_ros.vision.corners import Corners
from vsx_ros.vision.pyramid import Pyramid
from vsx_ros.vision.small_image import SmallImage

VIEWS = 5


class Observations(NamedTuple):
    """Points seen by one keyframe: rows (n,) in the map, uv (n, 2) level-0 px as in the image, ideal (n, 2) px without
    distortion, level (n,)."""

    rows: NDArray[np.int64]
    uv: Pixels
    ideal: Pixels
    level: NDArray[np.int64]

    @staticmethod
    def none() -> Observations:
        """No observation."""
        return Observations(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64))

    @staticmethod
    def concatenated(parts: list[Observations]) -> Observations:
        """All of them in one, in order."""
        parts = [Observations.none(), *parts]
        return Observations(
            np.concatenate([part.rows for part in parts]),
            np.concatenate([part.uv for part in parts]),
            np.concatenate([part.ideal for part in parts]),
            np.concatenate([part.level for part in parts]),
        )

    def where(self, mask: BoolArray) -> Observations:
        """Those the mask (n,) keeps."""
        return Observations(self.rows[mask], self.uv[mask], self.ideal[mask], self.level[mask])


class FrameData(NamedTuple):
    """An image taken apart once, used by tracker, mapper and relocaliser."""

    stamp_ns: int
    pyramid: Pyramid
    corners: Corners
    small: SmallImage
    T_odom_base: SE2 | None


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A frame the map is made of. Replaced, never changed."""

    id: int
    data: FrameData
    T_world_cam: SE3
    observations: Observations
    median_depth: float


class Templates(NamedTuple):
    """What points look like from several directions. of_point (P, V): template numbers, -1 for none; source (T,):
    keyframe index; basis (T, 4): see ``predict``; offset (T, 2) and patches (T, 24, 24): see ``warp_template``."""

    of_point: IntArray
    source: IntArray
    basis: FloatArray
    offset: FloatArray
    patches: NDArray[np.uint8]


class MapView(NamedTuple):
    """The map at one instant, for the tracker. points (P, 3) world, alive (P,). Rows never change meaning."""

    version: int
    keyframes: tuple[KeyFrame, ...]
    R_world_cam: FloatArray
    centres: Points3
    points: Points3
    alive: BoolArray
    templates: Templates


@dataclass(frozen=True, slots=True, eq=False)
class MapSnapshot:
    """The map as others see it. obs_keyframe and obs_point index the keyframes and points of this snapshot; obs_uv
    level-0 px as in the image (distorted), images are level 0."""

    version: int
    keyframe_ids: IntArray
    keyframe_stamps_ns: IntArray
    T_world_cams: tuple[SE3, ...]
    images: tuple[GrayImage, ...]
    point_ids: IntArray
    points_world: Points3
    obs_keyframe: IntArray
    obs_point: IntArray
    obs_uv: Pixels
    obs_level: IntArray


class NewTemplates(NamedTuple):
    """Looks of points about to enter the map: basis (N, 4), offset (N, 2), patches (N, 24, 24)."""

    basis: FloatArray
    offset: FloatArray
    patches: NDArray[np.uint8]


class Map:
    """The mutable map. Rows of points are never reused; templates are written once, hence shared with views."""

    def __init__(self) -> None:
        self.version = 0
        self.keyframes: list[KeyFrame] = []
        self.count = 0
        self._points = np.zeros((1024, 3))
        self._alive = np.zeros(1024, np.bool_)
        self._source = np.zeros(1024, np.int64)
        self._of_point = np.full((1024, VIEWS), -1, np.int64)
        self.template_count = 0
        self._template_source = np.zeros(1024, np.int64)
        self._basis = np.zeros((1024, 4))
        self._offset = np.zeros((1024, 2))
        self._patches = np.zeros((1024, PATCH, PATCH), np.uint8)

    @property
    def points(self) -> Points3:
        """(P, 3) world, a view to write into."""
        return self._points[: self.count]

    @property
    def alive(self) -> BoolArray:
        """(P,) whether a row is still in the map, a view to write into."""
        return self._alive[: self.count]

    @property
    def source(self) -> IntArray:
        """(P,) keyframe index each point was made in."""
        return self._source[: self.count]

    def add_keyframe(self, data: FrameData, T_world_cam: SE3, observations: Observations) -> int:
        """Append a keyframe; returns its index, which is also its id."""
        index = len(self.keyframes)
        depth = self.keyframes[-1].median_depth if self.keyframes else 0.0
        self.keyframes.append(KeyFrame(index, data, T_world_cam, observations, depth))
        self.update_depth(index)
        return index

    def add_points(self, points_world: Points3, looks: NewTemplates, source: int) -> NDArray[np.int64]:
        """Append points (N, 3) first seen in keyframe ``source``; returns their rows."""
        n = len(points_world)
        self._reserve(self.count + n, ("_points", "_alive", "_source", "_of_point"))
        rows = np.arange(self.count, self.count + n)
        self._points[rows] = points_world
        self._alive[rows] = True
        self._source[rows] = source
        self._of_point[rows] = -1
        self.count += n
        self.add_templates(rows, looks, source)
        return rows

    def add_templates(self, rows: IntArray, looks: NewTemplates, source: int) -> None:
        """Let points (rows) also be looked for as keyframe ``source`` shows them; the oldest look but the first
        gives way."""
        n = len(rows)
        self._reserve(self.template_count + n, ("_template_source", "_basis", "_offset", "_patches"))
        numbers = np.arange(self.template_count, self.template_count + n)
        self._template_source[numbers] = source
        self._basis[numbers] = looks.basis
        self._offset[numbers] = looks.offset
        self._patches[numbers] = looks.patches
        self.template_count += n
        free = self._of_point[rows] < 0
        full = ~free.any(axis=1)
        self._of_point[rows[full], 1:-1] = self._of_point[rows[full], 2:]
        slot = np.where(full, VIEWS - 1, free.argmax(axis=1))
        self._of_point[rows, slot] = numbers

    def _reserve(self, needed: int, names: tuple[str, ...]) -> None:
        for name in names:
            old = getattr(self, name)
            if needed > len(old):
                fresh = np.zeros((max(needed, 2 * len(old)), *old.shape[1:]), old.dtype)
                fresh[: len(old)] = old
                setattr(self, name, fresh)

    def observe(self, index: int, more: Observations) -> None:
        """Add observations to a keyframe."""
        keyframe = self.keyframes[index]
        self.keyframes[index] = replace(keyframe, observations=Observations.concatenated([keyframe.observations, more]))

    def forget(self, index: int, mask: BoolArray) -> None:
        """Remove the observations of a keyframe where mask (n,) is set."""
        keyframe = self.keyframes[index]
        self.keyframes[index] = replace(keyframe, observations=keyframe.observations.where(~mask))

    def move_keyframe(self, index: int, T_world_cam: SE3) -> None:
        """Give a keyframe a new pose."""
        self.keyframes[index] = replace(self.keyframes[index], T_world_cam=T_world_cam)

    def remove_points(self, rows: IntArray) -> None:
        """Take points out of the map, with all that was seen of them."""
        if not len(rows):
            return
        self.alive[rows] = False
        for index, keyframe in enumerate(self.keyframes):
            gone = ~self.alive[keyframe.observations.rows]
            if gone.any():
                self.forget(index, gone)

    def update_depth(self, index: int) -> None:
        """Recompute a keyframe's median scene depth from the points it sees (kept when it sees fewer than 5)."""
        keyframe = self.keyframes[index]
        rows = keyframe.observations.rows
        if len(rows) < 5:
            return
        R, t = keyframe.T_world_cam.rotation, keyframe.T_world_cam.translation
        depth = float(np.median((self._points[rows] - t) @ R[:, 2]))
        self.keyframes[index] = replace(keyframe, median_depth=depth)

    def view(self) -> MapView:
        """What the tracker works on until the next version."""
        n = self.count
        return MapView(
            self.version,
            tuple(self.keyframes),
            np.array([k.T_world_cam.rotation for k in self.keyframes]).reshape(-1, 3, 3),
            np.array([k.T_world_cam.translation for k in self.keyframes]).reshape(-1, 3),
            self._points[:n].copy(),
            self._alive[:n].copy(),
            self.templates(),
        )

    def templates(self) -> Templates:
        """All looks, for searching."""
        n = self.template_count
        return Templates(
            self._of_point[: self.count].copy(),
            self._template_source[:n],
            self._basis[:n],
            self._offset[:n],
            self._patches[:n],
        )


def empty_view() -> MapView:
    """The view of a map with nothing in it."""
    return Map().view()


def covisible(keyframes: tuple[KeyFrame, ...] | list[KeyFrame], rows: IntArray, n_points: int) -> IntArray:
    """(K,) how many of the given points each keyframe sees."""
    wanted = np.zeros(n_points, np.bool_)
    wanted[rows] = True
    return np.array([np.count_nonzero(wanted[k.observations.rows]) for k in keyframes], np.int64)


def snapshot(view: MapView) -> MapSnapshot:
    """The public form of a view: points that live and are seen at least twice, renumbered."""
    seen = np.zeros(len(view.points), np.int64)
    for keyframe in view.keyframes:
        seen[keyframe.observations.rows] += 1
    rows = np.flatnonzero(view.alive & (seen >= 2))
    number = np.full(len(view.points), -1, np.int64)
    number[rows] = np.arange(len(rows))
    kept = [k.observations.where(number[k.observations.rows] >= 0) for k in view.keyframes]
    every = Observations.concatenated(kept)
    return MapSnapshot(
        view.version,
        np.array([k.id for k in view.keyframes], np.int64),
        np.array([k.data.stamp_ns for k in view.keyframes], np.int64),
        tuple(k.T_world_cam for k in view.keyframes),
        tuple(k.data.pyramid.level(0) for k in view.keyframes),
        rows,
        view.points[rows],
        np.repeat(np.arange(len(kept)), [len(observed.rows) for observed in kept]),
        number[every.rows],
        every.uv,
        every.level,
    )
