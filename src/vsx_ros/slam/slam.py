"""SequentialSlam: tracker and mapper in lock-step, bit-reproducible; for bags, tests and the lock-step explorer."""

from __future__ import annotations

from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.slam.tracker_and_mapper import TrackerAndMapper


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
