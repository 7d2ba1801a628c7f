"""Breaks of the tracking: where it jumped or was finally lost, and where odometry jumped instead."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se3 import SE3, so3_log
from vsx_ros.slam.state import TrackingResult, TrackingState

_MAX_JUMP_M, _MAX_JUMP_DEG = 0.15, 5.0  # between two frames, against odometry: more is a jump, not drift
_ITS_OWN = 2.0  # odometry jumped if it leaves its own course this many times farther than the images leave theirs


class Break(NamedTuple):
    """A break of the tracking or of odometry: stamp and reason."""

    stamp_ns: int
    reason: str


class _Step(NamedTuple):
    """The motion between two tracked frames in ``seconds``: seen by the images, expected by the reference. Motions
    (6,): translation in the earlier camera [m], turn in the world, whose z is up [rad]."""

    stamp_ns: int
    seconds: float
    seen: FloatArray
    expected: FloatArray


def find_breaks(
    results: Sequence[TrackingResult], reference: Sequence[SE3 | None], epochs: Sequence[int] = ()
) -> list[Break]:
    """Jumps of more than 0.15 m or 5 deg against the reference, and a loss that lasts to the end. results: frames in
    order. reference: as many camera poses by odometry (or truth), None where unknown. epochs: of the odometry, if it
    may have restarted. Only frames tracked from the map are compared, each with the tracked frame before it in its
    epoch. A jump of the map at a loop closure and a jump of odometry do not count. Turns are compared by heading:
    odometry measures no tilt, and a drone banks."""
    breaks = [jump for jump, by_odometry in _jumps(results, reference, epochs) if not by_odometry]
    tracked = any(result.state.tracked and result.T_world_cam is not None for result in results)
    if tracked and results[-1].state is TrackingState.LOST:
        since = list(itertools.takewhile(lambda result: result.state is TrackingState.LOST, reversed(results)))[-1]
        breaks.append(Break(since.stamp_ns, f"lost for good: {since.reason}"))
    return breaks


def find_odometry_jumps(
    results: Sequence[TrackingResult], reference: Sequence[SE3 | None], epochs: Sequence[int] = ()
) -> list[Break]:
    """Such jumps where the images show a steady motion of the camera and odometry does not."""
    return [jump for jump, by_odometry in _jumps(results, reference, epochs) if by_odometry]


def _jumps(
    results: Sequence[TrackingResult], reference: Sequence[SE3 | None], epochs: Sequence[int]
) -> Iterator[tuple[Break, bool]]:
    """Every step that contradicts the reference, and whether the reference jumped and not the images."""
    steps = _steps(results, reference, epochs)
    for n, step in enumerate(steps):
        if step is None or not _contradicts(step):
            continue
        near = [other for other in (steps[n - 1] if n else None, *steps[n + 1 : n + 2]) if other is not None]
        longer = [step.seconds / other.seconds for other in near]
        seen = [_size(step.seen - times * other.seen) for times, other in zip(longer, near)]
        expected = [_size(step.expected - times * other.expected) for times, other in zip(longer, near)]
        its_own = bool(near) and all(e > max(1.0, _ITS_OWN * s) for s, e in zip(seen, expected))
        metres, degrees = _difference(step)
        apart = f"jumped {metres:.2f} m and {degrees:.1f} deg against"
        reason = f"odometry {apart} the images" if its_own else f"the pose {apart} odometry"
        yield Break(step.stamp_ns, reason), its_own


def _steps(
    results: Sequence[TrackingResult], reference: Sequence[SE3 | None], epochs: Sequence[int]
) -> list[_Step | None]:
    """One step per tracked frame except the first, None if it cannot be compared with the reference."""
    known = zip(results, reference, epochs or [0] * len(results), strict=True)
    tracked = [frame for frame in known if frame[0].state.tracked and frame[0].T_world_cam is not None]
    steps: list[_Step | None] = []
    for (before, T, epoch), (now, S, next_epoch) in itertools.pairwise(tracked):
        if T is None or S is None or epoch != next_epoch or now.corrected:
            steps.append(None)
            continue
        assert before.T_world_cam is not None
        assert now.T_world_cam is not None
        motions = _motion(before.T_world_cam, now.T_world_cam), _motion(T, S)
        steps.append(_Step(now.stamp_ns, (now.stamp_ns - before.stamp_ns) * 1e-9, *motions))
    return steps


def _motion(before: SE3, now: SE3) -> FloatArray:
    way = (before.inverse() @ now).translation
    return np.concatenate([way, so3_log(now.rotation @ before.rotation.T)])


def _contradicts(step: _Step) -> bool:
    metres, degrees = _difference(step)
    return metres > _MAX_JUMP_M or degrees > _MAX_JUMP_DEG


def _difference(step: _Step) -> tuple[float, float]:
    """Differences of translation [m] and heading [deg]: odometry measures no tilt."""
    off = step.seen - step.expected
    return math.hypot(*off[:3]), math.degrees(abs(off[5]))


def _size(off: FloatArray) -> float:
    """The size of a difference of motions, in multiples of the limits for a jump."""
    return max(math.hypot(*off[:3]) / _MAX_JUMP_M, math.degrees(abs(off[5])) / _MAX_JUMP_DEG)
