"""Names for the array shapes that packages exchange; the name tells shape, dtype and unit. Plain ndarrays, their size,
and one block of memory for many."""

from collections.abc import Iterable
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

_ALIGNED_BYTES = 64  # a line of the cache

Parts = TypeVar("Parts", bound=tuple[Any, ...])
Entry = TypeVar("Entry", bound=np.generic)

FloatArray: TypeAlias = NDArray[np.float64]  # Float64 array of any shape; the docstring of the user says which

IntArray: TypeAlias = NDArray[np.int64]
"""Int64 array of any shape: indices, labels, counts. Most compiled loops accept only this integer type."""

Int32Array: TypeAlias = NDArray[np.int32]  # Counts of cells, fixed-point values and many indices, any shape

Indices: TypeAlias = NDArray[np.integer[Any]]  # Integers of any width, where the callee converts them

Float32Array: TypeAlias = NDArray[np.float32]
"""Float32 array of any shape, where half the memory or twice the vector width matters."""

BoolArray: TypeAlias = NDArray[np.bool_]  # Mask of any shape

GrayImage: TypeAlias = NDArray[np.uint8]  # (H, W) uint8, row 0 at the top

ColorImage: TypeAlias = NDArray[np.uint8]  # (H, W, 3) uint8, OpenCV's BGR order

Points2: TypeAlias = NDArray[np.float64]  # (N, 2) metres

Points3: TypeAlias = NDArray[np.float64]  # (N, 3) metres, in the frame its name ends with (points_world, points_cam)

Pixels: TypeAlias = NDArray[np.float64]  # (N, 2) pixels (u right, v down); integer coordinates are pixel centres


def array_bytes(parts: Iterable[object]) -> int:
    """Size of the arrays and bytes among the parts, and in tuples among them [bytes]."""
    return sum(map(_bytes_of, parts))


def _bytes_of(part: object) -> int:
    if isinstance(part, tuple):
        return array_bytes(part)
    return part.nbytes if isinstance(part, np.ndarray) else len(part) if isinstance(part, bytes) else 0


def grown(rows: NDArray[Entry], needed: int) -> NDArray[Entry]:
    """The array, or a copy of at least twice the length when it has fewer than ``needed`` rows. What is not used yet
    takes no memory."""
    if needed <= len(rows):
        return rows
    longer = np.zeros((max(needed, 2 * len(rows)), *rows.shape[1:]), rows.dtype)
    longer[: len(rows)] = rows
    return longer


class GrowingArray(Generic[Entry]):
    """An array to which rows are appended. Appending costs as much as what is appended, not as what is there."""

    def __init__(self, rows: NDArray[Entry]) -> None:
        self._stored, self._count = rows, len(rows)

    @property
    def rows(self) -> NDArray[Entry]:
        """All rows so far."""
        return self._stored[: self._count]

    def append(self, more: NDArray[Entry]) -> None:
        """Add rows at the end."""
        first, self._count = self._count, self._count + len(more)
        self._stored = grown(self._stored, self._count)
        self._stored[first : self._count] = more


def packed(parts: Parts) -> Parts:
    """A copy of a named tuple whose arrays, those in named tuples among them too, lie in one block of memory. What is
    kept for long is packed: among what comes and goes, a small block of its own keeps a page."""
    copy: Parts = _moved(parts, np.empty(_aligned_bytes(parts), np.uint8))
    return copy


def _aligned_bytes(part: object) -> int:
    if isinstance(part, np.ndarray):
        return part.nbytes + -part.nbytes % _ALIGNED_BYTES
    return sum(_aligned_bytes(inner) for inner in part) if isinstance(part, tuple) else 0


def _moved(part: Any, block: NDArray[np.uint8]) -> Any:
    """A copy of the part with its arrays in the block, in order."""
    if isinstance(part, np.ndarray):
        copy = block[: part.nbytes].view(part.dtype).reshape(part.shape)
        copy[...] = part
        return copy
    if not isinstance(part, tuple):
        return part
    copies, start = [], 0
    for inner in part:
        end = start + _aligned_bytes(inner)
        copies.append(_moved(inner, block[start:end]))
        start = end
    return tuple.__new__(type(part), copies)
