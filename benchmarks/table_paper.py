"""Makes tables of the paper's experiments from their rows."""

from collections.abc import Callable, Sequence

from vsx_ros.experiments.drive import DriveTask
from vsx_ros.experiments.rows import Row
from vsx_ros.experiments.table1 import HEADER, numbers, rows_of
from vsx_ros.experiments.trackers import U2_READINGS

_USUAL = f": {U2_READINGS['u2_frames']}"


def table1(rows: Sequence[Row]) -> list[str]:
    """Every measure; of U2 only the usual definition."""
    return _lines(rows, lambda name: not name.startswith("U2 [frames]") or name.endswith(_USUAL))


def u2(rows: Sequence[Row]) -> list[str]:
    """U2 by each definition."""
    return _lines(rows, lambda name: name.startswith("U2 [frames]"))


def _lines(rows: Sequence[Row], shown: Callable[[str], bool]) -> list[str]:
    """One line per tracker and measure, over both datasets."""
    tree = numbers([(DriveTask(**row.asked), row.result) for row in rows])
    lines = [["tracker", *HEADER], ["---"] * (1 + len(HEADER))]
    lines += [[tracker, *cells] for tracker, of in tree.items() for cells in rows_of(of["both"]) if shown(cells[0])]
    return [f"| {' | '.join(cells)} |" for cells in lines]
