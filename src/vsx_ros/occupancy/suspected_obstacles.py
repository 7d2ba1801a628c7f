"""Where wheels turned in vain. There may be something that no bumper feels, or the floor was only slippery."""

from collections.abc import Sequence

from vsx_ros.arrays import IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.anchored_poses import BUMP_STEP_M, BUMP_STEP_RAD, AnchoredPoses

_FIRST_NS = 20_000_000_000
"""So long the spot is left alone at first, twice as long each further time."""
_SAME_M, _SAME_RAD = 0.3, 0.8
_DRIVEN_ON_M, _BESIDE_M = 0.1, 0.1
"""Who drives so far on from where it pushed, hardly beside it, has pushed against nothing that is still there."""


class _Expiry:
    """How long a spot counts."""

    def __init__(self, now_ns: int) -> None:
        self._length_ns, self.until_ns = _FIRST_NS, now_ns + _FIRST_NS

    def renew(self, now_ns: int) -> None:
        if now_ns >= self.until_ns:
            self._length_ns *= 2
        self.until_ns = now_ns + self._length_ns


class SuspectedObstacles:
    """``pushed`` and ``moved`` as it happens; ``poses`` are those that count for now."""

    def __init__(self) -> None:
        self._spots = AnchoredPoses(BUMP_STEP_M, BUMP_STEP_RAD)
        self._expiries: list[_Expiry] = []
        self._latest: SE2 | None = None

    def pushed(self, pose: SE2, now_ns: int) -> None:
        """The base, here, faces what it pushes against. The same pose again is the same push."""
        if pose == self._latest:
            return
        self._latest = pose
        for spot, expiry in zip(self._spots.last_poses(), self._expiries, strict=True):
            if spot.distance_to(pose) < _SAME_M and abs(spot.angle_to(pose)) < _SAME_RAD:
                expiry.renew(now_ns)
                return
        self._spots.add(pose)
        self._expiries.append(_Expiry(now_ns))

    def moved(self, pose: SE2) -> None:
        """The base is here."""
        if self._expiries:
            kept = [not _driven_on(spot, pose) for spot in self._spots.last_poses()]
            self._spots.keep(kept)
            self._expiries = [expiry for expiry, keep in zip(self._expiries, kept, strict=True) if keep]

    def count(self, now_ns: int) -> int:
        """How many count."""
        return sum(now_ns < expiry.until_ns for expiry in self._expiries)

    def poses(self, now_ns: int, keyframe_ids: IntArray, T_world_cams: Sequence[SE3]) -> list[SE2]:
        """Where they are in a map of these keyframes (K,), ids ascending."""
        spots = self._spots.poses(keyframe_ids, T_world_cams)
        return [spot for spot, expiry in zip(spots, self._expiries, strict=True) if now_ns < expiry.until_ns]


def _driven_on(push: SE2, pose: SE2) -> bool:
    """Whether a base here has passed where it pushed."""
    on = push.inverse() @ pose
    return on.x > _DRIVEN_ON_M and abs(on.y) < _BESIDE_M
