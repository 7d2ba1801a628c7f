"""Breaks of the tracking: where it jumped or was finally lost, and where odometry jumped instead."""

from array import array
from collections.abc import Iterable, Iterator
from itertools import repeat
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.geometry.se3 import SE3, StampedPoses, so3_log
from vsx_ros.slam.state import TrackingResult

_MAX_JUMP_M, _MAX_JUMP_DEG = 0.15, 5.0  # between two frames, against odometry: more is a jump, not drift
_ITS_OWN = 2.0  # odometry jumped if it leaves its own course this many times farther than the images leave theirs


class Break(NamedTuple):
    """A break of the tracking or of odometry: stamp and reason."""

    stamp_ns: int
    reason: str


class Continuity(NamedTuple):
    """What ``continuity`` finds: breaks of the tracking, and where odometry jumped instead."""

    breaks: list[Break]
    odometry_jumps: list[Break]


def continuity(
    results: Iterable[TrackingResult], reference: Iterable[SE3 | None], epochs: Iterable[int] = ()
) -> Continuity:
    """Breaks: jumps of more than 0.15 m or 5 deg against the reference, and a loss that lasts to the end, also of a map
    that was given up and not begun again. Odometry jumps: such jumps where the images show a steady motion of the
    camera and odometry does not. results: frames in order. reference: as many camera poses by odometry (or truth), None
    where unknown. epochs: of the odometry, if it may have restarted. Only frames tracked from the map are compared,
    each with the tracked frame before it in its epoch. A jump of the map at a loop closure does not count. Turns are
    compared by heading: odometry measures no tilt, and a drone banks. Raises ValueError where the frames beside a jump
    have one stamp."""
    pairs = zip(results, reference, strict=True)
    lost: TrackingResult | None = None
    frames, expected, facts = StampedPoses(), StampedPoses(), array("q")
    for (result, T), epoch in zip(pairs, epochs, strict=True) if epochs else zip(pairs, repeat(0)):
        lost = None if result.state.tracked else lost or result
        if result.state.tracked and result.T_world_cam is not None:
            frames.append(result.stamp_ns, result.T_world_cam)
            expected.append(result.stamp_ns, T or SE3.identity())
            facts.extend((T is not None, epoch, result.corrected))
    jumps = list(_jumps(frames, expected, np.array(facts, np.int64).reshape(-1, 3)))
    breaks = [jump for jump, by_odometry in jumps if not by_odometry]
    if lost is not None and frames:
        breaks.append(Break(lost.stamp_ns, f"lost for good: {lost.reason}"))
    return Continuity(breaks, [jump for jump, by_odometry in jumps if by_odometry])


def _jumps(frames: StampedPoses, reference: StampedPoses, facts: IntArray) -> Iterator[tuple[Break, bool]]:
    """Every step of the tracked frames that contradicts the reference, and whether the reference jumped and not the
    images. facts (N, 3): whether the frame has a reference, the epoch of that, whether the map was corrected."""
    if len(frames) < 2:
        return
    stamps_ns = frames.stamps_ns
    has, epoch, corrected = facts[:, 0] > 0, facts[:, 1], facts[1:, 2] > 0
    compared = has[:-1] & has[1:] & (epoch[:-1] == epoch[1:]) & ~corrected
    seen, expected = _motions(frames), _motions(reference)
    seconds, off = 1e-9 * np.diff(stamps_ns), seen - expected
    for n in np.flatnonzero(compared & (_sizes(off) > 1.0)).tolist():
        near: IntArray = np.array([k for k in (n - 1, n + 1) if 0 <= k < len(compared) and compared[k]], np.int64)
        if (seconds[near] <= 0.0).any():
            raise ValueError(f"two frames have one stamp near {stamps_ns[n]} ns")
        longer = (seconds[n] / seconds[near])[:, None]
        images, wheels = (_sizes(of[n] - longer * of[near]) for of in (seen, expected))
        its_own = bool(len(near)) and bool((wheels > np.maximum(1.0, _ITS_OWN * images)).all())
        apart = f"jumped {np.linalg.norm(off[n, :3]):.2f} m and {abs(np.degrees(off[n, 3])):.1f} deg against"
        reason = f"odometry {apart} the images" if its_own else f"the pose {apart} odometry"
        yield Break(int(stamps_ns[n + 1]), reason), its_own


def _motions(poses: StampedPoses) -> FloatArray:
    """(N - 1, 4) motions between poses: translation in the earlier camera [m], turn about the world's z [rad]."""
    R, t = poses.stacked()
    way = np.einsum("nji,nj->ni", R[:-1], np.diff(t, axis=0))
    turn = R[1:] @ R[:-1].transpose(0, 2, 1)
    w = 0.5 * np.sqrt(np.maximum(1.0 + np.trace(turn, axis1=1, axis2=2), 1.0))
    x, y, z = ((turn[:, i, j] - turn[:, j, i]) / (4.0 * w) for i, j in ((2, 1), (0, 2), (1, 0)))
    size = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12)
    heading = 2.0 * np.arctan2(size, w) / size * z
    for wide in np.flatnonzero(np.trace(turn, axis1=1, axis2=2) < 0.0).tolist():  # above w is of smaller turns
        heading[wide] = so3_log(turn[wide])[2]
    return np.column_stack([way, heading])


def _sizes(off: FloatArray) -> FloatArray:
    """(N,) sizes of differences of motions (N, 4), in multiples of the limits for a jump."""
    metres, degrees = np.linalg.norm(off[:, :3], axis=1), np.degrees(np.abs(off[:, 3]))
    return np.asarray(np.maximum(metres / _MAX_JUMP_M, degrees / _MAX_JUMP_DEG))
