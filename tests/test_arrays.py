"""One block of memory for the arrays of what is kept for long."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, array_bytes, packed


class Inner(NamedTuple):
    pixels: FloatArray
    counts: tuple[int, ...]


class Outer(NamedTuple):
    number: int
    inner: Inner
    mask: FloatArray
    word: str | None
    empty: FloatArray


def outer():
    inner = Inner(np.arange(6, dtype=np.float32).reshape(2, 3).T, (1, 2))
    return Outer(7, inner, mask=np.array([True, False, True]), word=None, empty=np.zeros((0, 2)))


def test_a_packed_tuple_is_the_same_in_one_block_of_its_own():
    given = outer()
    kept = packed(given)
    assert type(kept) is Outer
    assert type(kept.inner) is Inner
    assert (kept.number, kept.word, kept.inner.counts) == (7, None, (1, 2))
    block = kept.mask.base
    copies, originals = ((whole.inner.pixels, whole.mask, whole.empty) for whole in (kept, given))
    for copy, original in zip(copies, originals):
        np.testing.assert_array_equal(copy, original)
        assert (copy.dtype, copy.shape) == (original.dtype, original.shape)
        assert copy.base is block
        assert copy.flags.aligned
        assert copy.flags.c_contiguous
    given.inner.pixels[:] = -1
    np.testing.assert_array_equal(kept.inner.pixels, outer().inner.pixels)


def test_what_is_packed_takes_hardly_more_than_its_arrays():
    given = tuple(np.full(100 + k, k, np.float64) for k in range(20))
    assert packed(given)[0].base.nbytes <= array_bytes(given) + 20 * 63
