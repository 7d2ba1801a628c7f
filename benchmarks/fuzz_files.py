"""Ten thousand damaged files for each reader: only a one-sentence error may result, soon and in little memory.

python benchmarks/fuzz_files.py [--count 10000] [--only NAME ...] [--out FILE]

Good files are damaged by bytes, by words and numbers, and part by part with corrected lengths and checksums
(file_mutations.py). A reader (file_readers.py) must read the file or raise a VsxError, within 10 s and 512 MiB. Every
thousand files make a row; existing rows of the present code are not repeated.
"""

import argparse
import io
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter, namedtuple
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))
from file_readers import BY_PATH, READERS, SUFFIXES, Reader
from tables import RESULTS, campaign

from vsx_ros.errors import VsxError
from vsx_ros.experiments.rows import PACKAGE

LIMIT_S, LIMIT_MIB = 10, 512
BLOCK = 1000
Block = namedtuple("Block", "reader block mutations")


class Hang(BaseException):
    """Ten seconds are over."""


class Bench:
    """One reader's sample, damaged repeatedly."""

    def __init__(self, reader: Reader, folder: Path) -> None:
        self.reader = reader
        kind = reader.name.split()[0]
        suffix = SUFFIXES.get(reader.name) or (f".{kind}" if reader.name.endswith(" image") else "")
        suffix = ".bag" if kind == "ros1" else suffix
        self.good = folder / f"good{suffix}"
        reader.make(self.good)
        self.bad = folder / f"bad{suffix}"

    def restore(self) -> None:
        """Replace the last damaged sample by the good one."""
        if self.good.is_dir():
            shutil.rmtree(self.bad, ignore_errors=True)
            shutil.copytree(self.good, self.bad)
        else:
            self.bad.write_bytes(self.good.read_bytes())

    def warm_up(self) -> None:
        """Read the good sample: what is imported and compiled for it may take a busy machine longer than the limit."""
        self.restore()
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), suppress(VsxError):
            self.reader.read(self.bad)

    def damage(self, seed: str) -> None:
        """Replace the last damaged sample by a new one."""
        rng = random.Random(seed)
        self.restore()
        if self.good.is_dir():
            files = [f for pattern in self.reader.files for f in sorted(self.bad.glob(pattern)) if f.is_file()]
            target = rng.choice(files)
        else:
            target = self.bad
        if self.reader.damage in BY_PATH:
            self.reader.damage(rng, target)
        else:
            target.write_bytes(self.reader.damage(rng, target.read_bytes()))

    def outcome(self) -> str:
        """read, refused, or the failure."""
        try:
            with limited():
                self.reader.read(self.bad)
        except VsxError as error:
            said = str(error)
            return "refused" if "\n" not in said and len(said) < 2000 else f"no sentence: {said[:200]!r}"
        except Hang:
            return "hang"
        except Exception as error:
            return failure(error)
        return "read"


def failure(error: Exception) -> str:
    """The error, the last line of the package that led to it, or without one the line itself, and its function."""
    frames = traceback.extract_tb(error.__traceback__)
    place = frames[-1]
    ours = next((f for f in reversed(frames) if Path(f.filename).is_relative_to(PACKAGE)), place)
    return f"{type(error).__name__}: {str(error)[:80]} ({Path(ours.filename).name}:{ours.lineno}, {place.name})"


@contextmanager
def limited():
    """Limit to ten seconds, without output on the terminal."""

    def over(*_: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, over)
    signal.alarm(LIMIT_S)
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def resident_mib(name: str) -> float:
    """VmRSS, or VmHWM: the maximum since ``forget_peak``."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))


def forget_peak() -> None:
    """Reset VmHWM."""
    Path("/proc/self/clear_refs").write_text("5")


def fuzzed(task: Block) -> dict[str, Any]:
    """Outcomes of the damaged files."""
    reader = next(reader for reader in READERS if reader.name == task.reader)
    outcomes: Counter[str] = Counter()
    slowest_s = most_mib = 0.0
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(reader, Path(folder))
        bench.warm_up()
        for number in range(task.block * BLOCK, task.block * BLOCK + task.mutations):
            bench.damage(f"{reader.name} {number}")
            forget_peak()
            before_mib, began_s = resident_mib("VmRSS"), time.monotonic()
            outcome = bench.outcome()
            slowest_s = max(slowest_s, time.monotonic() - began_s)
            taken_mib = resident_mib("VmHWM") - before_mib
            most_mib = max(most_mib, taken_mib)
            outcome = f"{taken_mib:.0f} MiB taken" if taken_mib > LIMIT_MIB else outcome
            if outcome not in ("read", "refused"):
                outcome = f"{number}: {outcome}"
            outcomes[outcome] += 1
    return {"outcomes": dict(outcomes), "slowest_s": round(slowest_s, 2), "most_mib": round(most_mib, 1)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="readers; default: all")
    parser.add_argument("--out", type=Path, default=RESULTS / "fuzz_files.jsonl")
    args = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (6 * 2**30, resource.RLIM_INFINITY))
    tasks = [
        Block(reader.name, block, min(BLOCK, args.count - block * BLOCK))
        for block in range(-(-args.count // BLOCK))
        for reader in READERS
        if not args.only or reader.name in args.only
    ]
    results = campaign("fuzz_files", tasks, fuzzed, args.out)
    return int(any("failed" in result or result["outcomes"].keys() - {"read", "refused"} for result in results))


if __name__ == "__main__":
    sys.exit(main())
