"""Who has spoken before, but not for a while: a dead node is not well, whatever its last message said."""

import time

SILENT_S = 3.0  # nodes speak at least once a second; on a machine that is busy, the next word may come a second late


class Silence:
    """By the monotonic clock of this machine: ROS time may stand still or be set back. Thread-safe."""

    def __init__(self) -> None:
        self._heard_s: dict[str, float] = {}

    def heard(self, name: str) -> None:
        """It has spoken now."""
        self._heard_s[name] = time.monotonic()

    def names(self) -> frozenset[str]:
        """Those that have been silent for SILENT_S; who has never spoken is not among them."""
        latest_s = time.monotonic() - SILENT_S
        return frozenset(name for name, heard_s in self._heard_s.copy().items() if heard_s < latest_s)
