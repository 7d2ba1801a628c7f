"""ThreadedSlam: the steps of SequentialSlam with the mapper on a thread of its own. The only file here that may use
threads.

The tracker runs in the caller's thread on the newest finished map; nobody waits for a lock that the other holds while
it works. Kernels release Python's global lock.
"""

import threading
from collections import deque

from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.mapper import KeyFrameRequest
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.snapshot import TrackedFeatures, tracked_features
from vsx_ros.slam.state import TrackingResult
from vsx_ros.slam.two_view_reconstruction import InitialPair

MAX_WAITING = 3


class ThreadedSlam(TrackerAndMapper):
    """Live SLAM: ``track`` from one thread; ``snapshot``, ``slam_map``, ``statistics`` from any; ``close`` at the end.

    When the mapper is three keyframes behind, further ones are not taken.
    """

    def _begin(self) -> None:
        self._used: MapView = self._view
        self._waiting: deque[KeyFrameRequest | InitialPair] = deque()
        self._tried: MapView | str | None = None
        self._work = threading.Condition()
        self._closing = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="mapper", daemon=True)
        self._thread.start()

    def track(self, frame: Frame, odometry: Odometry | None = None) -> TrackingResult:
        """The pose of one frame. Raises InputError as ``FrontEnd.process`` does, and whatever broke the mapper."""
        if self._failure is not None:
            raise self._failure
        self._take_over()
        outcome = self._front.process(frame, odometry)
        result = outcome.result
        if outcome.start is not None:
            with self._work:
                self._waiting.append(outcome.start)
                self._work.notify()
        elif outcome.request is not None:
            with self._work:
                taken = len(self._waiting) < MAX_WAITING
                if taken:
                    self._waiting.append(outcome.request)
                    self._work.notify()
            result = result._replace(keyframe_added=taken)
        return result

    def tracked_features(self) -> TrackedFeatures | None:
        """The points looked for in the newest frame, None where there were none; from the thread that tracks."""
        last = self._front.tracking.last
        return None if last is None else tracked_features(self._camera, *last)

    def close(self) -> None:
        """Stop the mapper after the step it is in. Can be called twice."""
        with self._work:
            self._closing = True
            self._work.notify()
        self._thread.join()

    def _take_over(self) -> None:
        """Go on with what the mapper has finished since the last frame."""
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

    def _wanted(self) -> bool:
        """Whether something waits that is more urgent than refining the map."""
        return bool(self._waiting) or self._closing

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

    def _step(self, request: KeyFrameRequest | InitialPair | None) -> None:
        if isinstance(request, InitialPair):
            tried = self._mapper.start(request)
            with self._work:
                self._tried = tried
                self._view = self._view if isinstance(tried, str) else tried
        elif request is None:
            self._view = self._mapper.refine(self._wanted)
        else:
            self._view = self._mapper.add_keyframe(request)
