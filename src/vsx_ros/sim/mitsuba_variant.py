"""Mitsuba 3, an optional package, in a variant that works on this machine.

Its fast variant compiles with LLVM; some versions of libLLVM end the process without a word. So each is tried in a
child process first."""

import importlib.util
import os
import re
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

from vsx_ros.errors import ConfigError

FAST, PLAIN = "llvm_ad_rgb", "scalar_rgb"
_LIBRARY = "DRJIT_LIBLLVM_PATH"
SLOWLY = f"Mitsuba draws slowly, as no libLLVM works here; install libllvm19, or name one in {_LIBRARY}"
_TRIED_S = 120.0  # at most, on a busy machine
_PLACES = "/usr/lib/*-linux-gnu/libLLVM*.so*", "/usr/lib/llvm-*/lib/libLLVM*.so*"
_PROBE = """
import sys
import mitsuba as mi
import numpy as np
mi.set_variant(sys.argv[1])
scene = mi.load_dict({'type': 'scene', 'i': {'type': 'path'}, 's': {'type': 'sphere'}, 'e': {'type': 'constant'},
    'c': {'type': 'perspective', 'film': {'type': 'hdrfilm', 'width': 8, 'height': 8}}})
assert np.isfinite(np.array(mi.render(scene, spp=4))).all()
"""


@lru_cache(maxsize=1)
def mitsuba() -> Any:
    """The package, its variant chosen: the compiled one, or the plain one where no libLLVM works. Raises ConfigError
    when it is not installed or does not work."""
    if importlib.util.find_spec("mitsuba") is None:
        raise ConfigError("the eye mitsuba needs Mitsuba 3, which is not installed: pip install 'vsx_ros[mitsuba]'")
    variant, library = _working()
    if library:
        os.environ[_LIBRARY] = library
    import mitsuba as package

    package.set_variant(variant)
    return package


def is_fast(package: Any) -> bool:
    """Whether it takes many rays at once."""
    return bool(package.variant() == FAST)


def _working() -> tuple[str, str]:
    """The first variant that draws, and its libLLVM or an empty string."""
    given = os.environ.get(_LIBRARY)
    for library in [given] if given else libraries():
        if not (failure := _failure(FAST, library)):
            return FAST, library
        if given:
            remedy = "name another there (version 19 works), or unset it"
            raise ConfigError(f"{_LIBRARY} {given}: Mitsuba does not work with this libLLVM ({failure}); {remedy}")
    if failure := _failure(PLAIN, ""):
        raise ConfigError(f"Mitsuba is installed but draws nothing: {failure}; pip install -U 'vsx_ros[mitsuba]'")
    return PLAIN, ""


def libraries() -> list[str]:
    """The files of libLLVM on this machine, newest version first."""
    files = {str(file.resolve()) for place in _PLACES for file in Path("/").glob(place[1:])}
    return sorted(files, key=lambda file: ([int(n) for n in re.findall(r"\d+", Path(file).name)], file), reverse=True)


def _failure(variant: str, library: str) -> str:
    """Why a child process cannot draw with it; empty if it can."""
    environment = os.environ | ({_LIBRARY: library} if library else {})
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE, variant], env=environment, timeout=_TRIED_S, capture_output=True, text=True
        )
    except subprocess.TimeoutExpired:
        return f"nothing for {_TRIED_S:g} s"
    last = (done.stderr.strip().splitlines() or [f"signal {-done.returncode}"])[-1]
    return last if done.returncode else ""
