"""One frame after the other in the map around the camera, where odometry and image check each other."""

import numpy as np

from vsx_ros.config import TrackerConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.local_map import LocalMap
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.motion_model import MotionModel, Prediction
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.tracker import Track, Tracker

MAX_STEP_M, MAX_STEP_RAD = 0.08, 0.06
# A frame with so many points, and that share of the expected ones, knows better than odometry.
SURE_POINTS, SURE_RATIO = 100, 0.2


class FrameTracker:
    """``track`` searches around the predicted pose. coarse_next: whether in a wide circle first although odometry
    predicts it. last: the newest frame's track and the map it is in, None where no point was looked for."""

    def __init__(self, config: TrackerConfig, tracker: Tracker, motion: MotionModel, local: LocalMap) -> None:
        self._coarse_radius_px = config.coarse_radius_px
        self._tracker, self._motion, self._local = tracker, motion, local
        self.coarse_next = True
        self.last: tuple[MapView, Track] | None = None

    def track(self, data: FrameData, view: MapView, prediction: Prediction, tracked_before: bool) -> Track:
        """The frame in the local map of the view. tracked_before: whether the frame before was; only then odometry
        tells where the camera can not be."""
        coarse = self.coarse_next or not prediction.by_odometry
        track = self._search(data, view, prediction, coarse)
        self.last = view, track
        if not (prediction.by_odometry and tracked_before):
            return track
        if track.state is not TrackingState.LOST:
            track = _checked(track, prediction.T_world_cam)
        return self._by_image_alone(data, view, track) if track.state is TrackingState.LOST else track

    def _by_image_alone(self, data: FrameData, view: MapView, track: Track) -> Track:
        """Where the camera went on as before, the frame as tracked without odometry, which is wrong then; else the
        track as it was."""
        seen = self._search(data, view, self._motion.predict(data._replace(T_odom_base=None)), coarse=True)
        if seen.state is TrackingState.LOST or not is_sure(seen):
            return track
        self.last = view, seen
        return seen

    def _search(self, data: FrameData, view: MapView, prediction: Prediction, coarse: bool) -> Track:
        radius_px = self._coarse_radius_px if coarse else 0.0
        expected = prediction.T_world_cam
        return self._tracker.track(data, view, expected, self._local.rows, radius_px, prediction.information)


def is_sure(track: Track) -> bool:
    """Whether the image knows better than odometry where the camera is."""
    return len(track.rows) >= SURE_POINTS and track.ratio > SURE_RATIO


def _checked(track: Track, by_odometry: SE3) -> Track:
    """A pose far from where odometry moved the last one is a mistake, not a measurement."""
    step = float(np.linalg.norm(track.T_world_cam.translation - by_odometry.translation))
    turn = track.T_world_cam.rotation_angle_to(by_odometry)
    if step < MAX_STEP_M and turn < MAX_STEP_RAD:
        return track
    reason = f"contradicts odometry by {step:.2f} m and {np.degrees(turn):.1f} deg"
    return track._replace(state=TrackingState.LOST, reason=reason)
