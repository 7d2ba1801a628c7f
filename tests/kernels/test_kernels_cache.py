"""Several processes compile at once and keep their machine code in the same folder."""

import fcntl
import importlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import FunctionCache

SOURCE = "from vsx_ros.kernels import kernel\n\n\n@kernel\ndef twice(x):\n    return x + x\n"


@pytest.mark.compiled
def test_they_add_to_it_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "twice_of_a_test.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    saved, save = [], FunctionCache.save_overload

    def save_alone(cache: FunctionCache, sig: object, data: object) -> None:
        with (tmp_path / "__pycache__" / "lock").open("w") as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        save(cache, sig, data)
        saved.append(sig)

    monkeypatch.setattr(FunctionCache, "save_overload", save_alone)
    module = importlib.import_module("twice_of_a_test")
    assert module.twice(2) == 4
    assert module.twice(np.float64(1.5)) == 3.0
    assert len(saved) == len(list(tmp_path.rglob("*.nbc"))) == 2
    assert not module.twice.compiled.stats.cache_hits

    again = importlib.reload(module)
    assert again.twice(3) == 6
    assert len(again.twice.compiled.stats.cache_hits) == 1, "the machine code of before is used"
    assert len(saved) == 2


RENAMED = """
from typing import NamedTuple
import numpy as np
from vsx_ros.kernels import kernel

class {name}(NamedTuple):
    values: np.ndarray

@kernel
def total(of):
    return of.values.sum()

def made():
    return {name}(np.ones(3))
"""


@pytest.mark.compiled
def test_code_of_a_type_that_has_another_name_now_is_compiled_anew(tmp_path: Path) -> None:
    for name in ("Before", "After"):
        (tmp_path / "renamed.py").write_text(RENAMED.format(name=name))
        call = "import renamed; print(renamed.total(renamed.made()))"
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "PYTHONPATH": path}
        command = [sys.executable, "-c", call]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert (done.returncode, done.stdout) == (0, "3.0\n"), done.stderr
