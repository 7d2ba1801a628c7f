"""Makes every table of the documents from its rows.

    python benchmarks/tables.py render     writes the tables between their marks in the documents
    python benchmarks/tables.py stale      lists the tables whose rows are older than the code they judge
    python benchmarks/tables.py show NAME  prints a table of its newest rows, also while it is not whole

A table uses only rows of one code and configuration: the newest that answered all its questions. While there is none,
its last line names what is missing.
"""

import argparse
import ast
import subprocess
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import table_docking
import table_exploration
import table_faults
import table_free_cells
import table_paper
import table_zones

from vsx_ros.config import Config
from vsx_ros.experiments import drive
from vsx_ros.experiments.campaign import Engine, Result, Task, Work, run_campaign
from vsx_ros.experiments.rows import Row, Store, code_hash, config_hash, read_rows, tell

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"

_PROGRAMS = {
    "exploration_live": "exploration",
    "fault_alarms": "fault_sensors",
    "fault_bases": "fault_matrix",
    "fault_cameras": "fault_matrix",
}
"""The programs that write rows to files of other names."""
_PACKAGES = (ROOT / "src" / "vsx_ros", ROOT / "hw" / "vsx_hw")
_BESIDE = tuple(ROOT / folder for folder in ("benchmarks", "tests/ros", "tests/hw", "tests"))
_IN_PROCESS = frozenset(
    ("exploration", "exploration_strategy", "free_cells", "docking", "charging", "zones", "fault_sensors",
     "fault_alarms", "fuzz_files")
)  # fmt: skip
"""Rows whose programs start no node and no command: they judge what is imported."""


_Made: TypeAlias = Callable[[Sequence[Row]], list[str]]


class Table(NamedTuple):
    """document: the file with the table's marks. rows: the file of its rows. made: makes its lines. of: the published
    questions, by name: the value that each row has, or a range or tuple of all those that a whole table has, or a
    function that lists them; each with each. Names with a space between belong together; their values are tuples."""

    document: str
    rows: str
    made: _Made
    of: dict[str, Any] = {}


def counted(made: _Made) -> _Made:
    """A table that also has a line for the runs that failed."""

    def lines(rows: Sequence[Row]) -> list[str]:
        failed = [row for row in rows if "failed" in row.result]
        done = [row for row in rows if "failed" not in row.result]
        table = made(done) if done else table_exploration.header(("runs", "why"))
        if failed:
            why = "; ".join(f"{' '.join(map(str, row.asked.values()))}: {row.result['failed']}" for row in failed)
            end, empty = [*table, ""].index(""), " |" * (table[0].count("|") - 3)
            table.insert(end, f"| {len(failed)} of {len(rows)} runs failed | {why.replace('|', ' ')} |{empty}")
        return table

    return lines


_LIMITS = {"until": 0.9, "time_s": 800.0, "way_m": 120.0}
_LAB = {"world": "lab", "strategy": "views", "noise": 0, "seed": range(100, 120), **_LIMITS}
_LIVE = {**_LAB, "seed": range(100, 110), "way_m": None}
_STRATEGIES = {"strategy": ("views", "nearest", "tour"), "seed": range(100, 120), **_LIMITS}
_DRIVES = {"world": "lab", "seed": range(100, 120), "noise": 0, "dataset": (1, 2)}
_BASES = ("kobuki", "create", "create2")
_CABLE = ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
_NODES = (
    "mobile_base", "follower", "move_base", "explore", "camera", "vslam", "rosmaster", "watchdog",
    "mobile_base+watchdog",
)  # fmt: skip
_ENDS = tuple(
    (node, how)
    for node, how in product(_NODES, ("killed", "hung", "stopped"))
    if how != "stopped" or "watchdog" not in node
)
_DISKS = ("full", "full for 3 s", "no inode left", "read-only", "run folder deleted")
_ENCODERS = (("left", "right", "both"), ("dead", "stuck", "double", "backwards"))
_GYRO = (("gyro",), ("stuck", "one wrong report", "drift to the left", "drift to the right", "wrong sign"))
_SENSORS = (*product(_BASES, *_ENCODERS), *product(("kobuki", "create"), *_GYRO))
_MOTIONS = ("line", "reverse", "arc", "right arc", "spot turn")
_WHEELS = (
    "as built", "both count 10 % too much", "both 10 % too little", "the left one 10 % too much", "5 % each way",
    "as built, up to 10 % slip",
)  # fmt: skip


def _readers() -> tuple[str, ...]:
    from file_readers import READERS

    return tuple(reader.name for reader in READERS)


def _faults(rows: str, made: _Made, **of: Any) -> Table:
    return Table("docs/reliability.md", rows, counted(made), of)


TABLES: dict[str, Table] = {
    "nodes": _faults("fault_nodes", table_faults.nodes, **{"node how": _ENDS}, repetition=range(20)),
    "bases": _faults("fault_bases", table_faults.bases, base=_BASES, fault=_CABLE, repetition=range(5)),
    "cameras": _faults("fault_cameras", table_faults.cameras, fault=_CABLE),
    "robots": _faults("fault_camera", table_faults.robots, fault=("unplugged", *_CABLE), repetition=range(5)),
    "masters": _faults("fault_master", table_faults.masters, away_s=(0.5, 1.0, 5.0, 30.0), repetition=range(20)),
    "posts": _faults("fault_obstacle", table_faults.posts, ahead_m=0.5, repetition=range(20)),
    "operators": _faults(
        "fault_operator",
        table_faults.operators,
        what=("emergency stop", "teleop", "goal"),
        held_s=300.0,
        repetition=range(10),
    ),
    "disks": _faults(
        "fault_disk",
        table_faults.disks,
        how=("live", "lockstep"),
        fault=_DISKS,
        ended_by=("its time", "SIGINT", "SIGTERM"),
        repetition=range(2),
    ),
    "sensors": _faults("fault_sensors", table_faults.sensors, **{"base sensor fault": _SENSORS}, motion=_MOTIONS),
    "files": _faults("fuzz_files", table_faults.files, reader=_readers, block=range(10), mutations=1000),
    "soaks": _faults(
        "soak_stack", table_faults.soaks, kinds=["camera", "base", "node", "master", "disk"], minutes=60.0
    ),
    "alarms": _faults("fault_alarms", table_faults.alarms, wheels=_WHEELS, base=_BASES, minutes=5.0),
    "table 1": Table("docs/results.md", "drives", table_paper.table1, _DRIVES),
    "U2": Table("docs/paper.md", "drives", table_paper.u2, _DRIVES),
    "totals": Table("README.md", "exploration", table_exploration.brief, _LAB),
    "live brief": Table("README.md", "exploration_live", table_exploration.brief, _LIVE),
    "strategies": Table("docs/results.md", "exploration_strategy", table_exploration.strategies, _STRATEGIES),
    "free cells": Table("docs/results.md", "free_cells", table_free_cells.table, {"seed": range(100, 120)}),
    "exploration": Table("docs/results.md", "exploration", table_exploration.runs, _LAB),
    "exploration totals": Table("docs/results.md", "exploration", table_exploration.totals, _LAB),
    "growth": Table("docs/results.md", "exploration", table_exploration.growth, _LAB),
    "live": Table("docs/results.md", "exploration_live", table_exploration.runs, _LIVE),
    "live totals": Table("docs/results.md", "exploration_live", table_exploration.totals, _LIVE),
    "docking": Table(
        "docs/results.md",
        "docking",
        counted(table_docking.docking),
        {"seed": range(100, 200), "base": _BASES, "shifted": (False, True)},
    ),
    "charging": Table("docs/results.md", "charging", counted(table_docking.charging)),
    "zones": Table(
        "docs/results.md", "zones", counted(table_zones.zones), {"seed": range(100, 200), "nearest_m": 0.15}
    ),
    "resumed": Table(
        "docs/results.md", "resume", table_exploration.resumed, {"seed": range(100, 110), "time_s": 1200.0, "kills": 2}
    ),
}


def rooms_of(rows: str) -> list[Path]:
    """Folders and files of the code that these rows judge: the program and what it imports from the packages and beside
    it, without the modules that make tables. The packages are taken as a whole if it starts other processes."""
    if rows == "drives":  # by vsx reproduce
        return [_PACKAGES[0]]
    own: set[Path] = set()
    new = {_BESIDE[0] / f"{_PROGRAMS.get(rows, rows)}.py"}
    while new:
        own |= new
        new = {file for path in new for file in _imported(path)} - own
    if rows in _IN_PROCESS:
        return sorted(own)
    return [*_PACKAGES, *sorted(file for file in own if not any(map(file.is_relative_to, _PACKAGES)))]


@cache
def _imported(path: Path) -> list[Path]:
    """Files of ours that this file imports, also within functions."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return [file for name in names if not name.startswith("table") for file in _files_of(name)]


@cache
def _files_of(name: str) -> list[Path]:
    """The modules of ours that are loaded for a.b.c, where c may also be a name within a.b."""
    words, found = name.split("."), []
    for folder in (*_BESIDE, *(package.parent for package in _PACKAGES)):
        for number in range(1, len(words) + 1):
            module = folder.joinpath(*words[:number])
            found += [file for file in (module / "__init__.py", module.with_suffix(".py")) if file.exists()]
        if found:
            break
    return found


def campaign(rows: str, tasks: Sequence[Task], work: Work, out: Path | None = None) -> list[Result]:
    """Results of the tasks, one after the other; those are run that no row of the present code answers. out: another
    file for the rows."""
    return run_campaign(tasks, work, Store(out or RESULTS / f"{rows}.jsonl", rooms=rooms_of(rows)), Engine())


def newest(rows: Iterable[Row], of: dict[str, Any], whole: bool = True) -> list[Row]:
    """One row per question, all of one code and configuration: the newest that lacks nothing of ``of``; the very newest
    if all lack something, or if not ``whole``. Rows of others are never mixed in."""
    versions: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        if all(_asked(row, name) in _values(value) for name, value in of.items()):
            version = versions[key] = versions.pop(key := (row.code, row.config), {})
            version[str(sorted(row.asked.items()))] = row
    found = [list(version.values()) for version in reversed(versions.values())]
    return next((version for version in found if not (whole and lacking(version, of))), [*found, []][0])


def _values(of: Any) -> Sequence[Any]:
    if callable(of):
        return tuple(of())
    return of if isinstance(of, range | tuple) else (of,)


def _asked(row: Row, name: str) -> Any:
    """What a row was asked; a tuple for names with a space between."""
    each = tuple(row.asked.get(word) for word in name.split())
    return each if len(each) > 1 else each[0]


def lacking(rows: Sequence[Row], of: dict[str, Any]) -> str:
    """The published questions without a row, in words; empty if the rows are whole."""
    asked = [[_asked(row, name) for name in of] for row in rows]
    words = []
    for (name, value), known in zip(of.items(), zip(*asked, strict=True), strict=True):
        missing = [str(each) for each in _values(value) if each not in known]
        words += [f"{name} {', '.join(missing)}"] if missing else []
    if words:
        return "; ".join(words)
    questions = list(product(*map(_values, of.values())))
    known_ones = set(map(str, asked))
    lacks = [question for question in questions if str(list(question)) not in known_ones]
    first = ", ".join(f"{name} {value}" for name, value in zip(of, [*lacks, ()][0], strict=False))
    return f"{len(lacks)} of {len(questions)} ({first}{', ...' * (len(lacks) > 1)})" if lacks else ""


def caption(rows: Sequence[Row], file: str, lacks: str = "", newer: str = "") -> str:
    """Number, file, commits and dates of the rows. newer: of rows that do not count yet, in words."""
    of = Counter((row.commit or "no commit", row.dirty, row.when[:10]) for row in rows)
    commits: dict[tuple[str, bool | None], list[str]] = {}
    for commit, dirty, day in of:
        commits.setdefault((commit, dirty), []).append(day)
    words = []
    for (commit, dirty), days in commits.items():
        how = {None: " or before", True: " with changes", False: ""}[dirty]
        first, last = min(days), max(days)
        words.append(f"{commit[:7]}{how} ({first if first == last else f'{first} to {last}'})")
    without, later = f", without {lacks}" if lacks else "", f"; {newer}" if newer else ""
    return f"*{len(rows)} rows of `benchmarks/results/{file}.jsonl`{without}; commit {', '.join(words)}{later}.*"


def block(name: str, whole: bool = True) -> list[str] | None:
    """The lines between the marks; None without rows, and then the document is unchanged. whole: as ``newest``."""
    table = TABLES[name]
    kept = read_rows(RESULTS / f"{table.rows}.jsonl", tell)
    rows, last = newest(kept, table.of, whole), newest(kept, table.of, whole=False)
    newer = ""
    if rows != last:
        newer = f"{len(last)} newer rows, of {(last[0].commit or 'no commit')[:7]}, lack {lacking(last, table.of)}"
        tell(f"{name}: {newer}; until then {table.document} keeps the last whole table")
    if kept and not rows:
        tell(f"{name}: no row of {table.rows}.jsonl answers one of the published questions")
    return [*table.made(rows), "", caption(rows, table.rows, lacking(rows, table.of), newer)] if rows else None


def placed(text: str, name: str, lines: Sequence[str]) -> str:
    """The document with these lines between the marks."""
    begin, end = f"<!-- {name} begin -->\n", f"<!-- {name} end -->"
    head, found, rest = text.partition(begin)
    _, ended, tail = rest.partition(end)
    if not (found and ended):
        raise SystemExit(f"{TABLES[name].document} has no marks of table {name!r}: {begin.strip()} and {end}")
    return head + begin + "\n".join(lines) + "\n" + end + tail


def render() -> None:
    for name, table in TABLES.items():
        document = ROOT / table.document
        lines = block(name)
        if lines is None:
            tell(f"{name}: what stands in {table.document} stays")
        else:
            document.write_text(placed(document.read_text(), name, lines))


def stale(name: str) -> str:
    """Why the table is older than the code it judges, in a sentence; empty if it is not."""
    table = TABLES[name]
    rows = newest(read_rows(RESULTS / f"{table.rows}.jsonl", tell), table.of)
    rooms = rooms_of(table.rows)
    config = drive.CONFIG if table.rows == "drives" else Config()
    old = [row for row in rows if (row.code, row.config) != (code_hash(rooms), config_hash(config))]
    if rows and not old:
        return ""
    if not rows:
        return f"{name} ({table.document}): no rows are kept"
    changes = []
    for commit in dict.fromkeys(row.commit for row in old if row.commit):
        log = subprocess.run(
            ["git", "log", "--oneline", f"{commit}..HEAD", "--", *map(str, rooms)],
            cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        since = f"{len(log.stdout.splitlines())} commits" if log.returncode == 0 else "an unknown number of commits"
        changes.append(f"{since} since {commit[:7]}")
    count = f"{len(old)} of {len(rows)} rows"
    return f"{name} ({table.document}): {count} are of other code or configuration; {', '.join(changes)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("render", "stale", "show"))
    parser.add_argument("names", nargs="*", metavar="NAME", help="show: which tables; default: all")
    args = parser.parse_args()
    if unknown := [name for name in args.names if name not in TABLES or args.what != "show"]:
        parser.error(f"{args.what} takes no {unknown[0]!r}; 'show' takes some of: {', '.join(TABLES)}")
    if args.what == "render":
        render()
    elif args.what == "stale":
        print("\n".join(filter(None, map(stale, TABLES))) or "every table is of the present code")
    else:
        for name in args.names or TABLES:
            print(name, "", *(block(name, whole=False) or ["no rows are kept"]), "", sep="\n")


if __name__ == "__main__":
    main()
