"""Several processes compile at once and keep their machine code in the same folder."""

import fcntl
import importlib
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
