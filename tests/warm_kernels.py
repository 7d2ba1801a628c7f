"""Finds kernels that the stack calls with types that the warm-up leaves out: they would be compiled in mid-drive."""

import importlib
import pkgutil
import sys
from collections.abc import Callable
from typing import Any

from vsx_ros import kernels


def every_kernel() -> set[kernels.Kernel]:
    """All kernels of the stack."""
    names = [module.name for module in pkgutil.walk_packages(kernels.__path__, "vsx_ros.kernels.")]
    members = [member for name in names for member in vars(importlib.import_module(name)).values()]
    return {member for member in members if isinstance(member, kernels.Kernel)}


def watched() -> list[str]:
    """Warm up. The list gets a line for each warm kernel that the stack, not a test, calls with other types later."""
    importlib.import_module("vsx_ros.kernels.warmup").warm_up()
    late: list[str] = []
    for each in every_kernel():
        if each.compiled.overloads:
            each.compiled._compile_for_args = _noted(each.compiled, late)
    return late


def _noted(dispatcher: Any, late: list[str]) -> Callable[..., object]:
    """What numba calls when a kernel gets types that it has not in memory."""
    compile_for = dispatcher._compile_for_args

    def noted(*args: object, **names: object) -> object:
        caller = sys._getframe(2)  # of ``Kernel.__call__``
        if caller.f_globals["__name__"].startswith("vsx_ros."):
            types = ", ".join(str(dispatcher.typeof_pyval(each)) for each in args)
            late.append(f"{caller.f_code.co_name} calls {dispatcher.__name__}({types})")
        return compile_for(*args, **names)

    return noted
