"""Blacklist of failed goals: left alone for a while, longer each time, never for good while there is nothing else to
do."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.geometry.se2 import SE2

_SECOND_NS = 1_000_000_000
_NEAR_RAD = 0.8
_MOST_FAILURES = 3
_MOST_DOUBLINGS = 7


class _Failure(NamedTuple):
    """A goal, until when it is left alone and how often it has failed."""

    pose: SE2
    until_ns: int
    times: int


class GoalBlacklist:
    """Failed goals stand for all poses within radius_m [m]; the first failure counts for first_s [s]."""

    def __init__(self, radius_m: float, first_s: float) -> None:
        self._radius_m = radius_m
        self._first_s = first_s
        self._failures: list[_Failure] = []

    def add(self, now_ns: int, pose: SE2) -> float:
        """Leave the goal alone from now on; for how long [s]: twice as long as the last time it failed, up to
        128 times as long as the first."""
        same = [f for f in self._failures if near_poses(pose.as_array()[None], [f.pose], self._radius_m, _NEAR_RAD)[0]]
        times = 1 + max((failure.times for failure in same), default=0)
        seconds = self._first_s * 2.0 ** min(times - 1, _MOST_DOUBLINGS)
        self._failures.append(_Failure(pose, now_ns + int(seconds * _SECOND_NS), times))
        return seconds

    def near(self, now_ns: int, poses: FloatArray) -> BoolArray:
        """(N,) which of the poses (N, 3) are left alone now."""
        left = [failure.pose for failure in self._failures if failure.until_ns > now_ns]
        return near_poses(poses, left, self._radius_m, _NEAR_RAD)

    def release(self, now_ns: int) -> int:
        """Let what has not failed too often be tried again at once; how many goals that are."""
        kept = [f for f in self._failures if f.until_ns > now_ns and f.times < _MOST_FAILURES]
        self._failures = [f._replace(until_ns=now_ns) if f in kept else f for f in self._failures]
        return len(kept)

    def left(self, now_ns: int) -> list[tuple[SE2, float, int]]:
        """The goals that failed, for how long yet each is left alone [s] (0: no longer), and how often it failed."""
        return [(f.pose, max(f.until_ns - now_ns, 0) / _SECOND_NS, f.times) for f in self._failures]

    def restore(self, now_ns: int, left: Sequence[tuple[SE2, float, int]]) -> None:
        """Take over what ``left`` said before an interruption."""
        self._failures = [_Failure(pose, now_ns + int(seconds * _SECOND_NS), times) for pose, seconds, times in left]


def near_poses(poses: FloatArray, others: Sequence[SE2], radius_m: float, angle: float) -> BoolArray:
    """(N,) which of the poses (N, 3) lie within radius [m] and angle [rad] of any of the others."""
    near = np.zeros(len(poses), np.bool_)
    if len(poses) and others:
        rest = np.array([other.as_array() for other in others])
        pairs = cKDTree(poses[:, :2]).sparse_distance_matrix(cKDTree(rest[:, :2]), radius_m, output_type="ndarray")
        turn = (poses[pairs["i"], 2] - rest[pairs["j"], 2] + np.pi) % (2 * np.pi) - np.pi
        near[pairs["i"][(pairs["v"] < radius_m) & (np.abs(turn) < angle)]] = True
    return near
