"""Tracks one frame after the other in the local map. Odometry and image check each other."""

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import SlamConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.covered import CoverWatch
from vsx_ros.slam.keyframe import HANGS, FrameData, MapView
from vsx_ros.slam.local_map import LocalMap
from vsx_ros.slam.odometry import MotionModel, Prediction
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track, nothing_tracked
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.uncertainty import PoseUncertainty

MAX_STEP_M, MAX_STEP_RAD = 0.08, 0.06
"""Largest difference of a pose from odometry, or where that is in doubt from the motion before; more is an error."""
# A frame that finds so many points, and this share of the expected ones, is more reliable than odometry.
SURE_POINTS, SURE_RATIO = 100, 0.2
ALONE_POINTS = 50  # least points of a good pose found without odometry
# Residuals that noise and lens do not explain: odometry may have pulled the pose away.
PULLED_PX = 1.5


class FrameTracker:
    """``track`` searches around the predicted pose. coarse_next: whether the next search begins in a wide circle even
    with odometry. last: the newest frame's track and its map; None when no point was searched."""

    def __init__(self, config: SlamConfig, tracker: Tracker, motion: MotionModel) -> None:
        self._config, self._tracker, self._motion = config, tracker, motion
        self.begin()

    def begin(self) -> None:
        """Start in a new map."""
        self.coarse_next = True
        self.last: tuple[MapView, Track] | None = None
        self._local: LocalMap | None = None
        self._uncertainty = PoseUncertainty(self._config.uncertainty)
        self._cover = CoverWatch()

    def around(self, view: MapView, reference: int) -> LocalMap:
        """The local map; rebuilt when the map or the reference keyframe changed."""
        known = self._local
        if known is None or (known.view.version, known.reference) != (view.version, reference):
            self._local = known = LocalMap(view, reference)
            self._uncertainty.enter(known)
        return known

    def covariance(self, track: Track, local: LocalMap) -> FloatArray:
        """(6, 6) covariance of a pose found in the local map, see ``PoseUncertainty``."""
        return self._uncertainty.tracked(track, local)

    def covariance_by_odometry(self) -> FloatArray:
        """(6, 6) covariance of the newest frame, if odometry gave its pose because it was not found."""
        return self._uncertainty.covariance

    def track(self, data: FrameData, local: LocalMap, prediction: Prediction, tracked_before: bool) -> Track:
        """tracked_before: whether the previous frame was tracked. Only then can odometry reject a pose. Nothing is
        searched in a frozen image: it would be found where the camera was."""
        before = self._motion.last_pose
        if data.frozen:
            track = nothing_tracked(HANGS, prediction.T_world_cam)
        else:
            track = self._checked_track(data, local, prediction, tracked_before)
        if track.state is TrackingState.LOST and prediction.by_odometry and before is not None:
            self._uncertainty.moved(before.inverse() @ prediction.T_world_cam, prediction.information)
        return track._replace(ahead=self._cover.ahead(data.stamp_ns, track, local.view.points))

    def _checked_track(self, data: FrameData, local: LocalMap, prediction: Prediction, tracked_before: bool) -> Track:
        coarse = self.coarse_next
        track = self._search(data, local, prediction, coarse)
        if not (coarse or prediction.by_odometry or track.state is TrackingState.GOOD or data.blurred):
            track = self._search(data, local, prediction, coarse=True)
        if not (prediction.by_odometry or track.state is TrackingState.GOOD or data.blurred):
            track = self._steadier(data, local, track)
        if not (prediction.by_odometry and tracked_before):
            return track
        if track.state is not TrackingState.LOST:
            track = _checked(track, prediction.T_world_cam, "odometry")
        lost = track.state is TrackingState.LOST
        if not lost and track.sigma_px < PULLED_PX:
            return track
        # Odometry may be wrong: track again from a prediction without it. A camera does not leap: far from it is wrong.
        last, by_image = self.last, self._motion.predict(data._replace(T_odom_base=None))
        seen = _checked(self._search(data, local, by_image, coarse=True), by_image.T_world_cam, "the motion before")
        better = lost or np.count_nonzero(seen.settled) > np.count_nonzero(track.settled)
        if seen.state is TrackingState.GOOD and len(seen.rows) >= ALONE_POINTS and better:
            return seen
        self.last = last
        return track

    def _steadier(self, data: FrameData, local: LocalMap, track: Track) -> Track:
        """The track, or that from constant velocity if it is not lost and explains more."""
        last, steady = self.last, self._motion.steady(data)
        if steady is not None:
            other = self._search(data, local, steady, coarse=True)
            more = np.count_nonzero(other.settled) > np.count_nonzero(track.settled)
            if other.state is not TrackingState.LOST and more:
                return other
        self.last = last
        return track

    def _search(self, data: FrameData, local: LocalMap, prediction: Prediction, coarse: bool) -> Track:
        radius_px = self._config.tracker.coarse_radius_px if coarse else 0.0
        expected, information = prediction.T_world_cam, prediction.information
        track = self._tracker.track(data, local.view, expected, local.rows, radius_px, information)
        self.last = local.view, track
        return track


def is_sure(track: Track) -> bool:
    """Whether the image is more reliable than odometry for this pose."""
    return len(track.rows) >= SURE_POINTS and track.ratio > SURE_RATIO


def _checked(track: Track, expected: SE3, by: str) -> Track:
    """Mark the track as LOST when its pose is far from the expected one. by: what expects it there."""
    step = float(np.linalg.norm(track.T_world_cam.translation - expected.translation))
    turn = track.T_world_cam.rotation_angle_to(expected)
    if step < MAX_STEP_M and turn < MAX_STEP_RAD:
        return track
    reason = f"contradicts {by} by {step:.2f} m and {np.degrees(turn):.1f} deg"
    return track._replace(state=TrackingState.LOST, reason=reason)
