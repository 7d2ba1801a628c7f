"""Arrays in chunks: whole again, written once, and no changed byte unnoticed."""

import numpy as np
import pytest

from vsx_ros.io.sealed_archive import ArrayChunks


@pytest.mark.parametrize("cuts", [[], [3], [0, 4, 4, 10]])
@pytest.mark.parametrize("shape", [(10,), (10, 2), (10, 3, 3)])
def test_an_array_comes_back_bit_for_bit(tmp_path, shape, cuts):
    chunks, array = ArrayChunks(tmp_path), np.random.default_rng(0).normal(size=shape)
    names = chunks.write(array, cuts)
    assert len(names) == len(cuts) + 1
    back = chunks.read(names, chunks.allowance())
    assert back.dtype == array.dtype
    assert np.array_equal(back, array)


def test_an_empty_array_is_one_piece(tmp_path):
    chunks = ArrayChunks(tmp_path)
    back = chunks.read(chunks.write(np.zeros((0, 24, 24), np.uint8), np.arange(4, 0, 4)), chunks.allowance())
    assert back.shape == (0, 24, 24)
    assert back.dtype == np.uint8


def test_rows_that_stay_are_written_once_and_what_is_gone_is_removed(tmp_path):
    chunks = ArrayChunks(tmp_path / "new")
    first = chunks.write(np.arange(10), [4, 8])
    stamps = {name: (tmp_path / "new" / f"{name}.npy").stat().st_mtime_ns for name in first}
    second = chunks.write(np.arange(15), [4, 8, 12])
    assert second[:2] == first[:2]
    chunks.keep(second)
    there = {path.stem: path.stat().st_mtime_ns for path in (tmp_path / "new").iterdir()}
    assert there.keys() == set(second)
    assert all(there[name] == stamps[name] for name in first[:2])


def test_a_piece_that_was_changed_or_is_gone_is_told(tmp_path):
    chunks = ArrayChunks(tmp_path)
    first, second = chunks.write(np.arange(10), [5])
    path = tmp_path / f"{second}.npy"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"piece {second}.npy was changed"):
        chunks.read([first, second], chunks.allowance())
    path.unlink()
    with pytest.raises(FileNotFoundError):
        chunks.read([first, second], chunks.allowance())
