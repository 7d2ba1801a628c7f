"""Home is where the exploration began; the way back to it may fail a few times."""

from vsx_ros.exploration.decision import Situation
from vsx_ros.geometry.se2 import SE2

_MOST_TRIES = 5


class Home:
    """``observe`` every situation. pose: T_map_base where the exploration began; None until the camera knows the map.
    asked: whether to go there."""

    def __init__(self) -> None:
        self.pose: SE2 | None = None
        self.asked = False
        self._begun: tuple[int, SE2] | None = None
        self._tries = 0
        self._why = ""

    def restore(self, pose: SE2 | None, asked: bool) -> None:
        """Go on from a session before; asked: whether it was on its way home, and this one may be already."""
        self.pose, self.asked = pose, asked or self.asked

    def observe(self, situation: Situation) -> None:
        """Odometry knows the way from where the exploration, or the odometry's epoch, began to where the camera first
        knows the map."""
        if self.pose is not None or situation.T_odom_base is None:
            return
        if self._begun is None or self._begun[0] != situation.odom_epoch:
            self._begun = situation.odom_epoch, situation.T_odom_base
        if situation.slam_state.tracked and situation.T_map_base is not None:
            self.pose = situation.T_map_base @ situation.T_odom_base.inverse() @ self._begun[1]

    def failed(self, reason: str) -> str:
        """A drive home ended elsewhere, for this reason; in words, with the number of tries."""
        self._tries, self._why = self._tries + 1, reason
        return f"home was not reached, try {self._tries} of {_MOST_TRIES}: {reason}"

    @property
    def out_of_reach(self) -> str:
        """Why not to try again; empty while there are tries left."""
        return f"home was not reached in {_MOST_TRIES} tries: {self._why}" if self._tries >= _MOST_TRIES else ""
