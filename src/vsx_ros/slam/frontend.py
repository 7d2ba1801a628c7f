"""What happens to every frame: take the image apart, start, track or recover, and say what the mapper shall do."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.config import SlamConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.initialization import Initialization, Initializer
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.keyframes import keyframe_reason
from vsx_ros.slam.map import MapView, empty_view
from vsx_ros.slam.mapper import KeyFrameRequest
from vsx_ros.slam.motion_model import MotionModel
from vsx_ros.slam.relocalization import Relocalizer
from vsx_ros.slam.state import SlamEvent, SlamStatistics, TrackingResult, TrackingState
from vsx_ros.slam.tracker import LocalMap, Track, Tracker, nearest_keyframes, nothing_tracked
from vsx_ros.slam.tracking_record import TrackingRecord
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.pyramid import build_pyramid
from vsx_ros.vision.small_image import small_image

GAP_S = 1.0
# While the wheels tell where the camera must be, a place elsewhere only looks alike; but after this many frames it may
# have been carried.
REACH_M, REACH_RAD, PATIENCE_FRAMES = 0.2, 0.15, 60
ANYWHERE = (math.inf, math.inf)
MAX_STEP_M, MAX_STEP_RAD = 0.08, 0.06
BRIDGE_CORNERS, BRIDGE_GAP_FRAMES, BRIDGE_DISTANCE_M, BRIDGE_ANGLE_RAD = 150, 2, 0.04, 0.07
MAX_ODOMETRY_AGE_S = 0.25


class FrameOutcome(NamedTuple):
    """A result and the work it gives to the mapper (at most one of the two)."""

    result: TrackingResult
    start: Initialization | None = None
    request: KeyFrameRequest | None = None


class FrontEnd:
    """``process`` one frame after the other; ``use`` a newer map between frames."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, seed: int) -> None:
        self._camera = camera
        self._T_base_cam = T_base_cam
        self._config = config
        self._detector = CornerDetector()
        self._tracker = Tracker(camera, config.tracker, np.random.default_rng(seed))
        self._initializer = Initializer(camera, T_base_cam, config.initialization)
        self._relocalizer = Relocalizer(camera, config.tracker, self._tracker)
        self._motion = MotionModel(T_base_cam, camera.fx)
        self._local = LocalMap()
        self._reference = 0
        self._view = empty_view()
        self._bad_frames = 0
        self._since_keyframe = 0
        self._last_stamp_ns: int | None = None
        self._coarse_next = True
        self._refusal = ""
        self.record = TrackingRecord()
        self.events: list[SlamEvent] = []

    def process(self, frame: Frame, odometry: Odometry | None) -> FrameOutcome:
        """One frame, in the order of the stamps.

        Raises InputError for an image of the wrong size or type and for a stamp that does not advance; the frame is
        then as if it had never come.
        """
        data = self._take_apart(frame, odometry)
        if not self._view.keyframes:
            return self._start(data)
        self._since_keyframe += 1
        if self._motion.last_pose is None:
            return self._recover(data, self._unplaced(data), None)
        prediction = self._motion.predict(data)
        if self._bad_frames and prediction.by_wheels:
            self._reference = int(nearest_keyframes(self._view, prediction.T_world_cam)[0])
        self._local.select(self._view, self._reference)
        radius = self._config.tracker.coarse_radius_px
        coarse = radius if self._coarse_next or not prediction.by_wheels else 0.0
        track = self._tracker.track(
            data, self._view, prediction.T_world_cam, self._local.rows, coarse, prediction.information
        )
        if track.state is not TrackingState.LOST and prediction.by_wheels:
            track = self._checked(track, prediction.T_world_cam)
        if track.state is TrackingState.LOST:
            return self._recover(data, track, prediction.T_world_cam if prediction.by_wheels else None)
        return self._tracked(data, track, self._local.follow(self._view, track.rows))

    def resume(self, view: MapView) -> None:
        """Begin in a map made before, lost: the camera is looked for everywhere in it."""
        self._view = view

    def use(self, view: MapView) -> None:
        """Track on a newer map; the last pose follows its reference keyframe."""
        if self._view.keyframes and self._reference < len(view.keyframes):
            old, new = self._view.keyframes[self._reference], view.keyframes[self._reference]
            self._motion.move(new.T_world_cam @ old.T_world_cam.inverse())
            self._reference = self._reference if new.anchor is None else new.anchor.keyframe
        self._view = view

    def started(self, view: MapView, start: Initialization) -> None:
        """The mapper made the first map."""
        self._view = view
        self._reference = len(view.keyframes) - 1
        self._motion.update(start.second, view.keyframes[-1].T_world_cam, measured=False)
        self._since_keyframe = 0
        self._coarse_next = True

    def statistics(self) -> SlamStatistics:
        """The run so far."""
        return self.record.statistics(len(self._view.living), int(np.count_nonzero(self._view.alive)))

    def _take_apart(self, frame: Frame, odometry: Odometry | None) -> FrameData:
        camera = self._camera
        pyramid = build_pyramid(frame.image)
        if frame.image.shape != (camera.height, camera.width):
            height, width = frame.image.shape
            raise InputError(
                f"image of {width}x{height} does not fit the calibration for {camera.width}x{camera.height}; "
                "calibrate at this size or set the camera to the calibrated one"
            )
        last = self._last_stamp_ns
        if last is not None and frame.stamp_ns <= last:
            raise InputError(
                f"frame stamp {frame.stamp_ns} ns is not after the one before, {last} ns; frames must come in order"
            )
        if last is not None and (frame.stamp_ns - last) * 1e-9 > GAP_S:
            self._event(frame.stamp_ns, "gap", f"no frame for {(frame.stamp_ns - last) * 1e-9:.1f} s")
            self._coarse_next = True
        self._last_stamp_ns = frame.stamp_ns
        wheels = self._odometry_at(frame.stamp_ns, odometry)
        return FrameData(frame.stamp_ns, pyramid, self._detector.detect(pyramid), small_image(pyramid), wheels)

    def _odometry_at(self, stamp_ns: int, odometry: Odometry | None) -> SE2 | None:
        """The base's odometry pose at the instant of the image, None when it cannot be told."""
        if odometry is None or self._T_base_cam is None:
            return None
        age = (stamp_ns - odometry.stamp_ns) * 1e-9
        numbers = (odometry.v, odometry.omega)
        if not (odometry.T_odom_base.is_finite() and np.isfinite(numbers).all()):
            self._event(stamp_ns, "gap", "odometry is not a number: ignored for this frame")
            return None
        if abs(age) > MAX_ODOMETRY_AGE_S:
            self._event(stamp_ns, "gap", f"odometry is {age:.2f} s older than the image: ignored for this frame")
            return None
        return odometry.T_odom_base @ SE2.exp(odometry.v * age, 0.0, odometry.omega * age)

    def _start(self, data: FrameData) -> FrameOutcome:
        outcome = self._initializer.add(data)
        self.record.frame_without_map(data.stamp_ns)
        if isinstance(outcome, str):
            if outcome.split(":")[0] != self._refusal.split(":")[0]:
                self._event(data.stamp_ns, "refused", outcome)
            self._refusal = outcome
            state = TrackingState.NOT_INITIALISED
            return FrameOutcome(TrackingResult(data.stamp_ns, state, None, 0, 0, False, outcome))
        found = len(outcome.matches.chosen)
        self._event(data.stamp_ns, "initialised", f"{found} points from two frames")
        self.record.initialised(data.stamp_ns, outcome.poses[1].translation)
        result = TrackingResult(data.stamp_ns, TrackingState.GOOD, outcome.poses[1], found, found, True, "map started")
        return FrameOutcome(result, start=outcome)

    def _checked(self, track: Track, by_wheels: SE3) -> Track:
        """A pose far from where the wheels moved the last one is a mistake, not a measurement."""
        if self._bad_frames:
            return track
        step = float(np.linalg.norm(track.T_world_cam.translation - by_wheels.translation))
        turn = track.T_world_cam.rotation_angle_to(by_wheels)
        if step < MAX_STEP_M and turn < MAX_STEP_RAD:
            return track
        reason = f"contradicts the wheels by {step:.2f} m and {np.degrees(turn):.1f} deg"
        return track._replace(state=TrackingState.LOST, reason=reason)

    def _tracked(self, data: FrameData, track: Track, reference: int) -> FrameOutcome:
        self._motion.update(data, track.T_world_cam, measured=True)
        if self._bad_frames >= self._config.tracker.lost_after_frames:
            self.record.relocalizations += 1
            self._event(data.stamp_ns, "relocalised", f"{len(track.rows)} points of the map found again")
        self._reference, self._bad_frames, self._coarse_next = reference, 0, track.state is not TrackingState.GOOD
        self.record.tracked(data.stamp_ns, track, len(self._view.points))
        why = keyframe_reason(self._config.keyframes, self._view, track, reference, self._since_keyframe)
        request = self._request(data, track) if why else None
        result = TrackingResult(
            data.stamp_ns,
            track.state,
            track.T_world_cam,
            len(track.searched_rows),
            len(track.rows),
            request is not None,
            track.reason,
        )
        return FrameOutcome(result, request=request)

    def _request(self, data: FrameData, track: Track) -> KeyFrameRequest:
        self._since_keyframe = 0
        reference = self._view.keyframes[self._reference].T_world_cam
        searched, found = self.record.counts()
        return KeyFrameRequest(
            data,
            self._reference,
            reference.inverse() @ track.T_world_cam,
            track.rows,
            track.uv,
            track.level,
            searched,
            found,
        )

    def _recover(self, data: FrameData, track: Track, by_wheels: SE3 | None) -> FrameOutcome:
        """Too little was found: try everything to find the camera again, at once and in every frame."""
        expected = by_wheels or self._motion.last_pose
        reach = ANYWHERE
        if by_wheels is not None and self._bad_frames < PATIENCE_FRAMES:
            reach = (REACH_M + 0.01 * self._bad_frames, REACH_RAD + 0.01 * self._bad_frames)
        recovered = self._relocalizer.relocalize(data, self._view, expected, reach)
        if recovered is not None:
            outcome = self._tracked(data, *recovered)
            self._coarse_next = True
            return outcome
        self._bad_frames += 1
        lost = self._bad_frames >= self._config.tracker.lost_after_frames
        if self._bad_frames == self._config.tracker.lost_after_frames:
            self._event(data.stamp_ns, "lost", track.reason)
        request = None
        if by_wheels is not None:
            self._motion.update(data, by_wheels, measured=False)
            request = self._bridge(data, track, by_wheels) if lost else None
        self._coarse_next = True
        self.record.missed(data.stamp_ns)
        state = TrackingState.LOST if lost else TrackingState.DUBIOUS
        reason = track.reason + ("; position by the wheels" if by_wheels is not None else "")
        searched = len(track.searched_rows)
        added = request is not None
        result = TrackingResult(data.stamp_ns, state, by_wheels, searched, 0, added, reason)
        return FrameOutcome(result, request=request)

    def _unplaced(self, data: FrameData) -> Track:
        """Where the camera is in the map made before is not known yet; the wheels count from elsewhere."""
        reason = f"not yet recognised in the loaded map of {len(self._view.living)} keyframes"
        if not self._bad_frames:
            self._bad_frames = self._config.tracker.lost_after_frames
            self._event(data.stamp_ns, "lost", reason)
        return nothing_tracked(reason)

    def _bridge(self, data: FrameData, track: Track, by_wheels: SE3) -> KeyFrameRequest | None:
        """Lost, but the image shows something and the wheels turn: let the map go on from where they put the camera, so
        that what is in view becomes a map again. The odometry factors keep the stretch as uncertain as it is."""
        if len(data.corners.positions) < BRIDGE_CORNERS or self._since_keyframe < BRIDGE_GAP_FRAMES:
            return None
        nearest = self._view.keyframes[int(nearest_keyframes(self._view, by_wheels)[0])].T_world_cam
        moved = float(np.linalg.norm(nearest.translation - by_wheels.translation))
        if moved < BRIDGE_DISTANCE_M and nearest.rotation_angle_to(by_wheels) < BRIDGE_ANGLE_RAD:
            return None
        self._event(data.stamp_ns, "bridged", "keyframe placed by the wheels alone")
        return self._request(data, nothing_tracked(track.reason, by_wheels))

    def _event(self, stamp_ns: int, kind: str, reason: str) -> None:
        self.events.append(SlamEvent(stamp_ns, kind, reason))
