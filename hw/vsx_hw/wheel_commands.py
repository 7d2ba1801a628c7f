"""From wanted speeds to those that a protocol can express and the wheels can drive. Pure."""

from collections.abc import Callable
from typing import TypeVar

COARSEST_RAD_S = 0.02  # The coarsest rounding of any protocol: a larger error comes from a speed limit

Command = TypeVar("Command")


class TurnErrorFeedback:
    """Turn rates for a protocol with integers: the rounding error of one command is added to the next.

    With evenly spaced commands (one per report) the mean turn rate is the requested one. Driving straight or standing
    still resets the error."""

    def __init__(self) -> None:
        self._error_rad_s = 0.0

    def command(
        self, v_m_s: float, omega_rad_s: float, encode: Callable[[float, float], tuple[Command, float]]
    ) -> Command:
        """encode: from (v, omega) to the encoded command and the turn rate that it really drives."""
        wanted = omega_rad_s + self._error_rad_s if omega_rad_s else 0.0
        command, driven = encode(v_m_s, wanted)
        self._error_rad_s = max(-COARSEST_RAD_S, min(COARSEST_RAD_S, wanted - driven)) if omega_rad_s else 0.0
        return command


def within_limit(v_m_s: float, omega_rad_s: float, wheel_base_m: float, limit_m_s: float) -> tuple[float, float]:
    """(v, omega) scaled down alike, so that no wheel exceeds its limit; this keeps the curve."""
    wheel_m_s = abs(v_m_s) + 0.5 * wheel_base_m * abs(omega_rad_s)
    share = min(1.0, limit_m_s / wheel_m_s) if wheel_m_s else 1.0
    return share * v_m_s, share * omega_rad_s
