"""The way home: where the exploration began, and which tries to get back there have failed."""

from vsx_ros.exploration.decision import Situation
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.anchored_poses import MapCorrections

_MOST_TRIES = 5  # in a row, none of them nearer; then the run ends where the robot is
_NEARER_M = 0.5  # to home than after all tries before: the way there is not blocked


class Home:
    """Where the exploration began, and the tries to get back, which may fail; call ``observe`` with every situation.
    pose: T_map_base; None until the camera knows the map. asked: whether to go there."""

    def __init__(self) -> None:
        self.pose: SE2 | None = None
        self.asked = False
        self._begun: tuple[int, SE2] | None = None
        self._here: SE2 | None = None
        self._tries: list[tuple[int, float]] = []  # when each failed, and how far from home [m]
        self._why = ""

    def observe(self, situation: Situation) -> None:
        """Odometry gives the motion from the start of the exploration, or of the odometry's epoch, to the place where
        the camera first knows the map."""
        self._here = situation.T_map_base or self._here
        if self.pose is not None or situation.T_odom_base is None:
            return
        if self._begun is None or self._begun[0] != situation.odom_epoch:
            self._begun = situation.odom_epoch, situation.T_odom_base
        if situation.slam_state.tracked and situation.T_map_base is not None:
            self.pose = situation.T_map_base @ situation.T_odom_base.inverse() @ self._begun[1]

    def moved(self, corrections: MapCorrections) -> None:
        """The map was corrected."""
        if self.pose is not None:
            (self.pose,) = corrections.moved([self.pose])

    def failed(self, now_ns: int, reason: str) -> str:
        """Count a failed drive home; returns words with the number of tries and this reason. A robot that came nearer
        begins to count anew."""
        away_m = self.pose.distance_to(self._here) if self.pose is not None and self._here is not None else 0.0
        if self._tries and away_m < min(before_m for _, before_m in self._tries) - _NEARER_M:
            self._tries = []
        self._tries.append((now_ns, away_m))
        self._why = reason
        return f"home was not reached, try {len(self._tries)} of {_MOST_TRIES}: {reason}"

    def withdraw(self, since_ns: int) -> None:
        """Forget tries that failed since then: that was nobody's fault."""
        self._tries = [(at_ns, away_m) for at_ns, away_m in self._tries if at_ns < since_ns]

    @property
    def out_of_reach(self) -> str:
        """Why not to try again; empty while tries are left."""
        return f"home was not reached in {_MOST_TRIES} tries: {self._why}" if len(self._tries) >= _MOST_TRIES else ""
