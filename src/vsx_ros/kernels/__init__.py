"""Ground floor: compiled loops over arrays and scalars, and named tuples of them. No files, no clock.

Every kernel is decorated with ``kernel``: cached on disk, free of Python's global lock, IEEE arithmetic
(no fastmath), so the same input gives the same bits."""

import fcntl
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache

# Numba leaves LLVM's vectoriser of straight-line code off by default; it makes 6 x 6 blocks twice as fast and, without
# fastmath, changes no bit.
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]  # numba makes its settings at import

P = ParamSpec("P")
R = TypeVar("R")


class _SharedCache(FunctionCache):  # type: ignore[misc]  # numba is untyped
    """Machine code on disk that several processes add to at once. Numba's own cache reads a kernel's list of types and
    writes it back: of two processes one would lose its entry, or get the other's code."""

    def save_overload(self, sig: object, data: object) -> None:
        """As numba's, one process after the other."""
        self._impl.locator.ensure_cache_path()
        with (Path(self.cache_path) / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, run without the global lock."""
    return _compiled(function)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """A small kernel that is inlined into its callers."""
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[P, R], **options: bool) -> Callable[P, R]:
    # Nobody calls a kernel from C; without the wrapper for that, compiling takes a tenth less.
    compiled = numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        compiled._cache = _SharedCache(function)
    typed: Callable[P, R] = compiled
    return typed
