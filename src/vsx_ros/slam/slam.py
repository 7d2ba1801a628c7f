"""A tracker and a mapper over one map, and SequentialSlam, which runs them in lock-step, bit-reproducible."""

from typing import Any

from numpy.typing import NDArray

from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.frontend import FrontEnd
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.mapper import Mapper
from vsx_ros.slam.slam_map import SlamMap
from vsx_ros.slam.snapshot import MapSnapshot, snapshot
from vsx_ros.slam.state import SlamEvent, SlamStatistics, TrackingResult, TrackingState
from vsx_ros.slam.tracking_record import TrackingRecord


class TrackerAndMapper:
    """Who of the two works when is for the classes made of it.

    World: with odometry and T_base_cam the odometry frame (z up, metres); without, the first keyframe's camera frame
    at the configured unit baseline. With a loaded map it is that map's, and the camera is lost until recognised in it.
    """

    def __init__(
        self,
        camera: PinholeCamera,
        T_base_cam: SE3 | None,
        config: SlamConfig,
        seed: int = 0,
        slam_map: SlamMap | None = None,
        record: TrackingRecord | None = None,
    ) -> None:
        """slam_map: a map to go on in, the camera anywhere in it; record: what was counted while it was made, to go on
        counting. Raises CalibrationError when the map was made with another camera or mount."""
        world = Map() if slam_map is None else slam_map.resumed(camera, T_base_cam)
        self._front = FrontEnd(camera, T_base_cam, config, seed)
        self._camera, self._mount = camera, T_base_cam if slam_map is None else slam_map.T_base_cam
        self._mapper = Mapper(camera, self._mount, config, world)
        self._view: MapView = world.view()
        self._snapshot: MapSnapshot = snapshot(self._view)
        if record is not None:
            self._front.record = record
        if self._view.keyframes:
            self._front.resume(self._view)
        self._begin()

    def _begin(self) -> None:
        """What else there is to begin with."""

    def snapshot(self) -> MapSnapshot:
        """The newest finished map; the same object while the version is unchanged."""
        view = self._view
        if self._snapshot.version != view.version:
            self._snapshot = snapshot(view)
        return self._snapshot

    def slam_map(self) -> SlamMap | None:
        """The map to save and continue, None while there is none."""
        view = self._view
        return SlamMap(self._camera, self._mount, view) if view.keyframes else None

    def drain_events(self) -> list[SlamEvent]:
        """Everything that happened since the last call, oldest first."""
        events, self._front.events = self._front.events, []
        while self._mapper.events:
            events.append(self._mapper.events.popleft())
        return sorted(events, key=lambda event: event.stamp_ns)

    def record(self) -> dict[str, NDArray[Any]]:
        """What was counted, for a session that goes on; from the thread that tracks."""
        return self._front.record.state()

    def statistics(self) -> SlamStatistics:
        """The run so far."""
        return self._front.statistics()


class SequentialSlam(TrackerAndMapper):
    """``track`` every frame in the order of the stamps; the mapper's work of a keyframe is done before it returns."""

    def track(self, frame: Frame, odometry: Odometry | None = None) -> TrackingResult:
        """The pose of one frame. Raises InputError as ``FrontEnd.process`` does."""
        outcome = self._front.process(frame, odometry)
        result = outcome.result
        if outcome.start is not None:
            made = self._mapper.start(outcome.start)
            if isinstance(made, str):
                self._front.refused(made)
                return result._replace(reason=made) if result.state is TrackingState.NOT_INITIALISED else result
            self._view = made
            result = self._front.started(made) or result
        elif outcome.request is not None:
            self._view = self._mapper.add_keyframe(outcome.request)
            if self._mapper.refinement_due:
                self._view = self._mapper.refine()
            self._front.use(self._view)
        return result
