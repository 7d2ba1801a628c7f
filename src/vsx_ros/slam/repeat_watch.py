"""Whether the camera shows the same image again and again while the base moves."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.vision.pyramid import LEVELS, Pyramid

# A base that has moved less than this since an image stands still. If it stops in between, extrapolation of odometry
# to the image's middle row can err by as much.
STILL_M, STILL_RAD = 0.006, 0.01
DRIFT_M_S, DRIFT_RAD_S = 0.002, 0.002  # slower is drift of the odometry of a base that stands


class _Seen(NamedTuple):
    """An image, and T_odom_base with its epoch. moved: by so much since the same image came first. repeats: what was
    said of it."""

    stamp_ns: int
    image: Pyramid
    where: tuple[SE2, int]
    moved: SE2 = SE2()
    repeats: bool = False


class RepeatWatch:
    """``see`` one image after the other: whether it equals the ones before to the bit though the base has moved since
    the first of them. Noise makes live images differ; a simulated camera without noise repeats its image while the base
    stands, also if odometry drifts meanwhile. Where there is no light, the camera may be well and yet shows nothing."""

    def __init__(self) -> None:
        self._last: _Seen | None = None

    def see(self, stamp_ns: int, image: Pyramid, where: tuple[SE2, int] | None) -> bool:
        """where: T_odom_base at the image and the epoch of that odometry; if unknown, the next image is a first one."""
        if where is None:
            self._last = None
            return False
        last, self._last = self._last, _Seen(stamp_ns, image, where)
        if last is None or not _are_equal(last.image, image):
            return False
        (before, epoch), (now, now_epoch) = last.where, where
        elapsed_s, step = 1e-9 * (stamp_ns - last.stamp_ns), before.inverse() @ now
        drifts = _is_near(step, DRIFT_M_S * elapsed_s, DRIFT_RAD_S * elapsed_s)
        moved = last.moved if drifts or epoch != now_epoch else last.moved @ step
        repeats = last.repeats or not _is_near(moved, STILL_M, STILL_RAD)
        self._last = _Seen(stamp_ns, image, where, moved=moved, repeats=repeats)
        return repeats


def _is_near(motion: SE2, distance_m: float, angle_rad: float) -> bool:
    return math.hypot(motion.x, motion.y) < distance_m and abs(wrap_angle(motion.theta)) < angle_rad


def _are_equal(one: Pyramid, other: Pyramid) -> bool:
    """Comparing the coarsest level is almost always enough, in a fraction of the time."""
    coarse = LEVELS - 1
    return np.array_equal(one.level(coarse), other.level(coarse)) and np.array_equal(one.pixels, other.pixels)
