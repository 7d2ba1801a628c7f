"""The map for others: a snapshot to read (keyframes, points, observations), and a map to save and continue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import GrayImage, Int32Array, IntArray, Pixels, Points3, array_bytes
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData, MapView, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.track import Track

_SAME = 1e-6  # tolerance of calibrations: rounding of numbers in files


class StoredImages(Sequence[GrayImage]):
    """Images of keyframes at level 0, decompressed when they are asked for."""

    def __init__(self, frames: Sequence[FrameData]) -> None:
        self._frames = tuple(frames)

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> GrayImage: ...
    @overload
    def __getitem__(self, index: slice) -> StoredImages: ...
    def __getitem__(self, index: int | slice) -> GrayImage | StoredImages:
        if isinstance(index, slice):
            return StoredImages(self._frames[index])
        return self._frames[index].pyramid.level(0)


class Rays(NamedTuple):
    """Which points were seen from where, also by culled keyframes: ids (K,) of the keyframes, ascending, and their
    poses; keyframe, point, level (O,): index of the keyframe, row of the point and pyramid level of each ray."""

    ids: IntArray
    T_world_cams: tuple[SE3, ...]
    keyframe: Int32Array
    point: Int32Array
    level: NDArray[np.int8]


@dataclass(frozen=True, slots=True, eq=False)
class MapSnapshot:
    """Living keyframes, and the points that all keyframes saw at least twice. obs_keyframe and obs_point index the
    keyframes and points of this snapshot; obs_uv level-0 px as in the image (distorted), images are level 0. all_rays:
    None if no keyframe is culled."""

    version: int
    keyframe_ids: IntArray
    keyframe_stamps_ns: IntArray
    T_world_cams: tuple[SE3, ...]
    images: Sequence[GrayImage]
    point_ids: IntArray
    points_world: Points3
    obs_keyframe: Int32Array
    obs_point: Int32Array
    obs_uv: Pixels
    obs_level: NDArray[np.int8]
    all_rays: Rays | None = None

    @property
    def rays(self) -> Rays:
        """Those of all keyframes."""
        own = Rays(
            ids=self.keyframe_ids, T_world_cams=self.T_world_cams,
            keyframe=self.obs_keyframe, point=self.obs_point, level=self.obs_level,
        )  # fmt: skip
        return self.all_rays or own

    @property
    def nbytes(self) -> int:
        """Size of the arrays [bytes]. The images are the map's own."""
        own = (self.keyframe_ids, self.keyframe_stamps_ns, self.point_ids, self.points_world)
        seen = (self.obs_keyframe, self.obs_point, self.obs_uv, self.obs_level)
        return array_bytes((*own, *seen, *(self.all_rays or ())))


def snapshot(view: MapView) -> MapSnapshot:
    """A view's first map, with its points renumbered."""
    every = [k for k in view.keyframes if k.map_id == 0]
    seen = Observations.concatenated([k.observations for k in every])
    observer = np.repeat(np.arange(len(every), dtype=np.int32), [len(k.observations.rows) for k in every])
    rows = np.flatnonzero(view.alive & (np.bincount(seen.rows, minlength=len(view.points)) >= 2))
    number = np.full(len(view.points), -1, np.int32)
    number[rows] = np.arange(len(rows))
    kept = number[seen.rows] >= 0
    rays = Rays(
        ids=np.array([k.id for k in every], np.int64),
        T_world_cams=tuple(k.T_world_cam for k in every),
        keyframe=observer[kept],
        point=number[seen.rows[kept]],
        level=seen.level[kept].astype(np.int8),
    )
    keyframes, living = [k for k in every if k.alive], np.array([k.alive for k in every], np.bool_)
    own = living[rays.keyframe]
    return MapSnapshot(
        version=view.version,
        keyframe_ids=np.array([k.id for k in keyframes], np.int64),
        keyframe_stamps_ns=np.array([k.data.stamp_ns for k in keyframes], np.int64),
        T_world_cams=tuple(k.T_world_cam for k in keyframes),
        images=StoredImages([k.data for k in keyframes]),
        point_ids=rows,
        points_world=view.points[rows],
        obs_keyframe=(np.cumsum(living, dtype=np.int32) - 1)[rays.keyframe[own]],
        obs_point=rays.point[own],
        obs_uv=seen.uv[kept[living[observer]]],
        obs_level=rays.level[own],
        all_rays=None if living.all() else rays,
    )


class TrackedFeatures(NamedTuple):
    """found (F, 2): px where map points were found. missed (M, 2): px where others were expected and not found."""

    found: Pixels
    missed: Pixels


def tracked_features(camera: PinholeCamera, view: MapView, track: Track) -> TrackedFeatures:
    """The points of one track; those not found are placed by its pose.

    Points behind the camera are left out."""
    missed = np.setdiff1d(track.searched_rows, track.rows)
    uv = camera.project(track.T_world_cam.inverse() @ view.points[missed])
    return TrackedFeatures(track.uv, uv[np.isfinite(uv).all(axis=1)])


@dataclass(frozen=True, slots=True, eq=False)
class SlamMap:
    """All data to continue a map. T_base_cam: the camera's mount; None for a map made without odometry, which has no
    metric scale. view has at least one keyframe."""

    camera: PinholeCamera
    T_base_cam: SE3 | None
    view: MapView

    def resumed(self, camera: PinholeCamera, T_base_cam: SE3 | None) -> Map:
        """The map to continue. T_base_cam: None for a session without odometry, which any map accepts.

        Raises CalibrationError when the session's calibration or mount differs from the map's."""
        same = camera.model == self.camera.model
        if not same or not np.allclose(_numbers(camera), _numbers(self.camera), rtol=_SAME, atol=_SAME):
            raise CalibrationError(
                f"the map was made with the calibration {_camera_text(self.camera)}, this camera has "
                f"{_camera_text(camera)}; use the map's calibration or start a new map"
            )
        if T_base_cam is not None and self.T_base_cam is None:
            raise CalibrationError(
                "the map was made without odometry and has no metric scale, this session has odometry; "
                "start a new map with it"
            )
        made, here = self.T_base_cam, T_base_cam
        if made is not None and here is not None and not np.allclose(made.matrix(), here.matrix(), atol=_SAME):
            raise CalibrationError(
                f"the map was made with the camera mounted at {_mount_text(made)}, this robot has it at "
                f"{_mount_text(here)}; use the map's mount (robot.mount) or start a new map"
            )
        return Map.resumed(self.view)


def _numbers(camera: PinholeCamera) -> list[float]:
    return [camera.width, camera.height, *camera.parameters()]


def _camera_text(camera: PinholeCamera) -> str:
    lens = ", ".join(f"{k:.6g}" for k in camera.distortion)
    focal = f"fx {camera.fx:.7g}, fy {camera.fy:.7g}, cx {camera.cx:.7g}, cy {camera.cy:.7g}"
    return f"{camera.width}x{camera.height}, {focal}, {camera.model} [{lens}]"


def _mount_text(T_base_cam: SE3) -> str:
    x, y, z = T_base_cam.translation
    a, b, c = np.degrees(T_base_cam.log()[3:])
    return f"x {x:.4f} y {y:.4f} z {z:.4f} m, rotation vector ({a:.3f}, {b:.3f}, {c:.3f}) deg"
