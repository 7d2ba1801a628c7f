"""Recovery, from the first untracked frame until the camera is found: at the expected place, then at every similar
place, each verified by patch search. Decides whether odometry bridges the gap and when a new map begins."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.initialization import Initializer
from vsx_ros.slam.keyframe import FrameData, MapView, unit_of
from vsx_ros.slam.local_map import LocalMap, nearest_keyframes
from vsx_ros.slam.odometry import MotionModel, motion_by_odometry
from vsx_ros.slam.place_recognition import PlaceRecognizer, Recognition, occupied_cells
from vsx_ros.slam.start_watch import GiveUp
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.two_view_reconstruction import InitialPair
from vsx_ros.vision.corners import features_of
from vsx_ros.vision.pyramid import rotation_between

BEST_LIKELY, IN_TURN = 3, 2  # keyframes tried per lost frame, limited by time
WIDE = 2.0  # factor on coarse_radius_px: odometry drifted while the camera was lost
AGREE_M, AGREE_RAD, AGREE_S = 0.15, 0.15, 0.5  # limits for two frames that confirm one place, after odometry
# Largest motion off the floor: more than from a rug or a loose camera mast.
OFF_FLOOR_M, OFF_FLOOR_RAD = 0.03, 0.05
# While odometry predicts the pose, another place is only similar: the next brick of a wall is 0.2 m away. The error of
# odometry grows by these shares per metre and radian; after PATIENCE_FRAMES the wheels may have slipped.
REACH_M, REACH_RAD, REACH_PER_M, REACH_PER_RAD, PATIENCE_FRAMES = 0.06, 0.05, 0.1, 0.1, 120
# The camera was carried away if so many frames show another scene (difference above this share of the contrast) while
# the base stood still, within these limits.
CARRIED_FRAMES, CARRIED_CHANGE, STOOD_M, STOOD_RAD = 20, 0.5, 0.05, 0.1
SECOND_MAP_FRAMES = 30
GIVE_UP_S = 0.5  # lost for so long, a young map without odometry is worth less than another start
ENOUGH_CORNERS = 150
BRIDGE_GAP_FRAMES, BRIDGE_DISTANCE_M, BRIDGE_ANGLE_RAD = 2, 0.04, 0.07


class ExpectedPose(NamedTuple):
    """Expected T_world_cam in map ``map_id``. slip: extra distance and angle [m, rad] allowed because wheels may
    have slipped along the floor (never off it); infinite without odometry. up_cam (3,): the floor's normal in that
    camera."""

    T_world_cam: SE3
    map_id: int
    slip: float = math.inf
    up_cam: FloatArray = np.zeros(3)

    @property
    def is_firm(self) -> bool:
        """Whether odometry rules out other places."""
        return self.slip < math.inf

    def allows(self, T_world_cam: SE3, map_id: int) -> bool:
        """Whether the camera can have this pose."""
        if not self.is_firm:
            return True
        error = (self.T_world_cam.inverse() @ T_world_cam).log()
        shift, turn = error[:3], error[3:]
        near = np.linalg.norm(shift) <= REACH_M + self.slip and np.linalg.norm(turn) <= REACH_RAD + self.slip
        tilt = np.linalg.norm(np.cross(turn, self.up_cam))
        upright = abs(shift @ self.up_cam) <= OFF_FLOOR_M and tilt <= OFF_FLOOR_RAD
        return bool(map_id == self.map_id and near and upright)


class Relocalization(NamedTuple):
    """The camera was found in map ``map_id``. reference: keyframe index."""

    track: Track
    reference: int
    map_id: int


class Relocalizer:
    """Call ``relocalize`` for each lost frame: it tries the most likely keyframes every time, the others in turn. Call
    ``forget`` when the camera is tracked again."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, tracker: Tracker) -> None:
        self._camera, self._T_base_cam, self._tracker = camera, T_base_cam, tracker
        self._radius_px, self._config = WIDE * config.tracker.coarse_radius_px, config.recognition
        self._places = PlaceRecognizer(camera, tracker)
        self.forget()

    def forget(self) -> None:
        """Reset for the next loss."""
        self._turn = 0
        self._unconfirmed: tuple[FrameData, Relocalization] | None = None

    def relocalize(self, data: FrameData, view: MapView, expected: ExpectedPose | None) -> Relocalization | None:
        """Find the camera in any of the maps; None when that fails."""
        found = None if expected is None else self._where_expected(data, view, expected)
        if found is not None:
            return found
        features = features_of(data.pyramid, data.corners)
        firm = expected is not None and expected.is_firm
        for k in self._likely(data, view, expected):
            seen = self._places.recognise(data, features, view, k)
            if seen is None or not seen.is_sure(self._config):
                continue
            found = self._found(seen.track, view, seen.keyframe)
            if expected is not None and not expected.allows(found.track.T_world_cam, found.map_id):
                continue
            if firm or seen.is_certain(self._config) or self._confirms(data, view, found):
                return found
            self._unconfirmed = data, found
        return None

    def _where_expected(self, data: FrameData, view: MapView, expected: ExpectedPose) -> Relocalization | None:
        here = view.part(expected.map_id)
        reference = int(nearest_keyframes(here, expected.T_world_cam)[0])
        local, radius = LocalMap(here, reference), self._radius_px
        track = self._tracker.track(data, here, expected.T_world_cam, local.rows, radius)
        if track.state is not TrackingState.GOOD or not expected.allows(track.T_world_cam, expected.map_id):
            return None
        seen = Recognition(reference, track, 0, occupied_cells(track.uv, self._camera))
        return self._found(track, view, reference) if expected.is_firm or seen.is_sure(self._config) else None

    def _likely(self, data: FrameData, view: MapView, expected: ExpectedPose | None) -> list[int]:
        """The keyframe of an unconfirmed recognition, the most similar ones, and some of the rest in turn."""
        among = view.living if expected is None or not expected.is_firm else view.part(expected.map_id).living
        ranked = [int(k) for k in self._places.ranked(data.small, view, among)]
        again = [k for k in ranked if self._unconfirmed is not None and k == self._unconfirmed[1].reference]
        best, rest = ranked[:BEST_LIKELY], ranked[BEST_LIKELY:]
        in_turn = [rest[(self._turn + n) % len(rest)] for n in range(min(IN_TURN, len(rest)))]
        self._turn += IN_TURN
        return list(dict.fromkeys(again + best + in_turn))

    def _found(self, track: Track, view: MapView, keyframe: int) -> Relocalization:
        map_id = view.keyframes[keyframe].map_id
        return Relocalization(track, LocalMap(view.part(map_id), keyframe).follow(track.rows), map_id)

    def _confirms(self, data: FrameData, view: MapView, found: Relocalization) -> bool:
        """Whether a frame shortly before was recognised at a consistent pose."""
        if self._unconfirmed is None:
            return False
        before, earlier = self._unconfirmed
        if earlier.map_id != found.map_id or (data.stamp_ns - before.stamp_ns) * 1e-9 > AGREE_S:
            return False
        moved = motion_by_odometry(self._T_base_cam, before, data) or SE3.identity()
        reach = AGREE_M * unit_of(view.keyframes, found.reference).metre
        return (earlier.track.T_world_cam @ moved).is_near(found.track.T_world_cam, reach, AGREE_RAD)


class Recovery:
    """``search`` and ``missed`` for every lost frame, ``over`` when the camera is tracked again."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, tracker: Tracker, motion: MotionModel
    ) -> None:
        self._T_base_cam, self._focal_px = T_base_cam, camera.fx
        self._config, self._motion = config, motion
        self._relocalizer = Relocalizer(camera, T_base_cam, config, tracker)
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
        """Whether enough frames failed to call the camera lost."""
        return self.bad_frames >= self._config.tracker.lost_after_frames

    def begin_lost(self) -> None:
        """Start as lost: the camera was not seen in this map yet."""
        self.bad_frames = self._config.tracker.lost_after_frames

    def search(self, data: FrameData, view: MapView, by_odometry: SE3 | None, map_id: int) -> Relocalization | None:
        """Search for the camera everywhere. by_odometry: T_world_cam in map ``map_id``, from odometry."""
        self._travel(by_odometry)
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
        self.bad_frames += 1
        shows_something = len(data.corners.positions) >= ENOUGH_CORNERS
        if self.carried or not self._base_stood(data) or not shows_something or self._looks_the_same(data):
            return False
        self._unexplained += 1
        self.carried = self._unexplained >= CARRIED_FRAMES
        return self.carried

    def second_map(self, data: FrameData, has_odometry: bool) -> InitialPair | None:
        """Two frames for a separate map if odometry does not bridge the gap; None while there are none."""
        if self.bad_frames < SECOND_MAP_FRAMES or (has_odometry and not self.carried):
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
