"""What a reader takes for a small file: memory, time, and one sentence."""

import time
from pathlib import Path

from vsx_ros.errors import VsxError

LIMIT_MIB, LIMIT_S = 512, 30.0


def resident_mib(name: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))


def taken(path: Path, read) -> str:
    """What the reader says of the file; how much memory it takes and how long is checked."""
    size = sum(f.stat().st_size for f in path.rglob("*")) if path.is_dir() else path.stat().st_size
    assert size <= 10_000_000
    Path("/proc/self/clear_refs").write_text("5")
    before_mib, began_s, said = resident_mib("VmRSS"), time.process_time(), ""
    try:
        read(path)
    except VsxError as error:
        said = str(error)
    assert resident_mib("VmHWM") - before_mib < LIMIT_MIB
    assert time.process_time() - began_s < LIMIT_S
    assert "\n" not in said
    assert len(said) < 1500
    return said
