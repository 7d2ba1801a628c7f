"""Did the tracking hold? Breaks as the interface defines them (U1 and U2 are counted while tracking, slam/)."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.state import TrackingResult, TrackingState

MAX_JUMP_M = 0.15
MAX_JUMP_DEG = 5.0


class Break(NamedTuple):
    """Where tracking broke, and how."""

    stamp_ns: int
    reason: str


def find_breaks(
    results: Sequence[TrackingResult], reference: Sequence[SE3 | None], epochs: Sequence[int] = ()
) -> list[Break]:
    """Jumps of more than 0.15 m or 5 deg against the reference, and a loss that lasts to the end.

    results: frames in order. reference: as many camera poses by odometry (or truth), None where unknown. epochs: of
    the odometry, if it may have restarted. Only frames tracked from the map are compared, each with the tracked frame
    before it in its epoch; a jump that the map made, because a loop was closed, is none of the tracking.
    """
    breaks = []
    last: tuple[SE3, SE3 | None, int] | None = None
    for result, expected, epoch in zip(results, reference, epochs or [0] * len(results), strict=True):
        if not result.state.tracked or result.T_world_cam is None:
            continue
        comparable = last is not None and last[2] == epoch and not result.corrected
        if comparable and last is not None and last[1] is not None and expected is not None:
            jump = _jump(last[0].inverse() @ result.T_world_cam, last[1].inverse() @ expected)
            if jump:
                breaks.append(Break(result.stamp_ns, jump))
        last = result.T_world_cam, expected, epoch
    if last is not None and results[-1].state is TrackingState.LOST:
        since = list(itertools.takewhile(lambda result: result.state is TrackingState.LOST, reversed(results)))[-1]
        breaks.append(Break(since.stamp_ns, f"lost for good: {since.reason}"))
    return breaks


def _jump(moved: SE3, expected: SE3) -> str:
    """What is wrong with a motion, in words; empty when nothing is."""
    error = expected.inverse() @ moved
    metres = math.hypot(*error.translation)
    degrees = math.degrees(error.rotation_angle_to(SE3.identity()))
    if metres > MAX_JUMP_M or degrees > MAX_JUMP_DEG:
        return f"the pose jumped {metres:.2f} m and {degrees:.1f} deg against odometry"
    return ""
