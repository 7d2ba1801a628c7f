"""Turn rates on a wire of whole numbers: what rounding takes from one command is added to the next."""

from collections.abc import Callable
from typing import TypeVar

COARSEST_RAD_S = 0.02
"""The widest step of the wires: more than this is a limit that was met, not rounding."""

Command = TypeVar("Command")


class TurnErrorFeedback:
    """Error feedback over commands that follow each other evenly (one a report): their mean turn is what was asked for.
    Straight on and at standstill the error is forgotten: nothing is made up for then."""

    def __init__(self) -> None:
        self._error_rad_s = 0.0

    def command(
        self, v_m_s: float, omega_rad_s: float, encode: Callable[[float, float], tuple[Command, float]]
    ) -> Command:
        """encode: from (v, omega) to what goes on the wire and the turn rate that this really drives."""
        wanted = omega_rad_s + self._error_rad_s if omega_rad_s else 0.0
        command, driven = encode(v_m_s, wanted)
        self._error_rad_s = max(-COARSEST_RAD_S, min(COARSEST_RAD_S, wanted - driven)) if omega_rad_s else 0.0
        return command
