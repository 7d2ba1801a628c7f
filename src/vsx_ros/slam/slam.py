"""Tracker and mapper over one map. SequentialSlam runs them in lock-step, bit-reproducible; ThreadedSlam runs the
mapper in a separate thread. Only this file may use threads."""

import threading
from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from numpy.typing import NDArray

from vsx_ros.arrays import array_bytes
from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.frontend import FrontEnd
from vsx_ros.slam.keyframe import MapView, is_metric
from vsx_ros.slam.map import Map
from vsx_ros.slam.mapper import KeyFrameRequest, Mapper
from vsx_ros.slam.recount import Recount
from vsx_ros.slam.snapshot import MapSnapshot, SlamMap, TrackedFeatures, snapshot, tracked_features
from vsx_ros.slam.start_watch import GiveUp
from vsx_ros.slam.state import SlamEvent, SlamStatistics, TrackingResult, TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.slam.tracking_record import TrackingRecord
from vsx_ros.slam.two_view_reconstruction import InitialPair
from vsx_ros.vision.pyramid import remembered_bytes

MAX_WAITING = 3  # keyframes queued for the mapper; more would be out of date at their turn


class TrackerAndMapper(ABC):
    """Base class; subclasses decide when tracker and mapper run.

    World: with odometry and T_base_cam the odometry frame (z up, metres); without, the first keyframe's camera frame at
    the configured unit baseline. A loaded map keeps its world; the camera is lost until it is recognised in it."""

    def __init__(
        self,
        camera: PinholeCamera,
        T_base_cam: SE3 | None,
        config: SlamConfig,
        seed: int = 0,
        slam_map: SlamMap | None = None,
        record: TrackingRecord | None = None,
        *,
        needs_scale: bool = False,
    ) -> None:
        """slam_map: a map to continue, with the camera anywhere in it; record: its tracking record, to continue
        counting. needs_scale: whether a map waits for odometry, however long that is silent; else it begins without it
        after a second. Raises CalibrationError when the map was made with another camera or mount."""
        world = Map() if slam_map is None else slam_map.resumed(camera, T_base_cam)
        self._front = FrontEnd(camera, T_base_cam, config, seed, needs_scale=needs_scale)
        self._camera, self._mount = camera, T_base_cam if slam_map is None else slam_map.T_base_cam
        self._mapper = Mapper(camera, self._mount, config, world)
        self._view: MapView = world.view()
        self._snapshot: MapSnapshot = snapshot(self._view)
        if record is not None:
            self._front.record = record
        if self._view.keyframes:
            self._front.resume(self._view)
        self._begin()

    @abstractmethod
    def _begin(self) -> None:
        """Further initialisation of the subclass."""

    @abstractmethod
    def track(self, frame: Frame, odometry: Odometry | None = None) -> TrackingResult:
        """The pose of one frame."""

    @abstractmethod
    def recount(self, wanted: Recount) -> None:
        """Correct a map made with a wrong wheel calibration."""

    def snapshot(self) -> MapSnapshot:
        """The newest finished map; the same object while the version is unchanged."""
        view = self._view
        if self._snapshot.version != view.version:
            self._snapshot = snapshot(view)
        return self._snapshot

    @property
    def nbytes(self) -> int:
        """Size of the arrays that grow with the map [bytes]: of the view, which copies the mapper's points, of the
        snapshot and of the tracking record; and of what is remembered to recognise places."""
        view = self._view
        copied = array_bytes((view.points, view.alive, view.source, view.templates.of_point))
        pictures = remembered_bytes(self._camera.height, self._camera.width)
        places = self._front.recovery.places.nbytes + self._mapper.loops.places.nbytes + pictures
        return view.nbytes + copied + self._snapshot.nbytes + self._front.record.nbytes + places

    def slam_map(self) -> SlamMap | None:
        """The map to save and continue, None while there is none. A map without scale has no mount."""
        view = self._view
        mount = self._mount if is_metric(view.keyframes, 0) else None
        return SlamMap(self._camera, mount, view) if view.keyframes else None

    def drain_events(self) -> list[SlamEvent]:
        """All events since the last call, oldest first."""
        events, self._front.events = self._front.events, []
        while self._mapper.events:
            events.append(self._mapper.events.popleft())
        return sorted(events, key=lambda event: event.stamp_ns)

    def last_track(self) -> tuple[MapView, Track] | None:
        """The newest frame's track and the map that it was searched in, None if no point was searched; call it from the
        tracking thread."""
        return self._front.tracking.last

    def record(self) -> dict[str, NDArray[Any]]:
        """The tracking record, for a session that continues; call it from the tracking thread."""
        return self._front.record.state()

    def statistics(self) -> SlamStatistics:
        """The run so far."""
        return self._front.statistics()


class SequentialSlam(TrackerAndMapper):
    """``track`` every frame in the order of the stamps; the mapper's work for a keyframe is done before it returns."""

    def _begin(self) -> None:
        """Nothing: there is no thread."""

    def track(self, frame: Frame, odometry: Odometry | None = None) -> TrackingResult:
        """The pose of one frame. Raises InputError as ``FrontEnd.process`` does."""
        result, work = self._front.process(frame, odometry)
        if isinstance(work, InitialPair):
            made = self._mapper.start(work)
            if isinstance(made, str):
                self._front.refused(made)
                return result._replace(reason=made) if result.state is TrackingState.NOT_INITIALISED else result
            self._view = made
            result = self._front.started(made) or result
        elif isinstance(work, GiveUp):
            self._view = self._mapper.give_up(work)
            self._front.use(self._view)
        elif work is not None:
            self._view = self._mapper.add_keyframe(work)
            if self._mapper.refinement_due:
                self._view = self._mapper.refine()
            self._front.use(self._view)
        return result

    def recount(self, wanted: Recount) -> None:
        """Correct a map made with a wrong wheel calibration, before the next frame."""
        self._mapper.recount(wanted)
        self._view = self._mapper.refine()
        self._front.use(self._view)


class ThreadedSlam(TrackerAndMapper):
    """Live SLAM: ``track`` from one thread; ``snapshot``, ``slam_map``, ``statistics`` from any; ``close`` at the end.

    When the mapper is three keyframes behind, new ones are dropped."""

    def _begin(self) -> None:
        self._used: MapView = self._view
        self._waiting: deque[KeyFrameRequest | InitialPair | GiveUp | Recount] = deque()
        self._tried: MapView | str | None = None
        self._work = threading.Condition()
        self._closing = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="mapper", daemon=True)
        self._thread.start()

    def track(self, frame: Frame, odometry: Odometry | None = None) -> TrackingResult:
        """The pose of one frame. Raises InputError as ``FrontEnd.process`` does, and any exception of the mapper."""
        if self._failure is not None:
            raise self._failure
        self._take_over()
        result, work = self._front.process(frame, odometry)
        if work is None:
            return result
        with self._work:
            taken = not isinstance(work, KeyFrameRequest) or len(self._waiting) < MAX_WAITING
            if taken:
                self._waiting.append(work)
                self._work.notify()
        return result._replace(keyframe_added=taken) if isinstance(work, KeyFrameRequest) else result

    def recount(self, wanted: Recount) -> None:
        """Correct a map made with a wrong wheel calibration, when the mapper has time."""
        with self._work:
            self._waiting.append(wanted)
            self._work.notify()

    def tracked_features(self) -> TrackedFeatures | None:
        """The points searched in the newest frame, as ``last_track``."""
        last = self.last_track()
        return None if last is None else tracked_features(self._camera, *last)

    def close(self) -> None:
        """Stop the mapper after the step it is in. Can be called twice."""
        with self._work:
            self._closing = True
            self._work.notify()
        self._thread.join()

    def _take_over(self) -> None:
        """Use what the mapper has finished since the last frame."""
        with self._work:
            view, tried, self._tried = self._view, self._tried, None
        if isinstance(tried, str):
            self._front.refused(tried)
        elif tried is not None:
            self._front.started(tried)
            self._used = tried
        if view is not self._used:
            self._front.use(view)
            self._used = view

    def _run(self) -> None:
        try:
            while True:
                with self._work:
                    while not (self._waiting or self._closing or self._mapper.refinement_due):
                        self._work.wait()
                    if self._closing:
                        return
                    request = self._waiting.popleft() if self._waiting else None
                self._step(request)
        except BaseException as error:  # handed to the tracker's thread, which raises it
            self._failure = error

    def _step(self, request: KeyFrameRequest | InitialPair | GiveUp | Recount | None) -> None:
        if isinstance(request, InitialPair):
            tried = self._mapper.start(request)
            with self._work:
                self._tried = tried
                self._view = self._view if isinstance(tried, str) else tried
        elif isinstance(request, Recount):
            self._view = self._mapper.recount(request)
        elif isinstance(request, GiveUp):
            self._view = self._mapper.give_up(request)
        elif request is None:
            # Waiting requests are more urgent than refining the map.
            self._view = self._mapper.refine(lambda: bool(self._waiting) or self._closing)
        else:
            self._view = self._mapper.add_keyframe(request)
