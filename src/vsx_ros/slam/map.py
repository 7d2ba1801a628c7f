"""The mutable map of keyframes and points. It belongs to the mapper; all others get views."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, GrowingArray, IntArray, Points3, packed
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.keyframe import FrameData, KeyFrame, MapView, Observations, is_metric
from vsx_ros.slam.map_index import PointObservers, StackedPoses
from vsx_ros.slam.templates import NewTemplates, TemplateStore


class Map:
    """The mutable map. points (P, 3) world; alive (P,): whether a row is still in the map; source (P,): index of the
    keyframe each was made in. Rows are never reused. odom_segment: that of new keyframes."""

    def __init__(self) -> None:
        self.version = 0
        self.odom_segment = 0
        self.keyframes: list[KeyFrame] = []
        self._carried: dict[int, list[int]] = {}
        self._observers, self._poses = PointObservers(), StackedPoses()
        self._points = GrowingArray(np.zeros((0, 3)))
        self._alive = GrowingArray(np.zeros(0, np.bool_))
        self._source = GrowingArray(np.zeros(0, np.int64))
        self.templates = TemplateStore()

    @property
    def points(self) -> Points3:
        """See the class; may be written."""
        return self._points.rows

    @property
    def alive(self) -> BoolArray:
        """See the class; may be written."""
        return self._alive.rows

    @property
    def source(self) -> IntArray:
        """See the class; never written."""
        return self._source.rows

    @staticmethod
    def resumed(view: MapView) -> Map:
        """A map that continues from a view; its new keyframes begin a new odometry segment."""
        world = Map()
        world.version, world.keyframes = view.version, list(view.keyframes)
        world.odom_segment = 1 + max(keyframe.odom_segment for keyframe in view.keyframes)
        for k, keyframe in enumerate(view.keyframes):
            if keyframe.anchor is not None:
                world._carried.setdefault(keyframe.anchor.keyframe, []).append(k)
            world._observers.add(k, keyframe.observations.rows)
        world._points, world._alive = GrowingArray(view.points.copy()), GrowingArray(view.alive.copy())
        world._source = GrowingArray(view.source)
        world.templates = TemplateStore.resumed(view.templates)
        return world

    def clear(self) -> None:
        """Remove everything; the version number continues."""
        vars(self).update(vars(Map()), version=self.version + 1)

    def add_keyframe(self, data: FrameData, T_world_cam: SE3, observations: Observations, map_id: int = 0) -> int:
        """Append a keyframe; returns its index, which is also its id."""
        index = len(self.keyframes)
        depth = self.keyframes[-1].median_depth if self.keyframes else 0.0
        self.keyframes.append(
            KeyFrame(
                id=index,
                data=packed(data),
                T_world_cam=T_world_cam,
                observations=packed(observations),
                median_depth=depth,
                odom_segment=self.odom_segment,
                map_id=map_id,
            )
        )
        self._observers.add(index, observations.rows)
        self.update_depth(index)
        return index

    def add_points(self, points_world: Points3, templates: NewTemplates, source: int) -> NDArray[np.int64]:
        """Append points (N, 3) first seen in keyframe ``source``; returns their rows."""
        rows = len(self.points) + np.arange(len(points_world))
        self._points.append(points_world)
        self._alive.append(np.ones(len(rows), np.bool_))
        self._source.append(np.full(len(rows), source))
        self.templates.add_points(len(rows))
        self.templates.add(rows, templates, source)
        return rows

    def observe(self, index: int, more: Observations) -> None:
        """Add observations to a keyframe."""
        self._set_observations(index, Observations.concatenated([self.keyframes[index].observations, more]))
        self._observers.add(index, more.rows)

    def forget(self, index: int, mask: BoolArray) -> None:
        """Remove the observations of a keyframe where mask (n,) is set."""
        self._set_observations(index, self.keyframes[index].observations.where(~mask))

    def _set_observations(self, index: int, observations: Observations) -> None:
        self.keyframes[index] = replace(self.keyframes[index], observations=packed(observations))

    def move_keyframe(self, index: int, T_world_cam: SE3) -> None:
        """Give a living keyframe a new pose; culled ones anchored to it move with it."""
        self.keyframes[index] = replace(self.keyframes[index], T_world_cam=T_world_cam)
        for k in self._carried.get(index, ()):
            anchor = self.keyframes[k].anchor
            assert anchor is not None
            self.keyframes[k] = replace(self.keyframes[k], T_world_cam=anchor.pose(self.keyframes))

    def resize_keyframe(self, index: int, T_world_cam: SE3, factor: float) -> None:
        """Scale a living keyframe and the culled ones anchored to it by ``factor``, and give it a new pose."""
        for k in (index, *self._carried.get(index, ())):
            keyframe = self.keyframes[k]
            depth = factor * keyframe.median_depth
            self.keyframes[k] = replace(keyframe, scale=factor * keyframe.scale, median_depth=depth)
        self.move_keyframe(index, T_world_cam)

    def join(self, map_id: int, into: int) -> None:
        """All keyframes of one map become part of another."""
        self.keyframes = [replace(k, map_id=into) if k.map_id == map_id else k for k in self.keyframes]

    def replace_points(self, old: IntArray, new: IntArray) -> None:
        """Replace the points ``old`` (rows) by ``new`` (as many) in all observations and remove the old ones."""
        becomes = np.arange(len(self.points))
        becomes[old] = new
        for index in self._observers.of(old):
            observed = self.keyframes[index].observations
            renamed = observed.renamed(becomes)
            if not np.array_equal(renamed.rows, observed.rows):
                self._set_observations(index, renamed)
                self._observers.add(index, renamed.rows)
        self.alive[old] = False

    @property
    def living(self) -> list[int]:
        """Indices of the keyframes that are not culled."""
        return [k for k, keyframe in enumerate(self.keyframes) if keyframe.alive]

    def living_in(self, map_id: int) -> list[int]:
        """Indices of the living keyframes of one map."""
        return [k for k, keyframe in enumerate(self.keyframes) if keyframe.alive and keyframe.map_id == map_id]

    def is_metric(self, map_id: int) -> bool:
        """Whether the given map began with odometry; then it is metric and level."""
        return is_metric(self.keyframes, map_id)

    def predecessors(self, index: int) -> Iterator[int]:
        """The living keyframes before this one in its segment, latest first."""
        segment = self.keyframes[index].odom_segment
        before = range(index - 1, -1, -1)
        return (k for k in before if self.keyframes[k].alive and self.keyframes[k].odom_segment == segment)

    def predecessor(self, index: int) -> int | None:
        """The latest of ``predecessors``, None where there is none."""
        return next(self.predecessors(index), None)

    def successor(self, index: int) -> int | None:
        """The living keyframe after this one in its segment, None for the last."""
        segment = self.keyframes[index].odom_segment
        return next((k for k in self.living if k > index and self.keyframes[k].odom_segment == segment), None)

    def observers(self, rows: IntArray) -> list[int]:
        """All living keyframes that see any of the points (rows), and some that do not; ascending."""
        return [k for k in self._observers.of(rows) if self.keyframes[k].alive]

    def covisible(self, rows: IntArray) -> IntArray:
        """(K,) how many of the points (rows) each keyframe sees."""
        wanted, shared = np.zeros(len(self.points), np.bool_), np.zeros(len(self.keyframes), np.int64)
        wanted[rows] = True
        for k in self.observers(rows):
            shared[k] = np.count_nonzero(wanted[self.keyframes[k].observations.rows])
        return shared

    def seen_by(self, indices: list[int]) -> IntArray:
        """Rows of the points in the map that any of the keyframes sees."""
        return np.flatnonzero(self.sees(indices) & self.alive)

    def sees(self, indices: list[int]) -> BoolArray:
        """(P,) whether any of the keyframes sees a point."""
        mask = np.zeros(len(self.points), np.bool_)
        for k in indices:
            mask[self.keyframes[k].observations.rows] = True
        return mask

    def seen(self, rows: IntArray) -> IntArray:
        """(P,) how many living keyframes see each of the points (rows); counts of other points may be too low."""
        every = [self.keyframes[k].observations.rows for k in self.observers(rows)]
        return np.bincount(np.concatenate([np.zeros(0, np.int64), *every]), minlength=len(self.points))

    def cull_keyframe(self, index: int) -> None:
        """Remove a living keyframe for good. Keyframe 0 defines the world and cannot be culled.

        It keeps its index and what it saw, and is anchored to the living keyframe that shares most points with it. Its
        image is removed."""
        keyframe = self.keyframes[index]
        assert index > 0, "keyframe 0 holds the world"
        assert keyframe.alive, f"keyframe {index} is culled already"
        shared = self.covisible(keyframe.observations.rows)
        others = [k for k in self.living if k != index]
        parent = max(others, key=lambda k: (shared[k], -abs(k - index)))
        data = FrameData.without_image(keyframe.data.stamp_ns, keyframe.data.T_odom_base)
        observations = packed(keyframe.observations.without_pixels())
        self.keyframes[index] = replace(keyframe, data=data, observations=observations)
        carried, heir = [index, *self._carried.pop(index, [])], self.keyframes[parent]
        for k in carried:
            anchor = Anchor(parent, heir.T_world_cam.inverse() @ self.keyframes[k].T_world_cam, heir.scale)
            self.keyframes[k] = replace(self.keyframes[k], anchor=anchor)
        self._carried.setdefault(parent, []).extend(carried)

    def compress_keyframe(self, index: int) -> None:
        """Store a keyframe's image in less memory: it will not be needed soon."""
        keyframe = self.keyframes[index]
        self.keyframes[index] = replace(keyframe, data=packed(keyframe.data.compressed()))

    def remove_points(self, rows: IntArray) -> None:
        """Remove points and all their observations from the map."""
        self.alive[rows] = False
        for index in self.observers(rows):
            gone = ~self.alive[self.keyframes[index].observations.rows]
            if gone.any():
                self.forget(index, gone)

    def update_depth(self, index: int) -> None:
        """Recompute a keyframe's median scene depth."""
        keyframe = self.keyframes[index]
        self.keyframes[index] = replace(keyframe, median_depth=keyframe.depth_of(self.points))

    def view(self) -> MapView:
        """The present version of the map, for the tracker."""
        live = self.live_view()
        templates = live.templates._replace(of_point=live.templates.of_point.copy())
        return live._replace(points=live.points.copy(), alive=live.alive.copy(), templates=templates)

    def live_view(self) -> MapView:
        """The same without a copy: valid until the map is changed."""
        R, centres, depths = self._poses.of(self.keyframes)
        return MapView(
            version=self.version, keyframes=tuple(self.keyframes), living=np.array(self.living, np.int64),
            R_world_cam=R, centres=centres, depths=depths, points=self.points, alive=self.alive, source=self.source,
            templates=self.templates.live_view(),
        )  # fmt: skip
