"""Finding the camera again: where it is expected, then at every place that looks alike, each verified by patch search;
a place that nothing else speaks for must be recognised beyond doubt."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import TrackerConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.local_map import LocalMap, nearest_keyframes
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.motion_model import MotionModel
from vsx_ros.slam.place_recognition import PlaceRecognizer, Recognition, is_certain, is_sure, occupied_cells
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.tracker import Track, Tracker
from vsx_ros.vision.descriptors import features_of

BEST_LIKELY, IN_TURN = 3, 2
WIDE = 2.0
AGREE_M, AGREE_RAD, AGREE_S = 0.15, 0.15, 0.5
# Of a camera on wheels: more than a rug or the play of its mast.
OFF_FLOOR_M, OFF_FLOOR_RAD = 0.03, 0.05


class PoseTolerance(NamedTuple):
    """How far odometry, whose wheels may have slipped, allows the camera to be from where it has it: along the floor
    they slip, off it they do not. up_cam (3,): the floor's normal in that camera."""

    distance_m: float
    angle_rad: float
    up_cam: FloatArray

    def allows(self, error: FloatArray) -> bool:
        """error (6,): in that camera's tangent."""
        shift, turn = error[:3], error[3:]
        if np.linalg.norm(shift) > self.distance_m or np.linalg.norm(turn) > self.angle_rad:
            return False
        tilt = np.linalg.norm(np.cross(turn, self.up_cam))
        return bool(abs(shift @ self.up_cam) <= OFF_FLOOR_M and tilt <= OFF_FLOOR_RAD)


class ExpectedPose(NamedTuple):
    """Where the camera should be: T_world_cam in map ``map_id``, and how far from it it can be, None when odometry does
    not tell."""

    T_world_cam: SE3
    map_id: int
    tolerance: PoseTolerance | None

    @property
    def is_firm(self) -> bool:
        """Whether another place is out of the question."""
        return self.tolerance is not None

    def allows(self, T_world_cam: SE3, map_id: int) -> bool:
        """Whether the camera can be there."""
        if self.tolerance is None:
            return True
        return map_id == self.map_id and self.tolerance.allows((self.T_world_cam.inverse() @ T_world_cam).log())


class Relocalization(NamedTuple):
    """The camera in map ``map_id``. reference: keyframe index."""

    track: Track
    reference: int
    map_id: int


class Relocalizer:
    """``relocalize`` each lost frame in turn: it looks at the likeliest keyframes each time, and at the others by and
    by. ``forget`` when the camera is tracked again."""

    def __init__(self, camera: PinholeCamera, config: TrackerConfig, tracker: Tracker, motion: MotionModel) -> None:
        self._camera = camera
        self._config = config
        self._tracker = tracker
        self._motion = motion
        self._places = PlaceRecognizer(camera, tracker)
        self._turn = 0
        self._unconfirmed: tuple[FrameData, Relocalization] | None = None

    def forget(self) -> None:
        """The next loss has nothing to do with this one."""
        self._turn, self._unconfirmed = 0, None

    def relocalize(self, data: FrameData, view: MapView, expected: ExpectedPose | None) -> Relocalization | None:
        """The camera in any of the maps, None when it cannot be told."""
        if expected is not None:
            found = self._where_expected(data, view, expected)
            if found is not None:
                return found
        features = features_of(data.pyramid, data.corners)
        for k in self._likely(data, view, expected):
            seen = self._places.recognise(data, features, view, k)
            if seen is None or not is_sure(seen):
                continue
            found = self._found(seen.track, view, seen.keyframe)
            if expected is not None and not expected.allows(found.track.T_world_cam, found.map_id):
                continue
            firm = expected is not None and expected.is_firm
            if firm or is_certain(seen) or self._confirms(data, found):
                return found
            self._unconfirmed = data, found
        return None

    def _where_expected(self, data: FrameData, view: MapView, expected: ExpectedPose) -> Relocalization | None:
        here = view.part(expected.map_id)
        reference = int(nearest_keyframes(here, expected.T_world_cam)[0])
        local = LocalMap()
        local.select(here, reference)
        radius = WIDE * self._config.coarse_radius_px
        track = self._tracker.track(data, here, expected.T_world_cam, local.rows, radius)
        if track.state is not TrackingState.GOOD or not expected.allows(track.T_world_cam, expected.map_id):
            return None
        seen = Recognition(reference, track, 0, occupied_cells(track.uv, self._camera))
        return self._found(track, view, reference) if expected.is_firm or is_sure(seen) else None

    def _likely(self, data: FrameData, view: MapView, expected: ExpectedPose | None) -> list[int]:
        """The best look-alikes, and some of the rest in turn."""
        among = view.living if expected is None or not expected.is_firm else view.part(expected.map_id).living
        ranked = [int(k) for k in self._places.ranked(data.small, view, among)]
        best, rest = ranked[:BEST_LIKELY], ranked[BEST_LIKELY:]
        in_turn = [rest[(self._turn + n) % len(rest)] for n in range(min(IN_TURN, len(rest)))]
        self._turn += IN_TURN
        return best + in_turn

    def _found(self, track: Track, view: MapView, keyframe: int) -> Relocalization:
        map_id = view.keyframes[keyframe].map_id
        here = view.part(map_id)
        local = LocalMap()
        local.select(here, keyframe)
        return Relocalization(track, local.follow(here, track.rows), map_id)

    def _confirms(self, data: FrameData, found: Relocalization) -> bool:
        """Whether a frame shortly before was recognised where the camera must then have been."""
        if self._unconfirmed is None:
            return False
        before, earlier = self._unconfirmed
        if earlier.map_id != found.map_id or (data.stamp_ns - before.stamp_ns) * 1e-9 > AGREE_S:
            return False
        moved = self._motion.by_odometry(before, data) or SE3.identity()
        step = (earlier.track.T_world_cam @ moved).inverse() @ found.track.T_world_cam
        angle = step.rotation_angle_to(SE3.identity())
        return float(np.linalg.norm(step.translation)) < AGREE_M and angle < AGREE_RAD
