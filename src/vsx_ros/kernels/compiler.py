"""How kernels are compiled: numba's settings, its cache for several processes, and kernels that call kernels."""

import fcntl
import functools
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import typeof_impl

# Numba leaves LLVM's vectoriser of straight-line code off by default; it makes 6 x 6 blocks twice as fast and, without
# fastmath, changes no bit.
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]  # numba makes its settings at import

P = ParamSpec("P")
R = TypeVar("R")


class _SharedCache(FunctionCache):  # type: ignore[misc]  # numba is untyped
    """Machine code on disk that several processes add to at once. Numba's own cache reads a kernel's list of types and
    writes it back: of two processes one would lose its entry, or get the other's code."""

    def load_overload(self, sig: object, target_context: object) -> object:
        """As numba's; code whose types have other names now is forgotten. Numba would fail before it sees that the
        source has changed."""
        try:
            return super().load_overload(sig, target_context)
        except (AttributeError, ImportError):
            self.flush()
            return None

    def save_overload(self, sig: object, data: object) -> None:
        """As numba's, one process after the other."""
        self._impl.locator.ensure_cache_path()
        with (Path(self.cache_path) / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)


@functools.cache
def let_kernels_call(kind: type) -> None:
    """Kernels may call objects of this type: numba takes what their attribute ``compiled`` is."""
    typeof_impl.register(kind)(lambda called, context: typeof_impl(called.compiled, context))


def compiled(function: Callable[P, R], options: dict[str, bool]) -> Callable[P, R]:
    """The function as numba compiles it at each new combination of types; itself under NUMBA_DISABLE_JIT. The option
    ``loops_only`` leaves LLVM's vectoriser of straight-line code off."""
    settings = {name: value for name, value in options.items() if name != "loops_only"}
    # Nobody calls a kernel from C; without the wrapper for that, compiling takes a tenth less.
    made = numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **settings)(function)
    if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # as above
        made._cache = _SharedCache(function)
        if "loops_only" in options:
            made.compile = functools.partial(_compiled_for_loops, made.compile)
    typed: Callable[P, R] = made
    return typed


def _compiled_for_loops(compile_for: Callable[[object], object], types: object) -> object:
    with global_compiler_lock:
        numba.config.SLP_VECTORIZE = 0  # type: ignore[attr-defined]  # as above
        try:
            return compile_for(types)
        finally:
            numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]  # as above
