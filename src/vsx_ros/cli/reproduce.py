"""``vsx reproduce``: the paper's table and figures made anew, in emulation, with the numbers behind them."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from vsx_ros.errors import ConfigError

WHAT = ("table1", "fig2", "fig5", "fig6", "fig7", "all")
_QUICK_SEEDS, _QUICK_TIME_S = 2, 60.0


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "reproduce",
        help="make the paper's table and figures anew",
        description="table1: drives of many worlds to goals that look elsewhere, by the constrained planner and by one "
        "that turns on the spot, tracked as in the paper and by the full tracker. fig2, fig6: their paths, planned and "
        "tracked. fig5: the sparse and the dense ground map beside the truth. fig7: the map at stages of an "
        "exploration. Each leaves a page that needs nothing else, and its numbers. Ctrl-C interrupts, the same command "
        "continues.",
        epilog="examples: vsx reproduce all --quick   |   vsx reproduce table1 --seeds 100:120 --jobs 2   |   "
        "vsx reproduce fig5 --seeds 101:102 --time 90",
    )
    parser.add_argument("what", metavar="WHAT", choices=WHAT, help=", ".join(WHAT))
    parser.add_argument("--world", default="lab", metavar="NAME", help="lab, office, corridor, building or a file")
    parser.add_argument("--seeds", type=seeds, metavar="A:B", help="worlds A to B - 1 (default 100:120; figures: A)")
    parser.add_argument("--seed", type=int, metavar="N", help="the same as --seeds N:N+1")
    parser.add_argument(
        "--noises", type=int, default=1, metavar="K", help="drives of each with other noise (default 1)"
    )
    parser.add_argument("--time", type=float, metavar="S", help="emulated time of fig5 (90) and fig7 (600)")
    parser.add_argument("--quick", action="store_true", help="two worlds and a minute: done in some minutes")
    parser.add_argument("--out", type=Path, default=Path("results"), metavar="FOLDER", help="default: results")
    add_engine_arguments(parser)
    parser.set_defaults(run=run)


def add_engine_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the work is done."""
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes on this machine (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a dask scheduler with workers on other machines")


def seeds(text: str) -> range:
    """A:B as a range."""
    match = re.fullmatch(r"(\d+):(\d+)", text)
    if match is None or int(match[1]) >= int(match[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is no range of seeds; write A:B, e.g. 100:120")
    return range(int(match[1]), int(match[2]))


def run(args: argparse.Namespace) -> int:
    """Make what was asked for, and say where it is."""
    from vsx_ros.evaluation.page import page
    from vsx_ros.experiments.rows import made_by
    from vsx_ros.io.atomic import write_text
    from vsx_ros.runs.world import open_world

    if args.time is not None and not args.time > 0:
        raise ConfigError(f"--time {args.time}: give a positive number of seconds")
    for name, value in (("jobs", args.jobs), ("noises", args.noises)):
        if value < 1:
            raise ConfigError(f"--{name} {value}: give a number of at least 1")
    if args.seeds is None:
        args.seeds = range(100, 120) if args.seed is None else range(args.seed, args.seed + 1)
    if args.quick:
        args.seeds, args.time = args.seeds[:_QUICK_SEEDS], args.time or _QUICK_TIME_S
    open_world(args.world, args.seeds[0])  # a mistake is told before anything is made
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"folder {args.out} cannot be made ({error.strerror}); choose another --out") from error
    makers = {"table1": _table1, "fig2": _fig2, "fig5": _fig5, "fig6": _fig6, "fig7": _fig7}
    names = [name for name in makers if args.what in (name, "all")]
    made = f"Made by {made_by()}; {args.world}, "
    all_seeds, seed = _in_words(args.seeds), _in_words(args.seeds[:1])
    sections = []
    for name in names:
        section = makers[name](args)
        sections.append(section)
        facts = f"{made}{all_seeds if name == 'table1' else seed}."
        write_text(args.out / f"{name}.html", page(section.title, facts, [section]))
        print(f"page: {args.out / name}.html")
    if args.what == "all":
        facts = f"{made}{all_seeds} for Table 1, {seed} for the figures."
        write_text(args.out / "paper.html", page("The paper's experiments", facts, sections))
        print(f"page: {args.out / 'paper.html'}")
    return 0


def _in_words(chosen: range) -> str:
    return f"seed {chosen[0]}" if len(chosen) == 1 else f"seeds {chosen[0]} to {chosen[-1]}"


def _write_numbers(args: argparse.Namespace, name: str, numbers: dict[str, Any]) -> None:
    """NAME.json, with what its numbers rest on."""
    import json

    from vsx_ros import __version__
    from vsx_ros.experiments.rows import made_by
    from vsx_ros.io.atomic import write_text

    chosen = {"seeds": list(args.seeds), "noises": args.noises} if name == "table1" else {"seed": args.seeds[0]}
    tree = {"version": __version__, "made_by": made_by(), "world": args.world, **chosen, **numbers}
    write_text(args.out / f"{name}.json", json.dumps(tree, indent=1) + "\n")


def _table1(args: argparse.Namespace) -> Any:
    import msgspec

    from vsx_ros.experiments import table1
    from vsx_ros.experiments.drive import ARMS
    from vsx_ros.io.atomic import write_text

    drives = _drives(args, list(args.seeds))
    write_text(args.out / "table1.csv", table1.as_csv(drives))
    numbers = msgspec.to_builtins(table1.numbers(drives))
    _write_numbers(args, "table1", {**numbers, "faults": table1.faults(drives)})
    for tracker, datasets in numbers.items():
        u1, u2, broken = (datasets["both"][name] for name in ("u1", "u2_frames", "broken"))
        shown = "  ".join(f"{arm} {_of(u1[arm])}/{_of(u2[arm])}/{_of(broken[arm])}" for arm in ARMS)
        print(f"tracker {tracker}: U1/U2/broken  {shown}")
    return table1.table_section(drives)


def _of(interval: Any) -> str:
    return "unknown" if interval is None else f"{interval[0]:.3g}"


def _fig2(args: argparse.Namespace) -> Any:
    from vsx_ros.experiments.drive import DriveTask
    from vsx_ros.experiments.drive_figures import figure2_section

    return figure2_section([DriveTask(args.world, args.seeds[0], args.seeds[0], k) for k in (1, 2)])


def _fig6(args: argparse.Namespace) -> Any:
    from vsx_ros.experiments.drive_figures import figure6_section

    section, drives = figure6_section(_drives(args, [args.seeds[0]]))
    _write_numbers(args, "fig6", {"drives": drives})
    return section


def _drives(args: argparse.Namespace, worlds: list[int]) -> list[Any]:
    """Tasks with their results, those that are known from results/drives.jsonl."""
    from vsx_ros.experiments.campaign import Engine, run_campaign
    from vsx_ros.experiments.drive import DriveTask, run_drives
    from vsx_ros.experiments.rows import Store

    noises = range(args.noises)
    tasks = [DriveTask(args.world, seed, seed + 1000 * k, d) for seed in worlds for k in noises for d in (1, 2)]
    engine = Engine(args.jobs, args.scheduler)
    return list(zip(tasks, run_campaign(tasks, run_drives, Store(args.out / "drives.jsonl"), engine), strict=True))


def _fig7(args: argparse.Namespace) -> Any:
    from vsx_ros.experiments.stages import explore_in_stages, figure7

    section, numbers = figure7(*explore_in_stages(args.world, args.seeds[0], args.time or 600.0))
    _write_numbers(args, "fig7", numbers)
    return section


def _fig5(args: argparse.Namespace) -> Any:
    from vsx_ros.evaluation.figure5 import section
    from vsx_ros.experiments.ground_maps import explore_and_map

    figure, numbers = explore_and_map(args.world, args.seeds[0], args.time or 90.0)
    _write_numbers(args, "fig5", numbers)
    for name, values in list(numbers.items())[1:]:
        print(f"{name}: " + ", ".join(f"{k} {v:.4f}" for k, v in values.items() if v is not None))
    return section(figure)
