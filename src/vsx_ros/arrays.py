"""Names for the array shapes that packages exchange. Plain ndarrays; the name tells shape, dtype and unit."""

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]  # Float64 array of any shape; the docstring of the user says which

IntArray: TypeAlias = NDArray[np.int64]
"""Int64 array of any shape: indices, labels, counts. Most compiled loops accept only this integer type."""

Int32Array: TypeAlias = NDArray[np.int32]  # Counts of cells and fixed-point values, any shape

Float32Array: TypeAlias = NDArray[np.float32]
"""Float32 array of any shape, where half the memory or twice the vector width matters."""

BoolArray: TypeAlias = NDArray[np.bool_]  # Mask of any shape

GrayImage: TypeAlias = NDArray[np.uint8]  # (H, W) uint8, row 0 at the top

ColorImage: TypeAlias = NDArray[np.uint8]  # (H, W, 3) uint8, OpenCV's BGR order

Points2: TypeAlias = NDArray[np.float64]  # (N, 2) metres

Points3: TypeAlias = NDArray[np.float64]  # (N, 3) metres, in the frame its name ends with (points_world, points_cam)

Pixels: TypeAlias = NDArray[np.float64]  # (N, 2) pixels (u right, v down); integer coordinates are pixel centres


def array_bytes(parts: Iterable[object]) -> int:
    """Size of the arrays among the parts, and in tuples among them [bytes]."""
    return sum(
        part.nbytes if isinstance(part, np.ndarray) else array_bytes(part) if isinstance(part, tuple) else 0
        for part in parts
    )
