"""``vsx reproduce``: make the paper's table and figures anew

table1: drives of many worlds to goals that look elsewhere, by the constrained planner, by one that turns on the spot
and by the paper's own, tracked as in the paper and by the full tracker. fig2, fig6: their paths, planned and tracked.
fig3: states to which one segment leads. fig4: points, planes and surface. fig5: the sparse and the dense ground map
beside the truth. fig7: the map at stages of an exploration. Each leaves a page that needs nothing else, and its
numbers. Ctrl-C interrupts, the same command continues.

examples: vsx reproduce all --quick | vsx reproduce table1 --seeds 100:120 --jobs 2 | vsx reproduce fig5 --seeds 101:102
--time 90
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsx_ros.errors import ConfigError, explained

if TYPE_CHECKING:
    from vsx_ros.evaluation.page import Section

WHAT = ("table1", *(f"fig{k}" for k in range(2, 8)), "all")
_QUICK_SEEDS, _QUICK_TIME_S = 2, 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add = parser.add_argument
    add("what", metavar="WHAT", choices=WHAT, help=", ".join(WHAT))
    add("--world", default="lab", metavar="NAME", help="lab, office, corridor, building or a file")
    add("--seeds", type=seeds, metavar="A:B", help="worlds A to B - 1 (default 100:120; figures: A)")
    add("--seed", type=int, metavar="N", help="the same as --seeds N:N+1")
    add("--noises", type=int, default=1, metavar="K", help="drives of each with other noise (default 1)")
    add("--time", type=float, metavar="S", help="emulated time of fig4, fig5 (90), fig7 (600)")
    add("--quick", action="store_true", help="two worlds and a minute: done in some minutes")
    add("--out", type=Path, default=Path("results"), metavar="FOLDER", help="default: results")
    add_engine_arguments(parser)


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
    import json

    from vsx_ros import __version__
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
    with explained(ConfigError, f"folder {args.out} cannot be made", "choose another --out", OSError):
        args.out.mkdir(parents=True, exist_ok=True)
    made = f"Made by {made_by()}; {args.world}, "
    all_seeds, seed = _in_words(args.seeds), _in_words(args.seeds[:1])
    sections = []
    for name in WHAT[:-1] if args.what == "all" else [args.what]:
        section, numbers = _made(name, args)
        sections.append(section)
        chosen = {"seeds": list(args.seeds), "noises": args.noises} if name == "table1" else {"seed": args.seeds[0]}
        tree = {"version": __version__, "made_by": made_by(), "world": args.world, **chosen, **numbers}
        write_text(args.out / f"{name}.json", json.dumps(tree, indent=1) + "\n")
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


def _made(name: str, args: argparse.Namespace) -> tuple[Section, dict[str, Any]]:
    """The section of a page, and its numbers."""
    from vsx_ros.experiments import drive_figures, favourable, ground_maps, stages

    world, seed, short_s = args.world, args.seeds[0], args.time or 90.0
    makers = {
        "table1": lambda: _table1(args),
        "fig2": lambda: drive_figures.figure2(world, seed),
        "fig3": lambda: favourable.figure3(seed),
        "fig4": lambda: ground_maps.figure4(world, seed, short_s),
        "fig5": lambda: ground_maps.figure5(world, seed, short_s),
        "fig6": lambda: drive_figures.figure6(_drives(args, [seed])),
        "fig7": lambda: stages.figure7(*stages.explore_in_stages(world, seed, args.time or 600.0)),
    }
    return makers[name]()


def _table1(args: argparse.Namespace) -> tuple[Section, dict[str, Any]]:
    import msgspec

    from vsx_ros.experiments import table1
    from vsx_ros.io.atomic import write_text

    drives = _drives(args, list(args.seeds))
    write_text(args.out / "table1.csv", table1.as_csv(drives))
    numbers = msgspec.to_builtins(table1.numbers(drives))
    return table1.table_section(drives), {**numbers, "faults": table1.faults(drives)}


def _drives(args: argparse.Namespace, worlds: list[int]) -> list[Any]:
    """Tasks with their results, those that are known from results/drives.jsonl."""
    from vsx_ros.experiments.campaign import Engine, run_campaign
    from vsx_ros.experiments.drive import CONFIG, DriveTask, run_drives
    from vsx_ros.experiments.rows import Store

    tasks = [DriveTask(args.world, seed, k, d) for seed in worlds for k in range(args.noises) for d in (1, 2)]
    store = Store(args.out / "drives.jsonl", CONFIG)
    return list(zip(tasks, run_campaign(tasks, run_drives, store, Engine(args.jobs, args.scheduler)), strict=True))
