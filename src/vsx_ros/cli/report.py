"""``vsx report``: write the report of a run folder, or compare two

Writes report.html, one page that needs nothing else: what happened, why it ended, the map, the trajectory, tracking
over time, every number, and the command that repeats the run. With a second run, a page that shows both side by side,
and what differs in numbers and settings.

examples: vsx report runs/today | vsx report runs/before runs/after --out compared.html
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from vsx_ros.errors import ConfigError, InputError, explained

if TYPE_CHECKING:
    from vsx_ros.runs.folder import RunFolder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("run_folder", type=Path, metavar="RUN", help="a run folder")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="another one, to compare with")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the comparison (default compared.html in OTHER)")


def run(args: argparse.Namespace) -> int:
    """Write the page and say where it is."""
    from vsx_ros.runs.folder import RunFolder
    from vsx_ros.runs.report import write_report

    folder = RunFolder.open(args.run_folder)
    if args.other is not None:
        print(_compare(folder, RunFolder.open(args.other), args.out))
    elif args.out is not None:
        raise ConfigError("--out is for a comparison: give a second run, or leave it out")
    else:
        print(write_report(folder))
    return 0


def _compare(a: RunFolder, b: RunFolder, out: Path | None) -> Path:
    from vsx_ros.evaluation.comparison import compare
    from vsx_ros.io.atomic import write_text
    from vsx_ros.runs.report import report_data

    out = out or b.path / "compared.html"
    names = (a.path.name, b.path.name) if a.path.name != b.path.name else (str(a.path), str(b.path))
    page = compare((names[0], report_data(a)), (names[1], report_data(b)))
    with explained(InputError, f"{out} cannot be written", "give another one with --out", OSError):
        write_text(out, page)
    return out
