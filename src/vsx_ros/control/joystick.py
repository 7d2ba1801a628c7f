"""A stick that drives over a network: whatever comes late, or from a hand that has let go, moves nothing."""

import math
from typing import NamedTuple

from vsx_ros.robot import STOP, VelocityCommand

_TICKET_S = 0.4  # less than a command of teleop is valid in the base


class StickAnswer(NamedTuple):
    """command: for the base, None: leave it alone. ticket: to be shown with the next movement of the stick. reason: why
    the stick was not obeyed; empty if it was."""

    command: VelocityCommand | None
    ticket: int
    reason: str = ""


class Joystick:
    """Each movement shows the ticket of the answer to the one before, which is valid for _TICKET_S and once. So a
    movement that was held up on its way is refused, without a look at the clock of the page; the first one only fetches
    a ticket. The centre stops at once and takes the ticket away. Times are of any clock that never stops."""

    def __init__(self, v_m_s: float, omega_rad_s: float) -> None:
        self._v_m_s, self._omega_rad_s = v_m_s, omega_rad_s
        self._ticket, self._valid, self._until_s = 0, False, -math.inf

    def move(self, now_s: float, forward: float, left: float, ticket: int) -> StickAnswer:
        """forward, left: shares of the full speeds, from -1 to 1. ticket: of the last answer; 0: none yet."""
        fits = self._valid and ticket == self._ticket and now_s <= self._until_s
        self._valid = False
        if forward == left == 0.0:
            return StickAnswer(STOP, 0)
        self._ticket, self._valid, self._until_s = self._ticket + 1, True, now_s + _TICKET_S
        if fits:
            return StickAnswer(VelocityCommand(forward * self._v_m_s, left * self._omega_rad_s), self._ticket)
        return StickAnswer(None, self._ticket, "" if ticket == 0 else "the network is slow: a movement came too late")
