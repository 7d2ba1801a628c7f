"""What kernels say they take and give is what is compiled for them; numpy's own types let int32 pass for int64. The
warm-up compiles all that other packages call."""

import ast
import importlib
import os
import pathlib
import subprocess
import sys
import types
import typing

import numpy as np
import pytest
from numba.core import types as compiled
from numba.np.numpy_support import as_dtype
from warm_kernels import every_kernel

from vsx_ros import kernels

COLD = tuple(f"vsx_ros.kernels.{name}" for name in ("sim.mesh_", "occupancy.visibility.seen", "planning.primitives."))
"""Kernels for worlds from files, to judge a run, and of a planner to compare with: no run waits for them."""
NUMBERS = {float: compiled.float64, int: compiled.int64, bool: compiled.boolean}


def fits(said, found, given):
    """Whether an annotation describes a compiled type; an integer may be given where a float is taken."""
    found = compiled.unliteral(found)
    if typing.get_origin(said) is np.ndarray:
        scalar = typing.get_args(typing.get_args(said)[1])[0]
        return isinstance(found, compiled.Array) and as_dtype(found.dtype) == np.dtype(scalar)
    if typing.get_origin(said) is tuple:
        parts, each = typing.get_args(said), getattr(found, "types", ())
        parts = parts[:1] * len(each) if parts[-1] is Ellipsis else parts
        return len(parts) == len(each) and all(fits(a, b, given) for a, b in zip(parts, each))
    if said is types.NoneType:
        return found is compiled.none
    if isinstance(said, type) and issubclass(said, tuple):
        hints = typing.get_type_hints(said).values()
        return found.instance_class is said and all(fits(a, b, given) for a, b in zip(hints, found.types))
    if said in NUMBERS:
        return found == NUMBERS[said] or (given and said is float and found == compiled.int64)
    return found == getattr(compiled, said.__name__)


def mismatches():
    """How many kernels were called or compiled in this process, and where one differs from its signature."""
    seen = [f.compiled for f in every_kernel() if f.compiled.overloads]
    wrong = []
    for f in seen:
        hints = typing.get_type_hints(f.py_func)
        result = hints.pop("return")
        for overload in f.overloads.values():
            pairs = [p for p in zip(hints.items(), overload.signature.args) if not isinstance(p[1], compiled.Omitted)]
            wrong += [f"{f.py_func.__name__}({name}: {a})" for (name, said), a in pairs if not fits(said, a, True)]
            if not fits(result, overload.signature.return_type, False):
                wrong.append(f"{f.py_func.__name__} -> {overload.signature.return_type}")
    return len(seen), wrong


def called():
    """The kernels that other packages name."""
    package = pathlib.Path(kernels.__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        if "kernels" in path.relative_to(package).parts:
            continue
        nodes, known = list(ast.walk(ast.parse(path.read_text(encoding="utf-8")))), {}
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vsx_ros.kernels"):
                home = importlib.import_module(node.module)
                known |= {name.asname or name.name: getattr(home, name.name) for name in node.names}
        parts = [node for node in nodes if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)]
        named = [getattr(known[node.value.id], node.attr, None) for node in parts if node.value.id in known]
        yield from (f for f in (*known.values(), *named) if isinstance(f, kernels.Kernel))


@pytest.mark.parametrize(
    ("said", "found", "expected"),
    [
        (np.ndarray[tuple[int], np.dtype[np.int64]], compiled.int64[::1], True),
        (np.ndarray[tuple[int], np.dtype[np.int64]], compiled.int32[::1], False),
        (tuple[float, int], compiled.Tuple((compiled.float64, compiled.int64)), True),
        (tuple[float, ...], compiled.UniTuple(compiled.float32, 3), False),
        (np.float32, compiled.float32, True),
        (bool, compiled.int64, False),
    ],
)
def test_a_type_fits_its_own_alone(said, found, expected):
    assert fits(said, found, False) == expected


@pytest.mark.compiled
def test_signatures_are_what_is_compiled():
    # In a process of its own: other tests compile for what they please.
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, __file__], env=paths, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


if __name__ == "__main__":
    from vsx_ros.kernels.warmup import warm_up

    warm_up()
    count, wrong = mismatches()
    assert not wrong, "\n".join(wrong)
    assert count > 50, f"only {count} kernels were compiled"
    names = {f"{f.__module__}.{f.__name__}" for f in called() if not f.compiled.overloads}
    cold = sorted(name for name in names if not name.startswith(COLD))
    assert not cold, f"the warm-up leaves out {cold}"
