"""Which device keeps a robot from starting, from what base and camera say of their links each second."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from vsx_ros.ros.diagnostics import ERROR

_LINKS = ("mobile_base: link", "camera: stream")
_TIMES = 3  # a link that is being made is without images, or not yet there, for a moment


class DeviceTrouble:
    """A warning on /rosout is said once, and lost where nobody listened yet; diagnostics are said again."""

    def __init__(self, namespace: str) -> None:
        self._names = {f"{namespace.strip('/')}/{link}".lstrip("/") for link in _LINKS}
        self._said: dict[str, tuple[str, int]] = {}

    def heard(self, status: DiagnosticStatus) -> str | None:
        """The node and the sentence it would have written to /rosout, when it says the same trouble for the third
        time."""
        if status.name not in self._names:
            return None
        before, times = self._said.get(status.name, ("", 0))
        times = times + 1 if status.message == before and status.level >= ERROR else 1
        self._said[status.name] = status.message, times
        if times != _TIMES:
            return None
        named = status.message.startswith(status.hardware_id)
        sentence = status.message if named else f"{status.hardware_id}: {status.message}"
        return f"{status.name.rpartition(': ')[0]}: {sentence}"
