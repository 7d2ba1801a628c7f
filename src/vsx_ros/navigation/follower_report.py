"""What the follower says of itself, as an object and as text."""

from __future__ import annotations

import msgspec

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2


class FollowerReport(msgspec.Struct, frozen=True):
    """The word of the follower on a trajectory.

    trajectory: its identity, 0 before the first. error: x [m], y [m], theta [rad] of the reference as seen from the
    base, where known. at_s: how far it is in the trajectory's own time. stop: x, y, theta in ``frame`` of where the
    base will stand, while it is stopping on the way because that was wanted.
    """

    trajectory: int
    status: FollowStatus
    reason: str
    frame: str
    error: tuple[float, float, float] | None = None
    at_s: float = 0.0
    stop: tuple[float, float, float] | None = None

    def stop_in(self, frame: str) -> SE2 | None:
        """Where the base will stand, in ``frame``; None where it is not stopping, or in another frame."""
        return SE2(*self.stop) if self.stop is not None and self.frame == frame else None

    def says_more_than(self, before: FollowerReport | None) -> bool:
        """Whether anything but the progress changed."""
        return before is None or self._words() != before._words()

    def _words(self) -> tuple[object, ...]:
        return self.trajectory, self.status, self.reason, self.stop

    def encode(self) -> str:
        """As JSON; numbers that are not finite become null."""
        return msgspec.json.encode(self).decode()


def decode_report(text: str) -> FollowerReport:
    """Raises InputError for text that no follower has written."""
    try:
        return msgspec.json.decode(text, type=FollowerReport)
    except msgspec.DecodeError as error:
        raise InputError(f"this is no report of the follower: {error}; is another node publishing it?") from error
