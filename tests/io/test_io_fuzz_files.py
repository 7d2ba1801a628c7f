"""A small part of benchmarks/fuzz_files.py: damaged files of every kind are read or refused in one sentence."""

from collections.abc import Callable
from pathlib import Path

import fuzz_files
import pytest

from vsx_ros.limits import file_text


@pytest.mark.parametrize("reader", fuzz_files.READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused(reader):
    outcomes = fuzz_files.fuzzed(fuzz_files.Block(reader.name, 0, 60))["outcomes"]
    assert outcomes.keys() <= {"read", "refused"}
    assert outcomes["refused"] > 0


@pytest.mark.parametrize(
    ("reader", "number"),
    [
        ("map", 1505), ("map", 1738), ("map", 2556), ("world", 2013), ("world", 4087), ("run folder", 3208),
        ("run folder", 5062), ("run folder", 5093), ("checkpoint", 6776), ("slam map", 4914), ("ros2 sqlite3", 2789),
        ("ros2 sqlite3 message.zstd", 2430), ("calibration", 2036), ("live session", 1231),
    ],
)  # fmt: skip
def test_what_once_was_an_internal_error_is_one_sentence(tmp_path: Path, reader: str, number: int) -> None:
    """Of the ten thousand damaged files of each reader."""
    bench = fuzz_files.Bench(next(one for one in fuzz_files.READERS if one.name == reader), tmp_path)
    bench.damage(f"{reader} {number}")
    assert bench.outcome() in ("read", "refused")


def _look_at_nothing(path: Path) -> None:
    file_text(None)


def _doubt(path: Path) -> None:
    raise AssertionError("not as written")


@pytest.mark.parametrize(
    ("read", "told", "where"),
    [
        (_look_at_nothing, "AttributeError: ", "(limits.py:"),
        (_doubt, "AssertionError: not as written ", "(test_io_fuzz_files.py:"),
    ],
)
def test_an_error_is_an_outcome_also_without_a_line_of_the_package_on_its_way(
    tmp_path: Path, read: Callable[[Path], None], told: str, where: str
) -> None:
    reader = fuzz_files.READERS[0]._replace(make=lambda path: path.write_text("x"), read=read)
    outcome = fuzz_files.Bench(reader, tmp_path).outcome()
    assert outcome.startswith(told)
    assert where in outcome
