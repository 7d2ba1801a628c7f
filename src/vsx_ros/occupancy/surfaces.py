"""Pieces of obstacle surface that the ground map takes beside the SLAM's points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3


class Surfaces(NamedTuple):
    """points (N, 3): spots of surface, world [m], no further apart than a cell of the map where the surface is whole.
    keyframe (N,): index of the keyframe that sees each. sigma_m (N,): how uncertain its distance from there is [m]."""

    points: Points3
    keyframe: IntArray
    sigma_m: FloatArray

    @staticmethod
    def none() -> Surfaces:
        """No surface."""
        return Surfaces(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0))
