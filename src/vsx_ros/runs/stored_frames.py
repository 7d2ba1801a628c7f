"""The frames of a run in little memory: an hour of objects would be 100 MB, an hour of packed rows is 8."""

from array import array
from collections.abc import Sequence
from typing import overload

from msgspec import convert, msgpack, structs

from vsx_ros.runs.journal import FrameLine

_PACK, _UNPACK = msgpack.Encoder(), msgpack.Decoder(list)
_NAMES = FrameLine.__struct_fields__


class StoredFrames(Sequence[FrameLine]):
    """Frames in order. One thread may add them while others read."""

    def __init__(self) -> None:
        self._rows, self._ends = bytearray(), array("q")  # a frame is there once its end is

    def append(self, frame: FrameLine) -> None:
        """Store a frame."""
        self._rows += _PACK.encode(structs.astuple(frame))
        self._ends.append(len(self._rows))

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> FrameLine: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameLine]: ...
    def __getitem__(self, index: int | slice) -> FrameLine | list[FrameLine]:
        """One frame, or some; each call makes new ones."""
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        k = range(len(self))[index]
        begin = self._ends[k - 1] if k else 0
        return convert(dict(zip(_NAMES, _UNPACK.decode(self._rows[begin : self._ends[k]]))), FrameLine)
