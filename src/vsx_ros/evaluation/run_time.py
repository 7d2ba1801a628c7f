"""The time of a run: all of its report counts from its begin, without the interruptions between its sessions."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from vsx_ros.arrays import FloatArray

_PAUSE_NS = 30_000_000_000  # so long without an image and an event the run was interrupted

Part = tuple[int, int]
Clock = Callable[[Iterable[int]], FloatArray]  # how long a run had lasted at each stamp [ns -> s]


def parts(stamps_ns: Iterable[int]) -> list[Part]:
    """Begin and end [ns] of each part of a run between its interruptions. stamps_ns: of its images and
    events, in any order."""
    stamps = sorted(stamps_ns)
    breaks = [(a, b) for a, b in pairwise(stamps) if b - a > _PAUSE_NS]
    return list(zip([*stamps[:1], *(b for _, b in breaks)], [*(a for a, _ in breaks), *stamps[-1:]]))


def length_s(during: Sequence[Part]) -> float:
    """How long a run has lasted [s]. during: its parts."""
    return 1e-9 * sum(end - begin for begin, end in during)


def elapsed_s(stamps_ns: Iterable[int], during: Sequence[Part]) -> FloatArray:
    """(N,) how long the run had lasted at each stamp [s]. during: its parts."""
    if not during:
        return np.zeros(len(list(stamps_ns)))
    began_ns = during[0][0]
    edges = [1e-9 * (edge - began_ns) for part in during for edge in part]
    lengths = [1e-9 * (end - begin) for begin, end in during]
    lasted = np.repeat(np.cumsum([0.0, *lengths]), 2)[1:-1]
    return np.asarray(np.interp([1e-9 * (stamp - began_ns) for stamp in stamps_ns], edges, lasted))
