"""Large arrays of which most rows never change, in pieces that are written once.

A folder of .npy files, each named by the SHA-256 of its content: the same rows are the same file, and no changed byte
goes unnoticed.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.io.atomic import write_bytes


class Pieces:
    """Writes and reads one folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def write(self, array: NDArray[Any], cuts: Sequence[int] | NDArray[np.int64]) -> list[str]:
        """Put what is new of an array on the disk; cuts: the rows that begin another piece, ascending. Returns the
        names of its pieces, in order. Raises OSError."""
        self.path.mkdir(parents=True, exist_ok=True)
        return [self._write(array_bytes(piece)) for piece in np.split(array, cuts)]

    def read(self, names: Sequence[str]) -> NDArray[Any]:
        """The array of these pieces. Raises OSError without one of them, ValueError when one was changed."""
        return np.concatenate([array_of(self._read(name)) for name in names])

    def keep(self, names: Collection[str]) -> None:
        """Remove all other pieces. Raises OSError."""
        kept = {f"{name}.npy" for name in names}
        for path in self.path.iterdir():
            if path.name not in kept:
                path.unlink()

    def _write(self, content: bytes) -> str:
        name = hashlib.sha256(content).hexdigest()
        path = self.path / f"{name}.npy"
        if not path.exists():
            write_bytes(path, content, durable=True)
        return name

    def _read(self, name: str) -> bytes:
        content = (self.path / f"{Path(name).name}.npy").read_bytes()
        if hashlib.sha256(content).hexdigest() != name:
            raise ValueError(f"its piece {name}.npy was changed")
        return content


def array_bytes(array: NDArray[Any]) -> bytes:
    """An array as the content of a .npy file."""
    content = io.BytesIO()
    np.save(content, array, allow_pickle=False)
    return content.getvalue()


def array_of(content: bytes) -> NDArray[Any]:
    """The array of a .npy file. Raises ValueError for anything else."""
    array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    return array
