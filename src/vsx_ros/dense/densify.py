"""The dense map: planes of the sparse map and their cells that are surface, updated as the map grows."""

import math
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.config import DenseConfig
from vsx_ros.dense.cells import Cells
from vsx_ros.dense.levelling import aligned, gravity
from vsx_ros.dense.photoconsistency import KeyframeImages
from vsx_ros.dense.plane_finding import PlaneFinder
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.dense.surface import Surface, has_moved
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.kernels.dense.view_choice import Views
from vsx_ros.slam.snapshot import MapSnapshot

_UNSETTLED = 2  # the newest keyframes, whose poses bundle adjustment is about to move
_OBLIQUE = math.log(1e4)  # log likelihood ratio needed by a plane that is neither level nor vertical
_MOVED_M = 0.02  # in a building; a quarter of a cell. Smaller moves do not change what its patches show
_AHEAD_M = 2.0  # where a keyframe's turns count: the typical distance of what it shows
UPDATE_EVERY_S = 1.5  # planes change slowly, and merging costs the same for one new keyframe as for three
_KEYFRAMES_OF_A_LAB = 800  # with more, updates cost more and come less often in proportion


def update_every_s(keyframes: int) -> float:
    """The period of updates [s] for a map of this many keyframes. An update costs more in a larger map; its share of
    the processor time must not grow."""
    return UPDATE_EVERY_S * max(1.0, keyframes / _KEYFRAMES_OF_A_LAB)


class DenseMap(NamedTuple):
    """The surface cells. version, newest_keyframe (id) and keyframe indices refer to the snapshot it was made of.
    complete: True if every cell has been judged with all settled keyframes, False if some wait for the next update.
    nbytes: size of what the next update continues from, images and evidence about cells."""

    version: int
    newest_keyframe: int
    planes: tuple[Plane, ...]
    cells: Cells
    complete: bool
    nbytes: int

    def is_due(self, snapshot: MapSnapshot) -> bool:
        """Whether an update is useful: the snapshot has a new keyframe, or cells still wait."""
        return not self.complete or int(snapshot.keyframe_ids[-1]) != self.newest_keyframe


class Densifier:
    """Call ``update`` with each snapshot of one growing map. The budget counts cells, not time, so the same snapshots
    give the same cells."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: DenseConfig, seed: int = 0) -> None:
        """T_base_cam: None for a map without floor and metric scale."""
        self._config, self._has_floor = config, T_base_cam is not None
        self._finder = PlaneFinder(camera.fx, config.planes, self._has_floor, seed)
        self._images = KeyframeImages(camera)
        self._surfaces: dict[int, Surface] = {}
        self._used: IntArray = np.zeros(0, np.int64)
        self._places = np.zeros((0, 3, 3))  # see ``_taken_over``

    @property
    def unit(self) -> float:
        """Length of a metre in the map; an estimate if the map is not metric."""
        return self._finder.unit

    @property
    def stored(self) -> Collection[int]:
        """Ids of the keyframes whose images are stored here, reduced: those of later snapshots are not read."""
        return self._images.ids

    def update(self, snapshot: MapSnapshot, budget: int | None = None, settled: bool = False) -> DenseMap:
        """The dense map of a snapshot. budget: most cells to judge, by default ``cells_per_update`` of the
        configuration; the rest waits. settled: the map will not change any more, so the newest keyframes are used,
        too."""
        planes = self._finder.update(snapshot)
        surfaces = [plane for plane in planes if plane.kind is not PlaneKind.FLOOR]
        views = self._images.views(snapshot, max(0, len(snapshot.images) - (0 if settled else _UNSETTLED)))
        rays = snapshot.rays
        used = rays.ids <= views.ids.max(initial=-1)
        R, centres = stacked(rays.T_world_cams)
        anew, moved = self._taken_over(rays.ids, used, R, centres)
        looks = np.flatnonzero(anew[rays.keyframe]), np.flatnonzero(used[rays.keyframe])
        fresh = views.at(np.flatnonzero(np.isin(views.ids, rays.ids[anew | moved])))
        self._surfaces = {
            plane.id: self._prepared(plane, snapshot, fresh, rays.ids[moved], centres, *looks) for plane in surfaces
        }
        self._work(surfaces, snapshot, views, self._config.cells_per_update if budget is None else budget)
        seen_by = np.full(len(snapshot.points_world), -1)
        seen_by[snapshot.obs_point] = snapshot.keyframe_ids[snapshot.obs_keyframe]
        points = snapshot.points_world
        planes = self._believed(planes, snapshot)
        seen = [(self._surfaces[p.id], p, p.points) for p in planes if p.kind is not PlaneKind.FLOOR]
        cells = Cells.concatenated([on.cells(plane, points[rows], seen_by[rows], rays.ids) for on, plane, rows in seen])
        complete = not len(views.ids) or not any(surface.is_due for surface in self._surfaces.values())
        newest = int(snapshot.keyframe_ids[-1]) if len(snapshot.keyframe_ids) else -1
        nbytes = self._images.nbytes + sum(surface.nbytes for surface in self._surfaces.values())
        return DenseMap(
            version=snapshot.version, newest_keyframe=newest, planes=planes, cells=cells, complete=complete,
            nbytes=nbytes,
        )  # fmt: skip

    def _believed(self, planes: tuple[Plane, ...], snapshot: MapSnapshot) -> tuple[Plane, ...]:
        """The planes that the images support. Planes that are neither level nor vertical need more evidence."""
        points, up = snapshot.points_world, np.array([0.0, 0.0, 1.0])
        surfaces = [(self._surfaces[plane.id], plane) for plane in planes if plane.id in self._surfaces]
        said = {plane.id: on.evidence(plane, points[plane.points]) for on, plane in surfaces}
        if not self._has_floor:
            up = gravity([plane for plane in planes if said[plane.id] >= 0.0], snapshot.T_world_cams)
        wanted = {plane.id: 0.0 if aligned(plane.normal, up) else _OBLIQUE for plane in planes}
        return tuple(plane for plane in planes if said.get(plane.id, 0.0) >= wanted[plane.id])

    def _taken_over(
        self, ids: IntArray, used: BoolArray, R: FloatArray, centres: Points3
    ) -> tuple[BoolArray, BoolArray]:
        """(K,) which of the used keyframes are new, and which have moved since they were new or last moved. ids,
        used, R (T_world_cam), centres: of all keyframes. A place (3, 3) of one are points ahead of it along its axes.
        """
        places, limit = centres[:, None] + _AHEAD_M * self.unit * R.transpose(0, 2, 1), _MOVED_M * self.unit
        _, now, before = np.intersect1d(ids, self._used, assume_unique=True, return_indices=True)
        anew, moved = used.copy(), np.zeros(len(ids), np.bool_)
        anew[now] = False
        moved[now] = used[now] & (np.linalg.norm(places[now] - self._places[before], axis=2) > limit).any(axis=1)
        places[now] = np.where(moved[now, None, None], places[now], self._places[before])
        self._used, self._places = ids[used], places[used]
        return anew, moved

    def _prepared(
        self, plane: Plane, snapshot: MapSnapshot, fresh: Views, moved: IntArray, centres: Points3, anew: IntArray,
        every: IntArray,
    ) -> Surface:  # fmt: skip
        """The plane's surface, with all cells due that the fresh keyframes, new or moved, show; all if the plane has
        moved. moved: ids. centres: of all keyframes. anew, every: rows of the rays from new and from all
        keyframes, ordered by keyframe."""
        surface, unit = self._surfaces.get(plane.id), self._finder.unit
        if surface is None or not surface.is_of(plane):
            surface, afresh = Surface(plane, self._config, unit, self._has_floor), True
        elif has_moved(surface.judged_at, plane, _MOVED_M * unit):
            surface.move(plane)
            afresh = True
        else:
            afresh = surface.extended(plane) or len(moved) > 0
            surface.mark_seen(plane, fresh, moved)
        rays, looks = snapshot.rays, every if afresh else anew
        surface.look_through(plane, centres, snapshot.points_world, rays.keyframe[looks], rays.point[looks], afresh)
        return surface

    def _work(self, planes: list[Plane], snapshot: MapSnapshot, views: Views, budget: int) -> None:
        """Judge the due cells. The planes of which the newest keyframe sees most points come first."""
        if not len(views.ids):
            return
        newest = np.zeros(len(snapshot.points_world), np.bool_)
        newest[snapshot.obs_point[snapshot.keyframe_ids[snapshot.obs_keyframe] == views.ids[-1]]] = True
        for plane in sorted(planes, key=lambda plane: -int(newest[plane.points].sum())):
            surface = self._surfaces[plane.id]
            if budget > 0 and surface.is_due:
                budget -= surface.work(plane, views, budget, self._images.loaded)
