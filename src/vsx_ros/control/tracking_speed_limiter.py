"""How fast to drive for how well the camera is tracked."""

from __future__ import annotations

from vsx_ros.config import FollowerConfig
from vsx_ros.slam.state import TrackingState


class TrackingSpeedLimiter:
    """Slower while tracking is dubious and a moment longer, so that single frames do not make the speed flicker."""

    def __init__(self, config: FollowerConfig) -> None:
        self._config = config
        self._until_ns: int | None = None

    def speed_factor(self, now_ns: int, state: TrackingState) -> float:
        """The share of the planned speed, in [0, 1]."""
        if state is TrackingState.DUBIOUS:
            self._until_ns = now_ns + round(self._config.dubious_hold_s * 1e9)
        careful = self._until_ns is not None and now_ns <= self._until_ns
        return self._config.dubious_speed_factor if careful else 1.0
