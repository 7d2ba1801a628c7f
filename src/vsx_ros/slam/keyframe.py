"""The parts of a map: preprocessed images, keyframes and observations of points, and a view of all at one instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels, Points3, array_bytes
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.lens import CAMERA
from vsx_ros.kernels.vision.patches import Target
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.templates import Templates
from vsx_ros.vision.corners import Corners, PackedCorners, no_corners
from vsx_ros.vision.patch_search import target_of
from vsx_ros.vision.pyramid import LEVELS, CompressedPyramid, Pyramid, SmallImage, small_image

_ENOUGH_DEPTHS = 5  # least points for a median depth
ROOM_DEPTH_M = 2.5  # median scene depth in a room; thresholds in metres are chosen for it
HANGS = "the camera hangs"  # why nothing is searched in a frozen image


class Observations(NamedTuple):
    """Points seen by one keyframe: rows (n,) in the map, uv (n, 2) level-0 px as in the image, ideal (n, 2) px without
    distortion, level (n,). Those of a culled keyframe have no pixels: uv and ideal are (0, 2)."""

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
        """All parts in one, in order."""
        return Observations(*(np.concatenate(column) for column in zip(Observations.none(), *parts)))

    def where(self, mask: BoolArray) -> Observations:
        """The observations where the mask (n,) is set."""
        return Observations._make(column[mask[: len(column)]] for column in self)

    def without_pixels(self) -> Observations:
        """Only which points were seen, and at which level."""
        return self._replace(uv=np.zeros((0, 2)), ideal=np.zeros((0, 2)))

    def renamed(self, becomes: IntArray) -> Observations:
        """The observations of other rows: becomes (P,) gives the new row of each. If a keyframe saw the new row itself,
        only that observation is kept."""
        rows = becomes[self.rows]
        order = np.argsort(rows != self.rows, kind="stable")
        kept = np.zeros(len(rows), np.bool_)
        kept[order[np.unique(rows[order], return_index=True)[1]]] = True
        return self._replace(rows=rows).where(kept)


class FrameData(NamedTuple):
    """A preprocessed image for tracker, mapper and relocaliser. image, corners: compressed where the camera has not
    been for long. camera (CAMERA,): the kernels' array, with the motion during readout. T_odom_base: by odometry at the
    exposure of the middle row, None when unknown. blurred: much less sharp than the frames before; good enough to
    track, not to map. frozen: the last image again though the base has moved; it shows nothing of now."""

    stamp_ns: int
    image: Pyramid | CompressedPyramid
    corners: Corners | PackedCorners
    small: SmallImage
    T_odom_base: SE2 | None
    camera: FloatArray
    blurred: bool = False
    frozen: bool = False

    def compressed(self) -> FrameData:
        """The same in a fifth of the memory, and as a map that is saved and loaded gives it back."""
        if isinstance(self.image, CompressedPyramid) and self.image.is_small:
            return self
        image, corners = CompressedPyramid.of(self.pyramid), PackedCorners.of(self.corners, self.pyramid.table)
        return self._replace(image=image, corners=corners, small=small_image(image.pyramid))

    @property
    def pyramid(self) -> Pyramid:
        """The image at all levels."""
        return self.image if isinstance(self.image, Pyramid) else self.image.pyramid

    @property
    def target(self) -> Target:
        """The image in the form that kernels search."""
        return target_of(self.pyramid, self.corners)

    @staticmethod
    def without_image(stamp_ns: int, T_odom_base: SE2 | None) -> FrameData:
        """A frame with only stamp and odometry."""
        nothing = Pyramid(np.zeros(0, np.uint8), np.zeros((LEVELS, 4), np.int64))
        return FrameData(
            stamp_ns=stamp_ns,
            image=nothing,
            corners=no_corners(nothing),
            small=np.zeros((0, 0), np.float32),
            T_odom_base=T_odom_base,
            camera=np.zeros(CAMERA),
        )


@dataclass(frozen=True, slots=True, eq=False)
class KeyFrame:
    """A keyframe of the map. Replaced, never changed.

    odom_segment: odometry connects successive living keyframes of one segment, never of two segments. A culled keyframe
    has an anchor and no image; its pose belongs to the templates cut from it and to the rays to what it saw. map_id: 0
    is the first map, whose frame is the world. Other maps begin where the first is out of sight; each has its own frame
    until it is joined with the first. scale: the present length of what had length 1 when the keyframe was made."""

    id: int
    data: FrameData
    T_world_cam: SE3
    observations: Observations
    median_depth: float
    odom_segment: int = 0
    anchor: Anchor | None = None
    map_id: int = 0
    scale: float = 1.0

    @property
    def alive(self) -> bool:
        """Whether it is not culled: only then is it ranked, searched and adjusted."""
        return self.anchor is None

    def depth_of(self, points_world: Points3) -> float:
        """Median depth of the points (P, 3) seen that lie in front of it. With fewer than 5 it is that of before: if
        the pose is wrong, points may lie behind the camera."""
        R, t = self.T_world_cam.rotation, self.T_world_cam.translation
        depths = (points_world[self.observations.rows] - t) @ R[:, 2]
        depths = depths[depths > 0.0]
        return float(np.median(depths)) if len(depths) >= _ENOUGH_DEPTHS else self.median_depth


class Unit(NamedTuple):
    """Unit of length of a map. metre: length of a metre in it; without odometry, estimated as if the scene had the
    depth of a room. word: name for users."""

    metre: float
    word: str


METRIC = Unit(1.0, "m")


def is_metric(keyframes: Sequence[KeyFrame], map_id: int) -> bool:
    """Whether the given map began with odometry; then it is metric and level. True before it begins."""
    first = next((keyframe for keyframe in keyframes if keyframe.map_id == map_id), None)
    return first is None or first.data.T_odom_base is not None


def unit_of(keyframes: Sequence[KeyFrame], *indices: int) -> Unit:
    """Unit of the map around some keyframes: metric if the map is and all of these have odometry."""
    near = [keyframes[k] for k in indices]
    if is_metric(keyframes, near[0].map_id) and all(k.data.T_odom_base is not None for k in near):
        return METRIC
    return Unit(max(near[0].median_depth, 1e-6) / ROOM_DEPTH_M, "units of the map")


class MapView(NamedTuple):
    """The map at one instant, for the tracker. living (L,): indices of the keyframes that are not culled; depths (K,):
    median scene depths of all keyframes, 1 where unknown. points (P, 3) world, alive (P,), source (P,): keyframe each
    was made in. Indices and rows never change their meaning."""

    version: int
    keyframes: tuple[KeyFrame, ...]
    living: IntArray
    R_world_cam: FloatArray
    centres: Points3
    depths: FloatArray
    points: Points3
    alive: BoolArray
    source: IntArray
    templates: Templates

    @property
    def nbytes(self) -> int:
        """Size of the map's arrays, images included [bytes]."""
        return array_bytes(self) + sum(array_bytes((k.data, k.observations)) for k in self.keyframes)

    def part(self, map_id: int) -> MapView:
        """The same view with only the living keyframes of one map."""
        inside = np.array([self.keyframes[int(k)].map_id == map_id for k in self.living], np.bool_)
        return self._replace(living=self.living[inside])
