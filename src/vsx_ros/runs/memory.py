"""Memory of a process that runs for hours: what was freed goes back to the system."""

import ctypes
import sys

TRIM_EVERY_S = 5.0
_MALLOC = {"M_TRIM_THRESHOLD": (-1, 2**18), "M_MMAP_THRESHOLD": (-3, 2**16), "M_ARENA_MAX": (-8, 1)}
"""Settings of glibc's malloc (mallopt(3)), in bytes: grids and images are mapped by themselves, most messages lie on
the heap."""


def return_freed_memory() -> None:
    """Return the memory of freed maps and images to the system. By default malloc keeps it between small blocks, with
    one heap per thread. A node that receives maps then grows by tens of MB in its first half hour."""
    if sys.platform == "linux":
        for parameter, value in _MALLOC.values():
            ctypes.CDLL(None).mallopt(parameter, value)


def trim() -> None:
    """Return free pages between small blocks, too (malloc_trim(3)): what a growing map keeps lies between what each
    frame frees."""
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
