"""What everybody outside the SLAM sees of it: keyframes, points, who saw what, what was looked for."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import GrayImage, IntArray, Pixels, Points3
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import Observations
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.tracker import Track


@dataclass(frozen=True, slots=True, eq=False)
class MapSnapshot:
    """Living keyframes and points. obs_keyframe and obs_point index the keyframes and points of this snapshot; obs_uv
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


def snapshot(view: MapView) -> MapSnapshot:
    """The public form of a view: the living keyframes of the first map, and points that live and are seen at least
    twice by them, renumbered."""
    view = view.part(0)
    keyframes = [view.keyframes[int(k)] for k in view.living]
    every = Observations.concatenated([k.observations for k in keyframes])
    observer = np.repeat(np.arange(len(keyframes)), [len(k.observations.rows) for k in keyframes])
    rows = np.flatnonzero(view.alive & (np.bincount(every.rows, minlength=len(view.points)) >= 2))
    number = np.full(len(view.points), -1, np.int64)
    number[rows] = np.arange(len(rows))
    kept = number[every.rows] >= 0
    observed = every.where(kept)
    return MapSnapshot(
        view.version,
        np.array([k.id for k in keyframes], np.int64),
        np.array([k.data.stamp_ns for k in keyframes], np.int64),
        tuple(k.T_world_cam for k in keyframes),
        tuple(k.data.pyramid.level(0) for k in keyframes),
        rows,
        view.points[rows],
        observer[kept],
        number[observed.rows],
        observed.uv,
        observed.level,
    )


class TrackedFeatures(NamedTuple):
    """found (F, 2): px where map points were found. missed (M, 2): px where others were expected and not found."""

    found: Pixels
    missed: Pixels


def tracked_features(camera: PinholeCamera, view: MapView, track: Track) -> TrackedFeatures:
    """The points of one track, those that were not found at the place its pose gives them.

    All are missed where the pose was refused. What the pose puts behind the camera is left out.
    """
    missed = np.setdiff1d(track.searched_rows, track.rows)
    uv = camera.project(track.T_world_cam.inverse() @ view.points[missed])
    return TrackedFeatures(track.uv, uv[np.isfinite(uv).all(axis=1)])
