"""``vsx reproduce`` and ``vsx sweep``: many runs, and report pages of them."""

import argparse
import itertools
import json
from typing import Any

import msgspec

from vsx_ros import __version__
from vsx_ros.cli.option_values import refuse
from vsx_ros.cli.options_study import EXPERIMENTS
from vsx_ros.errors import ConfigError, explained
from vsx_ros.evaluation.page import Section, page
from vsx_ros.experiments import drive, exploration, ground_maps, path_figures, table1
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store, made_by
from vsx_ros.io.atomic import write_text
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.runs.parameters import load
from vsx_ros.runs.world import open_world

_QUICK_SEEDS, _QUICK_TIME_S = 2, 60.0  # of --quick: only checks that everything runs


def reproduce(args: argparse.Namespace) -> int:
    """Make the requested pages and print where they are."""
    if args.seed is not None:
        refuse(args, "--seed chooses one world", "seeds")
    if args.seeds is None:
        args.seeds = range(100, 120) if args.seed is None else range(args.seed, args.seed + 1)
    if args.quick:
        args.seeds, args.time = args.seeds[:_QUICK_SEEDS], args.time or _QUICK_TIME_S
    open_world(args.world, args.seeds[0])  # report a mistake before making anything
    with explained(ConfigError, f"folder {args.out} cannot be made", "choose another --out", OSError):
        args.out.mkdir(parents=True, exist_ok=True)
    made = f"Made by {made_by()}; {args.world}, "
    all_seeds, seed = _in_words(args.seeds), _in_words(args.seeds[:1])
    sections = []
    for name in EXPERIMENTS if args.what == "all" else [args.what]:
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
    """One section of a page, and its numbers."""
    world, seed, short_s = args.world, args.seeds[0], args.time or 90.0
    makers = {
        "table1": lambda: _table1(args),
        "fig2": lambda: path_figures.figure2(world, seed),
        "fig3": lambda: path_figures.figure3(seed),
        "fig4": lambda: ground_maps.figure4(world, seed, short_s),
        "fig5": lambda: ground_maps.figure5(world, seed, short_s),
        "fig6": lambda: path_figures.figure6(_drives(args, [seed])),
        "fig7": lambda: exploration.figure7(*exploration.explore_in_stages(world, seed, args.time or 600.0)),
    }
    return makers[name]()


def _table1(args: argparse.Namespace) -> tuple[Section, dict[str, Any]]:
    drives = _drives(args, list(args.seeds))
    write_text(args.out / "table1.csv", table1.as_csv(drives))
    numbers = msgspec.to_builtins(table1.numbers(drives))
    return table1.table_section(drives), {**numbers, "faults": table1.faults(drives)}


def _drives(args: argparse.Namespace, worlds: list[int]) -> list[Any]:
    """Tasks with their results; known results come from drives.jsonl."""
    tasks = [drive.DriveTask(args.world, seed, k, d) for seed in worlds for k in range(args.noises) for d in (1, 2)]
    store, engine = Store(args.out / "drives.jsonl", drive.CONFIG), Engine(args.jobs, args.scheduler)
    return list(zip(tasks, run_campaign(tasks, drive.run_drives, store, engine), strict=True))


def sweep(args: argparse.Namespace) -> int:
    """Do all missing runs, then write the page."""
    planners, worlds = args.planners.split(","), args.worlds.split(",")
    config = load(None, args.set)  # report mistakes in --set, --worlds or --planners before hundreds of runs fail
    for planner in planners:
        PLANNERS[planner]
    for world in worlds:
        open_world(world, args.seeds[0])
    settings = tuple(args.set)
    tasks = [
        exploration.ExplorationTask(world=world, seed=seed, planner=planner, time_s=args.time, settings=settings)
        for seed, world, planner in itertools.product(args.seeds, worlds, planners)
    ]
    store, engine = Store(args.out / "results.jsonl", config), Engine(args.jobs, args.scheduler)
    runs = list(zip(tasks, run_campaign(tasks, exploration.explore, store, engine), strict=True))
    write_text(args.out / "sweep.csv", exploration.as_csv(runs))
    facts = (
        f"Made by {made_by()}: {args.worlds}, seeds {args.seeds.start} to {args.seeds.stop - 1}, "
        f"{args.planners}, {args.time:g} s each; {' '.join(settings) or 'default settings'}."
    )
    write_text(args.out / "sweep.html", page("Sweep", facts, [exploration.section(runs)]))
    print(f"page: {args.out / 'sweep.html'}")
    return 0
