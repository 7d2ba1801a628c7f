"""The map as everybody but the mapper sees it: at one instant, never changing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.slam.keyframe import KeyFrame
from vsx_ros.slam.templates import Templates


class MapView(NamedTuple):
    """The map at one instant, for the tracker. living (L,): indices of the keyframes that are not culled; depths (K,):
    their median scene depths, 1 where unknown. points (P, 3) world, alive (P,), source (P,): keyframe they were made
    in. Indices and rows never change meaning."""

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

    def part(self, map_id: int) -> MapView:
        """The same with the keyframes of one map alone among the living."""
        inside = np.array([self.keyframes[int(k)].map_id == map_id for k in self.living], np.bool_)
        return self._replace(living=self.living[inside])
