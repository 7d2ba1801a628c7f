"""Processes every frame: starts a map, tracks or recovers, and requests work from the mapper."""

from functools import partial
from itertools import count
from typing import TypeAlias

import numpy as np

from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.frame_tracker import FrameTracker, is_sure
from vsx_ros.slam.initialization import Bootstrap, Initializer
from vsx_ros.slam.keyframe import FrameData, MapView, is_metric, unit_of
from vsx_ros.slam.local_map import LocalMap, becomes_keyframe, may_grow, nearest_keyframes
from vsx_ros.slam.map import Map
from vsx_ros.slam.mapper import KeyFrameRequest
from vsx_ros.slam.odometry import MotionModel, OdometryConsistency
from vsx_ros.slam.preprocessing import Preprocessor
from vsx_ros.slam.recovery import Recovery
from vsx_ros.slam.relocalizer import Relocalization
from vsx_ros.slam.start_watch import GiveUp
from vsx_ros.slam.state import SlamEvent, SlamStatistics, TrackingResult, TrackingState
from vsx_ros.slam.track import Track, nothing_tracked
from vsx_ros.slam.tracker import Tracker
from vsx_ros.slam.tracking_record import TrackingRecord
from vsx_ros.slam.two_view_reconstruction import InitialPair

# A new map that moves the last pose by more than this counts as a jump of the map.
CORRECTION_M, CORRECTION_RAD = 0.05, 0.02
Outcome: TypeAlias = tuple[TrackingResult, InitialPair | KeyFrameRequest | GiveUp | None]


class FrontEnd:
    """``process`` one frame after the other; ``use`` a newer map between frames."""

    def __init__(
        self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, seed: int, *, needs_scale: bool = False
    ) -> None:
        self._config, self._motion = config, MotionModel(T_base_cam, camera.focal_px)
        self._tracker = Tracker(config.tracker, np.random.default_rng(seed))
        self._new_recovery = partial(Recovery, camera, T_base_cam, config, self._tracker, self._motion)
        self.recovery, self._consistency = self._new_recovery(), OdometryConsistency(T_base_cam)
        self.tracking = FrameTracker(config, self._tracker, self._motion)
        self._view = self._here = Map().view()
        self._reference = self._map_id = self._segment = self._since_keyframe = self._keyframe_ns = 0
        self._segments, self._corrected, self.record, self.events = count(1), False, TrackingRecord(), list[SlamEvent]()
        new_initializer = partial(Initializer, T_base_cam, config.initialization, needs_scale=needs_scale)
        self._bootstrap = Bootstrap(new_initializer, self._event)
        self._preprocessor = Preprocessor(camera, T_base_cam, config, self._gap)

    def process(self, frame: Frame, odometry: Odometry | None) -> Outcome:
        """Process one frame, in the order of the stamps; returns its result and work for the mapper. After an
        ``InitialPair`` call ``started`` or ``refused``, at once or some frames later; no other is proposed before.
        Internal poses refer to the image's middle row, results to its stamp (start of the first row). Raises InputError
        for an image of the wrong size or type and for a stamp that does not advance; such a frame changes nothing."""
        if not (self._view.keyframes or self._bootstrap.is_trying) and self._preprocessor.begins_again(odometry):
            self._bootstrap.begin_again()
        data = self._preprocessor.take(frame, odometry, metric=is_metric(self._view.keyframes, self._map_id))
        result, work = self._process(self._consistency.admit(data))
        return self._told(result)._replace(frozen=self._preprocessor.repeats), work

    def _told(self, result: TrackingResult) -> TrackingResult:
        """The result with its poses at the frame's stamp, and their anchor."""
        result = result.seen_from(self._preprocessor.T_middle_stamp)
        return result if result.T_map_cam is None else result._replace(anchor=self._anchor(result.T_map_cam))

    def _anchor(self, T_map_cam: SE3) -> Anchor:
        reference = self._view.keyframes[self._reference]
        return Anchor(self._reference, reference.T_world_cam.inverse() @ T_map_cam, reference.scale)

    def _process(self, data: FrameData) -> Outcome:
        self.tracking.last = None
        if not self._view.keyframes:
            reason, pair = self._bootstrap.next_pair(data)
            self.record.frame_without_map(data.stamp_ns)
            return TrackingResult(data.stamp_ns, TrackingState.NOT_INITIALISED, reason=reason), pair
        self._since_keyframe += 1
        if self._motion.last_pose is None:
            return self._recover(data, self._unplaced(data), None)
        prediction = self._motion.predict(data)
        if self.recovery.bad_frames and prediction.by_odometry:
            self._reference = int(nearest_keyframes(self._here, prediction.T_world_cam)[0])
        local = self.tracking.around(self._here, self._reference)
        track = self.tracking.track(data, local, prediction, tracked_before=not self.recovery.bad_frames)
        if track.state is TrackingState.LOST:
            return self._recover(data, track, self._motion.blind(data, prediction))
        return self._tracked(data, track, local.follow(track), local)

    def resume(self, view: MapView) -> None:
        """Begin in a loaded map. The camera is lost and is searched everywhere in the map."""
        self._segments = count(1 + max(keyframe.odom_segment for keyframe in view.keyframes))
        self._segment = next(self._segments)
        self._enter(view, 0)

    def use(self, view: MapView) -> None:
        """Track on a newer map; the last pose follows its reference keyframe, even into another map. An empty map means
        that its start was wrong: everything begins again."""
        if not view.keyframes:
            self.recovery, self._corrected = self._new_recovery(), False
            self.tracking.begin()
            self._bootstrap.begin_again()
            self.record.forget_points()
            self._enter(view, 0)
            return
        if self._reference < len(self._view.keyframes) and self._motion.last_pose is not None:
            old, new = self._view.keyframes[self._reference], view.keyframes[self._reference]
            before = self._motion.last_pose
            moved = self._anchor(before).pose(view.keyframes)
            self._motion.move(moved, new.scale / old.scale)
            self._consistency.move(moved @ before.inverse())
            metre = unit_of(view.keyframes, self._reference).metre
            self._corrected |= not moved.is_near(before, CORRECTION_M * metre, CORRECTION_RAD)
            self._reference = self._reference if new.anchor is None else new.anchor.keyframe
            self._map_id = new.map_id
        self._enter(view, self._map_id)

    def started(self, view: MapView) -> TrackingResult | None:
        """Continue in the map that the mapper made of the proposed pair. Returns the new result of the pair's second
        frame; None when the camera was found in another map meanwhile and stays there."""
        pair, newest = self._bootstrap.done(), view.keyframes[-1]
        found, in_world = len(newest.observations.rows), newest.map_id == 0
        if in_world and self._view.keyframes:  # meanwhile the map before was given up
            self.use(Map().view())
        if in_world:
            self._event(pair.second.stamp_ns, "initialised", f"{found} points from two frames")
            self.record.initialised(pair.second.stamp_ns, newest.T_world_cam.translation)
        else:
            self._event(pair.second.stamp_ns, "second map", f"the known map was out of sight; {found} points")
        if not in_world and not self.recovery.is_lost:
            self.use(view)
            return None
        self._enter(view, newest.map_id)
        self._segment, self._reference = newest.odom_segment, len(view.keyframes) - 1
        self._motion.update(pair.second, newest.T_world_cam, measured=False)
        self.recovery.over(pair.second)
        self._since_keyframe, self._keyframe_ns, self.tracking.coarse_next = 0, pair.second.stamp_ns, True
        result = TrackingResult(
            pair.second.stamp_ns, TrackingState.GOOD, searched=found, found=found, keyframe_added=True,
            reason="map started", map_id=newest.map_id,
        )  # fmt: skip
        return self._told(result.placed(newest.T_world_cam))

    def refused(self, reason: str) -> None:
        """The mapper could not make a map of the proposed pair."""
        if self._view.keyframes:
            self._bootstrap.done()
        else:
            self._bootstrap.refused(reason)

    def _enter(self, view: MapView, map_id: int) -> None:
        self._view, self._here, self._map_id = view, view.part(map_id), map_id

    def statistics(self) -> SlamStatistics:
        """The run so far."""
        return self.record.statistics(len(self._view.living), int(np.count_nonzero(self._view.alive)))

    def _tracked(self, data: FrameData, track: Track, reference: int, local: LocalMap) -> Outcome:
        if is_sure(track) and (change := self._consistency.compare(track.T_world_cam)):
            self._event(data.stamp_ns, "gap", change)
        self._motion.update(heard := self._consistency.heard(data), track.T_world_cam, measured=True)
        if self.recovery.is_lost:
            where = "" if self._map_id == 0 else f" in map {self._map_id}"
            self.record.relocalizations += self._map_id == 0
            self._event(data.stamp_ns, "relocalised", f"{len(track.rows)} points of the map found again{where}")
        self.recovery.over(heard)
        self._reference, self.tracking.coarse_next = reference, track.state is not TrackingState.GOOD
        self.record.tracked(data.stamp_ns, track, len(self._view.points), self._map_id == 0)
        local.leave_out(self.record.hopeless(local.rows))
        config, gap = self._config.keyframes, (self._since_keyframe, (data.stamp_ns - self._keyframe_ns) * 1e-9)
        may = not data.blurred and may_grow(config, self._view, track, *gap)
        added = may and becomes_keyframe(config, local.linked, track, reference, data)
        request = self._request(data, track) if added else None
        result = TrackingResult(
            data.stamp_ns, track.state, searched=len(track.searched_rows), found=len(track.rows), keyframe_added=added,
            reason=track.reason, map_id=self._map_id, corrected=self._corrected,
            covariance=self.tracking.covariance(track, local), ahead=track.ahead,
        )  # fmt: skip
        self._corrected = False
        return result.placed(track.T_world_cam), request

    def _request(self, data: FrameData, track: Track) -> KeyFrameRequest:
        self._segment = next(self._segments) if self._preprocessor.parted() and len(track.rows) else self._segment
        self._since_keyframe, self._keyframe_ns = 0, data.stamp_ns
        settled, (searched, found) = track.settled, self.record.counts()
        return KeyFrameRequest(
            data, self._anchor(track.T_world_cam), self._segment, rows=track.rows[settled], uv=track.uv[settled],
            level=track.level[settled], searched=searched, found=found,
        )  # fmt: skip

    def _recover(self, data: FrameData, track: Track, by_odometry: SE3 | None) -> Outcome:
        """Too few points were found: search for the camera again, now and in every following frame."""
        recovery = self.recovery
        if recovery.is_lost:
            self._consistency.interrupt()
        if (found := recovery.search(data, self._view, by_odometry, self._map_id)) is not None:
            return self._found_again(data, found, by_odometry)
        was_lost = recovery.is_lost
        if recovery.missed(data):
            self._event(data.stamp_ns, "carried", "the image is another one though the base stood")
        if recovery.is_lost and not was_lost:
            self._event(data.stamp_ns, "lost", track.reason)
        pair = None if data.blurred else self._bootstrap.claim(recovery.second_map(data, by_odometry is not None))
        pair = pair._replace(odom_segment=next(self._segments)) if pair is not None else None
        request = None
        if by_odometry is not None:
            self._motion.update(data, by_odometry, measured=False)
            if recovery.bridges(data, self._here, by_odometry, self._since_keyframe):
                self._event(data.stamp_ns, "bridged", "keyframe placed by odometry alone")
                self._consistency.bridge()
                request = self._request(data, nothing_tracked(track.reason, by_odometry))
        self.tracking.coarse_next = True
        self.record.missed(data.stamp_ns)
        trusted = by_odometry if not recovery.carried and self._map_id == 0 else None
        state = TrackingState.LOST if recovery.is_lost or self._map_id else TrackingState.DUBIOUS
        reason = track.reason + ("; position by odometry" if trusted is not None else "")
        known = None if trusted is None else self.tracking.covariance_by_odometry()
        result = TrackingResult(
            data.stamp_ns, state, trusted, searched=len(track.searched_rows), keyframe_added=request is not None,
            reason=reason, map_id=self._map_id, T_map_cam=by_odometry, covariance=known,
        )  # fmt: skip
        return result, pair or request or recovery.gives_up(data, self._view)

    def _found_again(self, data: FrameData, found: Relocalization, by_odometry: SE3 | None) -> Outcome:
        """The camera was found in one of the maps. Unless odometry connects the poses, its next segment begins."""
        expected = self.recovery.expected_pose(by_odometry, self._map_id)
        far = self.recovery.is_lost or found.map_id != self._map_id
        if not (expected is not None and expected.is_firm) and (far or by_odometry is not None):
            self._segment = next(self._segments)
        self._enter(self._view, found.map_id)
        outcome = self._tracked(data, found.track, found.reference, self.tracking.around(self._here, found.reference))
        self.tracking.coarse_next = True
        return outcome

    def _unplaced(self, data: FrameData) -> Track:
        """The camera is not yet recognised in the loaded map, and odometry has another origin."""
        reason = f"not yet recognised in the loaded map of {len(self._here.living)} keyframes"
        if not self.recovery.is_lost:
            self.recovery.begin_lost()
            self._event(data.stamp_ns, "lost", reason)
        return nothing_tracked(reason)

    def _gap(self, stamp_ns: int, reason: str) -> None:
        self.tracking.coarse_next = True
        self._event(stamp_ns, "gap", reason)

    def _event(self, stamp_ns: int, kind: str, reason: str) -> None:
        self.events.append(SlamEvent(stamp_ns, kind, reason))
