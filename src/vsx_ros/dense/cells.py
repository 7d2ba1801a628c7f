"""The cells of all surfaces, and why each is believed."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.dense.region_growing import Contact


class CellKind(IntEnum):
    """Why a cell is believed. SEED: map points lie in it. PHOTO: several keyframes show the same picture there.
    CONTACT: the wall meets the floor below it. ENCLOSED: believed cells surround it."""

    SEED = 0
    PHOTO = 1
    CONTACT = 2
    ENCLOSED = 3


class Cells(NamedTuple):
    """plane (N,): ids of planes. cell (N, 2): right and up, in cells of the plane's grid, whose origin is that of the
    coordinates (cell i covers [i, i + 1) times its size). centre (N, 3): world [m]. kind (N,): CellKind. score (N,): 0
    to 1. keyframe (N,): index in the snapshot's rays of the reference keyframe it was judged in. witnesses (N, W):
    indices of keyframes that show the floor at its foot, for the lowest cells of a wall; -1 for the rest."""

    plane: NDArray[np.int64]
    cell: NDArray[np.int64]
    centre: Points3
    kind: NDArray[np.int64]
    score: FloatArray
    keyframe: NDArray[np.int64]
    witnesses: NDArray[np.int64]

    @staticmethod
    def concatenated(parts: list[Cells]) -> Cells:
        """All parts in order."""
        none = np.zeros(0, np.int64)
        first = Cells(
            plane=none,
            cell=np.zeros((0, 2), np.int64),
            centre=np.zeros((0, 3)),
            kind=none,
            score=np.zeros(0),
            keyframe=none,
            witnesses=Contact.none(0).witnesses,
        )
        return Cells._make(np.concatenate(columns) for columns in zip(first, *parts))
