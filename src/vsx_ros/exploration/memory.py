"""What a mission keeps of an interrupted run, so that it goes on instead of beginning anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2


class MissionMemory(NamedTuple):
    """looked_from: poses in the map the camera has looked from. given_up: goals in the map, and for how long yet [s].
    trail: the way the base came, seen from where it stood last, oldest first. going_home: whether it was sent home.
    home: where the exploration began, in the map; None if that was not known yet."""

    looked_from: list[SE2]
    given_up: list[tuple[SE2, float]]
    trail: list[SE2]
    going_home: bool
    home: SE2 | None

    def carried(self, since: Sequence[SE2]) -> MissionMemory:
        """The same with a longer trail: the base has since stood at these poses, seen from where it stood last."""
        if not since:
            return self
        here = since[-1].inverse()
        return self._replace(trail=[here @ pose for pose in (*self.trail, *since)])

    def tree(self) -> dict[str, Any]:
        """For a file; ``of`` reads it back."""
        return {
            "looked_from": [_row(pose) for pose in self.looked_from],
            "given_up": [[*_row(pose), seconds] for pose, seconds in self.given_up],
            "trail": [_row(pose) for pose in self.trail],
            "going_home": self.going_home,
            "home": None if self.home is None else _row(self.home),
        }

    @staticmethod
    def of(tree: Mapping[str, Any]) -> MissionMemory:
        """Raises InputError when the tree is not one of ``tree``."""
        try:
            given_up = [(_pose(row[:3]), float(row[3])) for row in tree["given_up"]]
            looked_from, trail = ([_pose(row) for row in tree[name]] for name in ("looked_from", "trail"))
            home = None if tree.get("home") is None else _pose(tree["home"])
            return MissionMemory(looked_from, given_up, trail, bool(tree["going_home"]), home)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"what the mission remembers is damaged ({error}); delete mission.json") from error


def _row(pose: SE2) -> list[float]:
    return [pose.x, pose.y, pose.theta]


def _pose(row: Any) -> SE2:
    x, y, theta = (float(value) for value in row)
    if not math.isfinite(x + y + theta):
        raise ValueError(f"pose {row} is not finite")
    return SE2(x, y, theta)
