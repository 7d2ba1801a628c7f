"""Where in the newest image the points of the map were looked for: what a viewer draws over the camera's picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import Pixels
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.slam.map import MapView
from vsx_ros.slam.tracker import Track


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
