"""Recovery, from the first untracked frame until the camera is found. Decides where the camera can be, whether odometry
bridges the gap and when a new map begins."""

import numpy as np

from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.keyframe import FrameData, MapView
from vsx_ros.slam.local_map import nearest_keyframes
from vsx_ros.slam.odometry import MotionModel, motion_by_odometry
from vsx_ros.slam.relocalizer import ExpectedPose, Relocalization, Relocalizer
from vsx_ros.slam.start_watch import GiveUp
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.two_view_reconstruction import InitialPair
from vsx_ros.vision.pyramid import rotation_between

# The error of odometry grows by these shares per metre and radian; after PATIENCE_FRAMES the wheels may have slipped.
REACH_PER_M, REACH_PER_RAD, PATIENCE_FRAMES = 0.1, 0.1, 120
# The camera was carried away if so many frames show another scene (difference above this share of the contrast) while
# the base stood still, within these limits.
CARRIED_FRAMES, CARRIED_CHANGE, STOOD_M, STOOD_RAD = 20, 0.5, 0.05, 0.1
SECOND_MAP_S = 1.0  # lost for so long without odometry, a separate map begins
GIVE_UP_S = 0.5  # lost for so long, a young map without odometry is worth less than another start
ENOUGH_CORNERS = 150
BRIDGE_GAP_FRAMES, BRIDGE_DISTANCE_M, BRIDGE_ANGLE_RAD = 2, 0.04, 0.07


class Recovery:
    """``search`` and ``missed`` for every lost frame, ``over`` when the camera is tracked again."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, tracker: Tracker, motion: MotionModel
    ) -> None:
        self._T_base_cam, self._focal_px = T_base_cam, camera.focal_px
        self._config, self._motion = config, motion
        self._relocalizer = Relocalizer(camera, T_base_cam, config, tracker)
        self.places = self._relocalizer.places
        self.over(None)

    def over(self, data: FrameData | None) -> None:
        """The camera is tracked in this frame; None before the first."""
        self._last_tracked = data
        self._way_m = self._turn_rad = 0.0
        self.bad_frames = self._lost_ns = 0
        self._unexplained = 0
        self.carried = False
        self._initializer: Initializer | None = None
        self._relocalizer.forget()

    @property
    def is_lost(self) -> bool:
        """Whether enough frames failed to call the camera lost."""
        return self.bad_frames >= self._config.tracker.lost_after_frames

    def begin_lost(self) -> None:
        """Start as lost: the camera was not seen in this map yet."""
        self.bad_frames = self._config.tracker.lost_after_frames

    def search(self, data: FrameData, view: MapView, by_odometry: SE3 | None, map_id: int) -> Relocalization | None:
        """Search for the camera everywhere. by_odometry: T_world_cam in map ``map_id``, from odometry."""
        self._travel(by_odometry)
        if data.frozen:  # it would be found where it was
            return None
        return self._relocalizer.relocalize(data, view, self.expected_pose(by_odometry, map_id))

    def expected_pose(self, by_odometry: SE3 | None, map_id: int) -> ExpectedPose | None:
        """Where the camera should be in map ``map_id``, None before it was ever tracked."""
        patient = self.bad_frames < PATIENCE_FRAMES and not self.carried
        if by_odometry is not None and self._T_base_cam is not None and patient:
            slip = REACH_PER_M * self._way_m + REACH_PER_RAD * self._turn_rad
            return ExpectedPose(by_odometry, map_id, slip, self._T_base_cam.rotation[2])
        expected = by_odometry or self._motion.last_pose
        return None if expected is None else ExpectedPose(expected, map_id)

    def missed(self, data: FrameData) -> bool:
        """Count a frame in which the camera was not found; True when it just became clear that it was carried away."""
        self._lost_ns = self._lost_ns or data.stamp_ns
        self.bad_frames += 1
        shows_something = len(data.corners.positions) >= ENOUGH_CORNERS
        if self.carried or not self._base_stood(data) or not shows_something or self._looks_the_same(data):
            return False
        self._unexplained += 1
        self.carried = self._unexplained >= CARRIED_FRAMES
        return self.carried

    def second_map(self, data: FrameData, has_odometry: bool) -> InitialPair | None:
        """Two frames for a separate map if odometry does not bridge the gap; None while there are none."""
        waits = (data.stamp_ns - self._lost_ns) * 1e-9 < SECOND_MAP_S
        if data.frozen or waits or (has_odometry and not self.carried):
            return None
        if self._initializer is None:
            self._initializer = Initializer(self._T_base_cam, self._config.initialization)
        outcome = self._initializer.add(data)
        return None if isinstance(outcome, str) else outcome

    def gives_up(self, data: FrameData, view: MapView) -> GiveUp | None:
        """Whether to begin again: a map of few keyframes, without odometry, lost the camera and cannot find it."""
        few, last = len(view.keyframes) <= self._config.initialization.watched_keyframes, self._last_tracked
        if not (few and self.is_lost) or last is None or self._T_base_cam is not None:
            return None
        waited_s = (data.stamp_ns - last.stamp_ns) * 1e-9
        told = f"lost with {len(view.keyframes)} keyframes and not found again within {waited_s:.1f} s"
        return GiveUp(data.stamp_ns, told) if waited_s >= GIVE_UP_S else None

    def bridges(self, data: FrameData, view: MapView, by_odometry: SE3, since_keyframe: int) -> bool:
        """Whether to place a keyframe by odometry, so that mapping continues: the camera is lost, the image shows
        enough corners and the base moves."""
        useful = not data.blurred and len(data.corners.positions) >= ENOUGH_CORNERS
        if not self.is_lost or self.carried or not useful:
            return False
        if since_keyframe < BRIDGE_GAP_FRAMES or self._base_stood(data):
            return False
        nearest = view.keyframes[int(nearest_keyframes(view, by_odometry)[0])].T_world_cam
        return not nearest.is_near(by_odometry, BRIDGE_DISTANCE_M, BRIDGE_ANGLE_RAD)

    def _travel(self, by_odometry: SE3 | None) -> None:
        before = self._motion.last_pose
        if before is not None and by_odometry is not None:
            self._way_m += float(np.linalg.norm(by_odometry.translation - before.translation))
            self._turn_rad += before.rotation_angle_to(by_odometry)

    def _looks_the_same(self, data: FrameData) -> bool:
        """Whether the image shows the same as the last tracked one, up to a small rotation."""
        assert self._last_tracked is not None
        before = self._last_tracked.small
        _, difference = rotation_between(before, data.small, self._focal_px)
        contrast = min(float(np.mean(np.square(small))) for small in (before, data.small))
        return difference < CARRIED_CHANGE * contrast

    def _base_stood(self, data: FrameData) -> bool:
        before = self._last_tracked
        moved = None if before is None else motion_by_odometry(self._T_base_cam, before, data)
        return moved is not None and moved.is_near(SE3.identity(), STOOD_M, STOOD_RAD)
