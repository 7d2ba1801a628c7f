"""From the first frame that cannot be tracked until the camera is found: where it may be, whether odometry bridges the
gap, and when a map of its own shall begin."""

import numpy as np

from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.local_map import nearest_keyframes
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.motion_model import MotionModel
from vsx_ros.slam.relocalization import ExpectedPose, PoseTolerance, Relocalization, Relocalizer
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.two_view_reconstruction import InitialPair
from vsx_ros.vision.small_image import rotation_between

# While odometry tells where the camera must be, a place elsewhere only looks alike: the next brick of a wall is 0.2 m
# away. It is this far off per metre and radian since; after so many frames wheels may have slipped.
REACH_M, REACH_RAD, REACH_PER_M, REACH_PER_RAD, PATIENCE_FRAMES = 0.06, 0.05, 0.1, 0.1, 120
# So many frames that show something else (the difference is that share of the contrast) while the base stood: the
# camera was carried away.
CARRIED_FRAMES, CARRIED_CHANGE, STOOD_M, STOOD_RAD = 20, 0.5, 0.05, 0.1
SECOND_MAP_FRAMES = 30
ENOUGH_CORNERS = 150
BRIDGE_GAP_FRAMES, BRIDGE_DISTANCE_M, BRIDGE_ANGLE_RAD = 2, 0.04, 0.07


class Recovery:
    """One loss after the other: ``search`` and ``missed`` every lost frame, ``over`` when the camera is found."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, tracker: Tracker, motion: MotionModel
    ) -> None:
        self._T_base_cam, self._focal_px = T_base_cam, camera.fx
        self._config = config
        self._motion = motion
        self._relocalizer = Relocalizer(camera, config.tracker, tracker, motion)
        self.over(None)

    def over(self, data: FrameData | None) -> None:
        """The camera is tracked in this frame; None before the first."""
        self._last_tracked = data
        self._way_m = self._turn_rad = 0.0
        self.bad_frames = 0
        self._unexplained = 0
        self.carried = False
        self._initializer: Initializer | None = None
        self._relocalizer.forget()

    @property
    def is_lost(self) -> bool:
        """Whether enough frames failed to say so."""
        return self.bad_frames >= self._config.tracker.lost_after_frames

    def begin_lost(self) -> None:
        """The camera has not been seen in this map yet."""
        self.bad_frames = self._config.tracker.lost_after_frames

    def search(self, data: FrameData, view: MapView, by_odometry: SE3 | None, map_id: int) -> Relocalization | None:
        """The camera wherever it can be. by_odometry: T_world_cam in map ``map_id``, from odometry."""
        self._travel(by_odometry)
        return self._relocalizer.relocalize(data, view, self.expected_pose(by_odometry, map_id))

    def expected_pose(self, by_odometry: SE3 | None, map_id: int) -> ExpectedPose | None:
        """Where the camera should be in map ``map_id``, None before it was ever tracked."""
        patient = self.bad_frames < PATIENCE_FRAMES and not self.carried
        if by_odometry is not None and self._T_base_cam is not None and patient:
            error = REACH_PER_M * self._way_m + REACH_PER_RAD * self._turn_rad
            tolerance = PoseTolerance(REACH_M + error, REACH_RAD + error, self._T_base_cam.rotation[2])
            return ExpectedPose(by_odometry, map_id, tolerance)
        expected = by_odometry or self._motion.last_pose
        return None if expected is None else ExpectedPose(expected, map_id, None)

    def missed(self, data: FrameData) -> bool:
        """Count a frame in which the camera was not found; True when it has just become clear that it was carried."""
        self.bad_frames += 1
        if self.carried or not self._base_stood(data) or len(data.corners.positions) < ENOUGH_CORNERS:
            return False
        if self._looks_the_same(data):
            return False
        self._unexplained += 1
        self.carried = self._unexplained >= CARRIED_FRAMES
        return self.carried

    def second_map(self, data: FrameData, has_odometry: bool) -> InitialPair | None:
        """Two frames for a map of its own, when odometry does not bridge the gap and the camera allows one."""
        if self.bad_frames < SECOND_MAP_FRAMES or (has_odometry and not self.carried):
            return None
        if self._initializer is None:
            self._initializer = Initializer(self._T_base_cam, self._config.initialization)
        outcome = self._initializer.add(data)
        return None if isinstance(outcome, str) else outcome

    def bridges(self, data: FrameData, view: MapView, by_odometry: SE3, since_keyframe: int) -> bool:
        """Whether odometry shall place a keyframe: the camera is lost, the image shows something and the base moves, so
        that what is in view becomes a map again."""
        if not self.is_lost or data.blurred:
            return False
        if self.carried or len(data.corners.positions) < ENOUGH_CORNERS or since_keyframe < BRIDGE_GAP_FRAMES:
            return False
        if self._base_stood(data):
            return False
        nearest = view.keyframes[int(nearest_keyframes(view, by_odometry)[0])].T_world_cam
        moved = float(np.linalg.norm(nearest.translation - by_odometry.translation))
        return moved >= BRIDGE_DISTANCE_M or nearest.rotation_angle_to(by_odometry) >= BRIDGE_ANGLE_RAD

    def _travel(self, by_odometry: SE3 | None) -> None:
        before = self._motion.last_pose
        if before is not None and by_odometry is not None:
            self._way_m += float(np.linalg.norm(by_odometry.translation - before.translation))
            self._turn_rad += before.rotation_angle_to(by_odometry)

    def _looks_the_same(self, data: FrameData) -> bool:
        """Whether the image is the last one that was tracked, or that one turned a little."""
        assert self._last_tracked is not None
        before = self._last_tracked.small
        _, difference = rotation_between(before, data.small, self._focal_px)
        return difference < CARRIED_CHANGE * float(np.mean(np.square(before)))

    def _base_stood(self, data: FrameData) -> bool:
        moved = None if self._last_tracked is None else self._motion.by_odometry(self._last_tracked, data)
        if moved is None:
            return False
        turned = moved.rotation_angle_to(SE3.identity())
        return float(np.linalg.norm(moved.translation)) < STOOD_M and turned < STOOD_RAD
