"""Finds a lost camera in the map: at the expected place, then at every similar place, each verified by patch search. A
place that is only likely must be seen again in the next frame, where odometry puts it."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData, MapView, unit_of
from vsx_ros.slam.local_map import LocalMap, nearest_keyframes
from vsx_ros.slam.odometry import motion_by_odometry
from vsx_ros.slam.place_recognition import SEARCH_RADIUS_PX, PlaceRecognizer, Recognition, occupied_cells
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.slam.tracker import Tracker
from vsx_ros.vision.corners import features_of

BEST_LIKELY, IN_TURN = 2, 2  # keyframes tried per lost frame, limited by time
WIDE = 2.0  # factor on coarse_radius_px: odometry drifted while the camera was lost
AGREE_M, AGREE_RAD, AGREE_S = 0.15, 0.15, 0.5  # limits for two frames that confirm one place, after odometry
# Largest motion off the floor: more than from a rug or a loose camera mast.
OFF_FLOOR_M, OFF_FLOOR_RAD = 0.03, 0.05
# While odometry predicts the pose, another place is only similar: the next brick of a wall is 0.2 m away.
REACH_M, REACH_RAD = 0.06, 0.05


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
        self.places = PlaceRecognizer(camera, tracker)
        self.forget()

    def forget(self) -> None:
        """Reset for the next loss."""
        self._turn = 0
        self._unconfirmed: tuple[FrameData, Relocalization] | None = None

    def relocalize(self, data: FrameData, view: MapView, expected: ExpectedPose | None) -> Relocalization | None:
        """Find the camera in any of the maps; None when that fails."""
        found = None if expected is None else self._where_expected(data, view, expected)
        firm = expected is not None and expected.is_firm
        found = found if found is not None or firm else self._seen_again(data, view)
        if found is not None:
            return found
        features = features_of(data.pyramid, data.corners)
        for k in self._likely(data, view, expected):
            seen = self.places.recognise(data, features, view, k)
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
        """The most similar keyframes, and some of the rest in turn."""
        among = view.living if expected is None or not expected.is_firm else view.part(expected.map_id).living
        ranked = [int(k) for k in self.places.ranked(data.small, view, among)]
        best, rest = ranked[:BEST_LIKELY], ranked[BEST_LIKELY:]
        in_turn = [rest[(self._turn + n) % len(rest)] for n in range(min(IN_TURN, len(rest)))]
        self._turn += IN_TURN
        return best + in_turn

    def _found(self, track: Track, view: MapView, keyframe: int) -> Relocalization:
        map_id = view.keyframes[keyframe].map_id
        return Relocalization(track, LocalMap(view.part(map_id), keyframe).follow(track), map_id)

    def _seen_again(self, data: FrameData, view: MapView) -> Relocalization | None:
        """The place of a frame shortly before that is not confirmed yet, if this frame shows it, too."""
        predicted = self._predicted(data)
        if predicted is None:
            return None
        earlier, T_world_cam = predicted
        seen = self.places.verify(data, view, earlier.reference, T_world_cam, SEARCH_RADIUS_PX)
        found = self._found(seen.track, view, seen.keyframe)
        return found if seen.is_sure(self._config) and self._confirms(data, view, found) else None

    def _confirms(self, data: FrameData, view: MapView, found: Relocalization) -> bool:
        """Whether a frame shortly before was recognised at a consistent pose."""
        predicted = self._predicted(data)
        if predicted is None or predicted[0].map_id != found.map_id:
            return False
        reach = AGREE_M * unit_of(view.keyframes, found.reference).metre
        return predicted[1].is_near(found.track.T_world_cam, reach, AGREE_RAD)

    def _predicted(self, data: FrameData) -> tuple[Relocalization, SE3] | None:
        """The place of a frame shortly before, and where odometry puts the camera since; None without such a frame."""
        if self._unconfirmed is None:
            return None
        before, earlier = self._unconfirmed
        if (data.stamp_ns - before.stamp_ns) * 1e-9 > AGREE_S:
            return None
        moved = motion_by_odometry(self._T_base_cam, before, data) or SE3.identity()
        return earlier, earlier.track.T_world_cam @ moved
