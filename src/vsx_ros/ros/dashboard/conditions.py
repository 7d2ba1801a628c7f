"""The health of the components, and who has become silent: a dead node is not well, whatever it said last."""

import threading
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from vsx_ros.ros.silence import Silence

_STALE = int(DiagnosticStatus.STALE)
_STEADY = frozenset({"mission", "slam"})  # subjects that are told about once a second


class Conditions:
    """Thread-safe."""

    def __init__(self) -> None:
        self._lock, self._silence = threading.Lock(), Silence()
        self._told: dict[str, list[Any]] = {}
        self._silent = frozenset[str]()
        for subject in _STEADY:  # if it does not speak at all, what an open page knows of it is old
            self._silence.heard(subject)

    def heard(self, subject: str) -> None:
        """A subject of the page was told."""
        if subject in _STEADY:
            self._silence.heard(subject)

    def take(self, msg: DiagnosticArray) -> dict[str, list[Any]]:
        """As ``health``, with these components of this robot."""
        with self._lock:
            for status in msg.status:
                if not f"/{status.name}".startswith(rospy.get_namespace()):
                    continue  # from another robot
                values = {pair.key: pair.value for pair in status.values}
                self._told[status.name] = [int(status.level), status.message, values]
                self._silence.heard(status.name)
                if f"/{status.name}".startswith(f"{rospy.resolve_name('vslam')}: "):
                    self._silence.heard("slam")  # the state itself comes on change and with each map
        return self.health()

    def health(self) -> dict[str, list[Any]]:
        """Level, message and values of each component; a silent one has the level STALE."""
        with self._lock:
            return {
                name: [_STALE, f"silent; before: {message}", values]
                if name in self._silent
                else [level, message, values]
                for name, (level, message, values) in self._told.items()
            }

    def changed(self) -> list[str] | None:
        """The silent subjects, if anything has become silent or speaks again since the last call."""
        silent = self._silence.names()
        if silent == self._silent:
            return None
        self._silent = silent
        return sorted(silent & _STEADY)
