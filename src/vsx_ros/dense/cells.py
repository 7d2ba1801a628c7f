"""Parts of planes that belong to the building: cells of a grid on each plane, and why they are believed."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points3


class CellKind(IntEnum):
    """Why a cell is believed. SEED: map points lie in it. PHOTO: several keyframes show the same picture there.
    CONTACT: the wall meets the floor below it. ENCLOSED: believed cells surround it."""

    SEED = 0
    PHOTO = 1
    CONTACT = 2
    ENCLOSED = 3


class Cells(NamedTuple):
    """plane (N,): ids of planes. cell (N, 2): right and up, in cells of the plane's grid, whose origin is the
    coordinates' origin (cell i covers [i, i + 1) times its size). centre (N, 3): world [m]. kind (N,): CellKind.
    score (N,): 0 to 1. keyframe (N,): index, in the snapshot, of the reference keyframe it was judged in."""

    plane: NDArray[np.int64]
    cell: NDArray[np.int64]
    centre: Points3
    kind: NDArray[np.int64]
    score: FloatArray
    keyframe: NDArray[np.int64]

    @staticmethod
    def none() -> Cells:
        """No cell."""
        none = np.zeros(0, np.int64)
        return Cells(none, np.zeros((0, 2), np.int64), np.zeros((0, 3)), none, np.zeros(0), none)

    @staticmethod
    def concatenated(parts: list[Cells]) -> Cells:
        """All of them in one, in order."""
        return Cells(*(np.concatenate(columns) for columns in zip(Cells.none(), *parts)))
