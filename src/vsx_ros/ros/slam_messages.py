"""What the SLAM says about itself, as messages: its state, and the numbers a user may want to plot."""

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from genpy.message import get_message_class

from vsx_ros.errors import InputError
from vsx_ros.ros import clock, logs, topics
from vsx_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.slam.state import TrackingResult, TrackingState

_STATES = {state.word: state for state in TrackingState}
_LEVELS = {
    TrackingState.NOT_INITIALISED: WARN,
    TrackingState.GOOD: OK,
    TrackingState.DUBIOUS: WARN,
    TrackingState.LOST: ERROR,
}
_FPS_MEMORY = 0.1
_AGAIN_S = 10.0


def state_msg(state: TrackingState, reason: str) -> DiagnosticStatus:
    """name: NOT_INITIALISED, TRACKING, POOR or LOST; message: the reason."""
    return DiagnosticStatus(_LEVELS[state], state.word, reason, "vslam", [])


def tracking_state(msg: DiagnosticStatus) -> TrackingState:
    """The state of a message. Raises InputError for an unknown name."""
    if msg.name not in _STATES:
        raise InputError(f"SLAM state {msg.name!r} is unknown; expected one of {', '.join(_STATES)}")
    return _STATES[msg.name]


class SlamStatus:
    """Publishers: vslam/state (latched, on change and with every map), vslam/stats/*, /diagnostics."""

    def __init__(self) -> None:
        self._stats = {
            name: rospy.Publisher(f"{topics.STATS}/{name}", get_message_class(kind), queue_size=10)
            for name, kind in topics.STAT_TYPES.items()
        }
        self._state_pub = rospy.Publisher(topics.SLAM_STATE, DiagnosticStatus, queue_size=5, latch=True)
        self._diagnostics = Diagnostics()
        self._state, self._reason = TrackingState.NOT_INITIALISED, "waiting for the first image"
        self._fps = 0.0
        self._announce()

    def waiting_for(self, topic: str) -> None:
        """No message on a topic the node cannot do without."""
        name = rospy.resolve_name(topic)
        reason = f"no message on {name}; 'rostopic info {name}' shows who publishes it"
        self._diagnostics.set("input", ERROR, reason)
        if logs.due("waiting", _AGAIN_S):
            rospy.logwarn("%s", reason)

    def without_images(self, reason: str = "no image comes") -> None:
        """No image came for a while: nobody knows any more where the camera is, though nothing is lost yet."""
        self._change(TrackingState.DUBIOUS if self._state is TrackingState.GOOD else self._state, reason)

    def clock_set_back(self, seconds: float) -> None:
        """Images come, but with stamps from before those already seen, so they cannot be used."""
        self.without_images("the clock was set back")
        reason = (
            f"images are stamped {seconds:.1f} s before those seen already: the clock was set back; start vslam anew"
        )
        self.refused(reason)

    def refused(self, reason: str) -> None:
        """An image came that cannot be used."""
        self._diagnostics.set("input", ERROR, reason)
        if logs.due("refused", _AGAIN_S):
            rospy.logerr("%s", reason)

    def frame(self, result: TrackingResult, period_s: float, dropped: int) -> None:
        """One frame was tracked, ``period_s`` after the one before; ``dropped`` counts those never looked at."""
        self._fps += _FPS_MEMORY * (1.0 / max(period_s, 1e-3) - self._fps)
        self._change(result.state, result.reason)
        self._diagnostics.set("input", OK, f"{self._fps:.0f} images a second", dropped=dropped)
        self._publish(
            tracked_ratio=result.found / max(result.searched, 1),
            tracked=result.found,
            attempted=result.searched,
            fps=self._fps,
            latency_ms=(clock.now_ns() - result.stamp_ns) * 1e-6,
            dropped=dropped,
        )

    def map(self, snapshot: MapSnapshot | None) -> None:
        """Once a second: the state again, and the size of the map."""
        self._announce()
        if snapshot is not None:
            self._publish(keyframes=len(snapshot.T_world_cams), points=len(snapshot.points_world))

    def _change(self, state: TrackingState, reason: str) -> None:
        if (state, reason) != (self._state, self._reason):
            if state is not self._state:
                rospy.loginfo("%s: %s", state.word, reason)
            self._state, self._reason = state, reason
            self._announce()

    def _announce(self) -> None:
        self._state_pub.publish(state_msg(self._state, self._reason))
        self._diagnostics.set("tracking", _LEVELS[self._state], f"{self._state.word} {self._reason}".strip())

    def _publish(self, **values: float) -> None:
        for name, value in values.items():
            self._stats[name].publish(value)
