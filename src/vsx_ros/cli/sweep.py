"""``vsx sweep``: explore many worlds, compare planners and settings

Explores every world with every seed and planner, in lock-step, one after the other in this process, in several
processes (--jobs), or by a dask scheduler's workers (--scheduler), and leaves results.jsonl (a line a run, as it ends),
sweep.csv and sweep.html. Ctrl-C interrupts, the same command continues with what is missing.

examples: vsx sweep --worlds lab,corridor --seeds 0:20 --jobs 2 | vsx sweep --seeds 100:400 --planners fov,unconstrained
--scheduler tcp://10.0.0.5:8786
"""

import argparse
from pathlib import Path

from vsx_ros.cli.reproduce import add_engine_arguments, seeds
from vsx_ros.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add = parser.add_argument
    add("--worlds", default="lab", metavar="NAME,...", help="lab, office, corridor, building, or files")
    add("--seeds", type=seeds, default=range(20), metavar="A:B", help="A to B - 1 (default 0:20)")
    add("--planners", default="fov", metavar="NAME,...", help="fov, unconstrained, paper or a plug-in's (fov)")
    add("--time", type=float, default=600.0, metavar="S", help="emulated time of each (default 600)")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="override a parameter")
    add("--out", type=Path, default=Path("sweep"), metavar="FOLDER", help="default: sweep")
    add_engine_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """All runs that are missing, then the page."""
    from vsx_ros.evaluation.page import page
    from vsx_ros.experiments import sweeps
    from vsx_ros.experiments.campaign import Engine, run_campaign
    from vsx_ros.experiments.exploration import ExplorationTask, explore
    from vsx_ros.experiments.rows import Store, made_by
    from vsx_ros.io.atomic import write_text
    from vsx_ros.planning.planners import PLANNERS
    from vsx_ros.runs.parameters import load
    from vsx_ros.runs.world import open_world

    planners, worlds = args.planners.split(","), args.worlds.split(",")
    for name, value in (("jobs", args.jobs), ("time", args.time)):
        if not value > 0:
            raise ConfigError(f"--{name} {value:g}: give a positive number")
    config = load(None, args.set)  # a mistake in --set, --worlds or --planners is told before hundreds of runs fail
    for planner in planners:
        PLANNERS[planner]
    for world in worlds:
        open_world(world, args.seeds[0])
    settings = tuple(args.set)
    tasks = [
        ExplorationTask(world, seed, planner, args.time, settings)
        for seed in args.seeds
        for world in worlds
        for planner in planners
    ]
    engine = Engine(args.jobs, args.scheduler)
    results = run_campaign(tasks, explore, Store(args.out / "results.jsonl", config), engine)
    runs = list(zip(tasks, results, strict=True))
    write_text(args.out / "sweep.csv", sweeps.as_csv(runs))
    facts = (
        f"Made by {made_by()}: {args.worlds}, seeds {args.seeds.start} to {args.seeds.stop - 1}, "
        f"{args.planners}, {args.time:g} s each; {' '.join(settings) or 'default settings'}."
    )
    write_text(args.out / "sweep.html", page("Sweep", facts, [sweeps.section(runs)]))
    print(f"page: {args.out / 'sweep.html'}")
    return 0
