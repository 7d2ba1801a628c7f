"""Drives that start a map: the SLAM needs two frames some way apart (paper 3.1)."""


class InitializationDrives:
    """Straight drives of length_m [m]: one ahead, then back and ahead in turn, ``again`` more times at most."""

    def __init__(self, length_m: float, again: int) -> None:
        self._length_m, self._most = length_m, 1 + again
        self._begun = 0

    def next(self, slam_reason: str) -> tuple[float, str] | None:
        """How far to drive [m], back if negative, and why; None when the attempts are used up.

        slam_reason: why the map has not started yet.
        """
        if self._begun == self._most:
            return None
        self._begun += 1
        if self._begun == 1:
            return self._length_m, "first straight drive for two frames"
        way_m = -self._length_m if self._begun % 2 == 0 else self._length_m
        return way_m, f"another straight drive: {slam_reason}"
