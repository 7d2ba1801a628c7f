"""What a mission keeps of an interrupted run, so that it goes on instead of beginning anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2

_FAILURE_COLUMNS = 5  # older versions kept four, and not how often


class SavedMission(NamedTuple):
    """looked_from: poses in the map the camera has looked from. blacklist: goals in the map that failed, for how long
    yet they are left alone [s], and how often they failed. trail: the way the base came, seen from where it stood last,
    oldest first. going_home: whether it was sent home. home: where the exploration began, in the map; None if that was
    not known yet. paused: whether the operator had it wait."""

    looked_from: list[SE2]
    blacklist: list[tuple[SE2, float, int]]
    trail: list[SE2]
    going_home: bool
    home: SE2 | None
    paused: bool = False

    def carried(self, since: Sequence[SE2]) -> SavedMission:
        """The same with a longer trail: the base has since stood at these poses, seen from where it stood last."""
        if not since:
            return self
        here = since[-1].inverse()
        return self._replace(trail=[here @ pose for pose in (*self.trail, *since)])

    def moved(self) -> SavedMission:
        """The same for a base that stands elsewhere by now: the way it came is not behind it."""
        return self._replace(trail=[])

    def tree(self) -> dict[str, Any]:
        """For a file; ``of`` reads it back."""
        return {
            "looked_from": [_row(pose) for pose in self.looked_from],
            "given_up": [[*_row(pose), seconds, times] for pose, seconds, times in self.blacklist],
            "trail": [_row(pose) for pose in self.trail],
            "going_home": self.going_home,
            "home": None if self.home is None else _row(self.home),
            "paused": self.paused,
        }

    @staticmethod
    def of(tree: Mapping[str, Any], path: Path) -> SavedMission:
        """Raises InputError when the tree, of this file, is not one of ``tree``, of this version or one before."""
        try:
            blacklist = [_failure(row) for row in tree["given_up"]]
            looked_from, trail = ([_pose(row) for row in tree[name]] for name in ("looked_from", "trail"))
            home = None if tree.get("home") is None else _pose(tree["home"])
            asked = bool(tree["going_home"]), home, bool(tree.get("paused"))
            return SavedMission(looked_from, blacklist, trail, *asked)
        except (KeyError, OverflowError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path} holds no memory of a mission ({error}); start a new run") from error


def _row(pose: SE2) -> list[float]:
    return [pose.x, pose.y, pose.theta]


def _failure(row: Any) -> tuple[SE2, float, int]:
    *pose, seconds, times = row if len(row) == _FAILURE_COLUMNS else [*row, 1]
    return _pose(pose), float(seconds), int(times)


def _pose(row: Any) -> SE2:
    x, y, theta = (float(value) for value in row)
    if not math.isfinite(x + y + theta):
        raise ValueError(f"pose {row} is not finite")
    return SE2(x, y, theta)
