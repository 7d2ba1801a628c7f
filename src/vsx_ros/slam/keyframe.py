"""What the map is made of: an image taken apart, the keyframe it becomes, and the points seen in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.vision.corners import Corners
from vsx_ros.vision.pyramid import LEVELS, Pyramid
from vsx_ros.vision.small_image import SmallImage


class Observations(NamedTuple):
    """Points seen by one keyframe: rows (n,) in the map, uv (n, 2) level-0 px as in the image, ideal (n, 2) px without
    distortion, level (n,)."""

    rows: NDArray[np.int64]
    uv: Pixels
    ideal: Pixels
    level: NDArray[np.int64]

    @staticmethod
    def none() -> Observations:
        """No observation."""
        return Observations(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64))

    @staticmethod
    def concatenated(parts: list[Observations]) -> Observations:
        """All of them in one, in order."""
        return Observations(*(np.concatenate(column) for column in zip(Observations.none(), *parts)))

    def where(self, mask: BoolArray) -> Observations:
        """Those the mask (n,) keeps."""
        return Observations._make(column[mask] for column in self)


class FrameData(NamedTuple):
    """An image taken apart once, used by tracker, mapper and relocaliser. camera (18,): the kernels' array, with
    the motion during its readout. T_odom_base: by odometry when its middle row was exposed, None when not known.
    blurred: much less sharp than the frames before; good enough to track, not to make a map of."""

    stamp_ns: int
    pyramid: Pyramid
    corners: Corners
    small: SmallImage
    T_odom_base: SE2 | None
    camera: FloatArray
    blurred: bool = False

    @staticmethod
    def without_image(stamp_ns: int, T_odom_base: SE2 | None) -> FrameData:
        """The instant and odometry alone."""
        nothing = Pyramid(np.zeros(0, np.uint8), np.zeros((LEVELS, 4), np.int64))
        no_corners = Corners(np.zeros((0, 2), np.int32), np.zeros(0, np.int64), (0,) * LEVELS)
        return FrameData(stamp_ns, nothing, no_corners, np.zeros((0, 0), np.float32), T_odom_base, np.zeros(18))


class Anchor(NamedTuple):
    """What carries a culled keyframe: the index of a living one, and the culled one's pose in its camera."""

    keyframe: int
    T_keyframe_this: SE3


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A frame the map is made of. Replaced, never changed.

    odom_epoch: odometry tells the way between successive living keyframes of one epoch, never between two. A culled
    keyframe has an anchor, no image and no observations; its pose is still that of the templates cut from it. map_id:
    0 is the first map, whose frame is the world; others, begun where the first was out of sight, have frames of their
    own until they are joined with it. scale: the length now of what was 1 when the keyframe was made.
    """

    id: int
    data: FrameData
    T_world_cam: SE3
    observations: Observations
    median_depth: float
    odom_epoch: int = 0
    anchor: Anchor | None = None
    map_id: int = 0
    scale: float = 1.0

    @property
    def alive(self) -> bool:
        """Whether it is still part of what is ranked, searched and adjusted."""
        return self.anchor is None


class PointObservers:
    """Who may have seen which points: keyframe indices by blocks of successive rows, which are of one place. Asking
    costs as much as there are keyframes at that place, however large the map is."""

    BLOCK_BITS = 6

    def __init__(self) -> None:
        self._of_block: dict[int, set[int]] = {}

    def add(self, index: int, rows: IntArray) -> None:
        """Keyframe ``index`` sees the points (rows)."""
        for block in np.unique(rows >> self.BLOCK_BITS).tolist():
            self._of_block.setdefault(block, set()).add(index)

    def of(self, rows: IntArray) -> list[int]:
        """Every keyframe that has seen any of the points (rows), ascending, and some that have not."""
        found: set[int] = set()
        for block in np.unique(rows >> self.BLOCK_BITS).tolist():
            found |= self._of_block.get(block, set())
        return sorted(found)
