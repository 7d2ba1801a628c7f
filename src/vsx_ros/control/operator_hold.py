"""Whether the operator holds the wheels: by the emergency stop, or by commands of a higher priority than navigation."""

from vsx_ros.robot import EMERGENCY_STOP, OperatorHold

NAVIGATION = "navi"


class OperatorHoldWatch:
    """quiet_s: the wheels count as held for so long after the last command of teleop [s], so that the robot does not
    drive off between two keys. Times are of any clock that never runs backwards."""

    def __init__(self, quiet_s: float) -> None:
        self._quiet_ns = round(1e9 * quiet_s)
        self._heard_ns = 0
        self.hold: OperatorHold | None = None
        """The present hold; ``since_ns`` stays that of its beginning."""

    def observe(self, now_ns: int, estopped: bool, source: str) -> OperatorHold | None:
        """The hold now. source: whose command the mux has selected; empty for none."""
        by = EMERGENCY_STOP if estopped else "" if source == NAVIGATION else source
        if by:
            self._heard_ns = now_ns
            if self.hold is None or self.hold.by != by:
                self.hold = OperatorHold(by, now_ns)
        elif self.hold is not None and (self.hold.by == EMERGENCY_STOP or now_ns - self._heard_ns > self._quiet_ns):
            self.hold = None
        return self.hold
