"""Ground floor: compiled loops over arrays and scalars, and named tuples of them. No files, no clock.

Every kernel is decorated with ``kernel``: cached on disk, free of Python's global lock, IEEE arithmetic
(no fastmath), so the same input gives the same bits. The compiler takes most of a second to import, so that happens
when the first kernel is called."""

import functools
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


class Kernel(Generic[P, R]):
    """A function that is compiled, or read from disk, at its first call. ``compiled`` is numba's dispatcher."""

    def __init__(self, function: Callable[P, R], options: dict[str, bool]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options = function, options

    def __call__(self, *args: P.args, **names: P.kwargs) -> R:
        """Call the compiled function."""
        return self.compiled(*args, **names)

    @functools.cached_property
    def compiled(self) -> Callable[P, R]:
        """What numba makes of the function."""
        from vsx_ros.kernels import compiler

        compiler.let_kernels_call(Kernel)
        return compiler.compiled(self._function, self._options)


def kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """Compile on first call, keep the machine code on disk, run without the global lock."""
    return Kernel(function, {})


def part(function: Callable[P, R]) -> Kernel[P, R]:
    """A small kernel that is inlined into its callers."""
    return Kernel(function, {"forceinline": True})


def loop_kernel(function: Callable[P, R]) -> Kernel[P, R]:
    """A kernel whose time goes into one long loop body: LLVM's vectoriser of straight-line code would pack parts of the
    body and so keep the loop itself from being vectorised."""
    return Kernel(function, {"loops_only": True})
