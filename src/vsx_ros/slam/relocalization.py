"""Finding the camera again: where the wheels say, then every keyframe that looks alike, each verified by patch
search."""

from __future__ import annotations

import numpy as np

from vsx_ros.config import TrackerConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.map import MapView
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.tracker import LocalMap, Track, Tracker, nearest_keyframes
from vsx_ros.vision.small_image import rotation_between

LIKELY = 12
TRIED = 5
WIDE = 2.0


class Relocalizer:
    """``relocalize`` returns the first hypothesis that patch search confirms."""

    def __init__(self, camera: PinholeCamera, config: TrackerConfig, tracker: Tracker) -> None:
        self._config = config
        self._focal_px = camera.fx
        self._tracker = tracker

    def relocalize(
        self, data: FrameData, view: MapView, expected: SE3 | None, reach: tuple[float, float]
    ) -> tuple[Track, int] | None:
        """(track, reference keyframe index), or None. expected: T_world_cam by the wheels or the last pose; reach: how
        far from it the camera can be (metres, radians): places that only look alike are turned down."""
        best: tuple[Track, int] | None = None
        hypotheses: list[tuple[SE3, int]] = []
        if expected is not None:
            hypotheses.append((expected, int(nearest_keyframes(view, expected)[0])))
        hypotheses += self._look_alikes(data, view)
        for pose, reference in hypotheses:
            local = LocalMap()
            local.select(view, reference)
            radius = WIDE * self._config.coarse_radius_px
            track = self._tracker.track(data, view, pose, local.rows, radius)
            if expected is not None and not _within(expected, track.T_world_cam, reach):
                continue
            if track.state is TrackingState.GOOD and (best is None or len(track.rows) > len(best[0].rows)):
                best = track, local.follow(view, track.rows)
                if track.ratio > 0.5:
                    return best
        return best

    def _look_alikes(self, data: FrameData, view: MapView) -> list[tuple[SE3, int]]:
        """Keyframes whose small image resembles this one, turned so that the images agree."""
        living = [view.keyframes[int(k)] for k in view.living]
        difference = [float(((k.data.small - data.small) ** 2).mean()) for k in living]
        aligned = []
        for position in np.argsort(difference, kind="stable")[:LIKELY]:
            keyframe = living[int(position)]
            rotation, score = rotation_between(keyframe.data.small, data.small, self._focal_px)
            if np.isfinite(score):
                turned = keyframe.T_world_cam @ SE3(rotation.T, np.zeros(3))
                aligned.append((score, keyframe.id, turned))
        aligned.sort(key=lambda entry: entry[:2])
        return [(pose, k) for _, k, pose in aligned[:TRIED]]


def _within(expected: SE3, found: SE3, reach: tuple[float, float]) -> bool:
    distance = float(np.linalg.norm(found.translation - expected.translation))
    return distance <= reach[0] and expected.rotation_angle_to(found) <= reach[1]
