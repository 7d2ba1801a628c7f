"""Places where the base's wheels turned without effect, active for a while each."""

from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

from vsx_ros.arrays import IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.anchored_poses import BUMP_STEP_M, BUMP_STEP_RAD, AnchoredPoses

_FIRST_NS = 20_000_000_000
"""How long a spot is avoided at first where wheels turned without effect; twice as long each time it happens again."""
_SAME_M, _SAME_RAD = 0.3, 0.8  # a push within this distance is at the same spot
_DRIVEN_ON_M, _BESIDE_M = (0.1, 0.3), 0.1
"""If the base stands this far ahead of a push, hardly to its side, the suspected obstacle is not there. Farther ahead,
it may have come around the obstacle."""


class _Expiry(NamedTuple):
    """Until when a spot is active, and the length of its last period."""

    until_ns: int
    length_ns: int


class SuspectedObstacles:
    """Places with an obstacle that no bumper feels, or only a slippery floor. Call ``pushed`` and ``moved`` when they
    happen; ``poses`` are those active now."""

    def __init__(self) -> None:
        self._spots = AnchoredPoses(BUMP_STEP_M, BUMP_STEP_RAD)
        self._expiries: list[_Expiry] = []
        self._latest: SE2 | None = None

    def pushed(self, pose: SE2, now_ns: int) -> None:
        """The base pushes against something ahead of this pose. The same pose again is the same push."""
        if pose == self._latest:
            return
        self._latest = pose
        for k, spot in enumerate(self._spots.last_poses()):
            if spot.distance_to(pose) < _SAME_M and abs(spot.angle_to(pose)) < _SAME_RAD:
                until_ns, length_ns = self._expiries[k]
                length_ns *= 1 if now_ns < until_ns else 2
                self._expiries[k] = _Expiry(now_ns + length_ns, length_ns)
                return
        self._spots.add(pose)
        self._expiries.append(_Expiry(now_ns + _FIRST_NS, _FIRST_NS))

    def moved(self, pose: SE2) -> None:
        """The base is here; removes spots where it now stands in place of the obstacle."""
        if self._expiries:
            kept = [not _driven_on(spot, pose) for spot in self._spots.last_poses()]
            self._spots.keep(kept)
            self._expiries = list(compress(self._expiries, kept))

    def count(self, now_ns: int) -> int:
        """How many are active."""
        return sum(now_ns < expiry.until_ns for expiry in self._expiries)

    def poses(self, now_ns: int, keyframe_ids: IntArray, T_world_cams: Sequence[SE3]) -> list[SE2]:
        """The active spots in a map of these keyframes (K,), ids ascending."""
        spots = self._spots.poses(keyframe_ids, T_world_cams)
        return [spot for spot, expiry in zip(spots, self._expiries, strict=True) if now_ns < expiry.until_ns]


def _driven_on(push: SE2, pose: SE2) -> bool:
    """Whether a base at ``pose`` has driven on from the push, through the place of the obstacle."""
    on = push.inverse() @ pose
    least_m, most_m = _DRIVEN_ON_M
    return least_m < on.x < most_m and abs(on.y) < _BESIDE_M
