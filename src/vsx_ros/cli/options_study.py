"""The options of the commands that plan, judge and compare; the docstring of each is its help."""

import argparse
from pathlib import Path

from vsx_ros.cli.option_values import (
    PLANNERS,
    add_engine,
    add_parameters,
    count,
    map_file,
    phi,
    pose,
    positive,
    seed,
    seeds,
)

EXPERIMENTS = ("table1", *(f"fig{k}" for k in range(2, 8)))  # of the paper


def plan(parser: argparse.ArgumentParser) -> None:
    """plan one motion from pose to pose and prove what it promises

    Plans from pose to pose, in a map or on open floor, and prints the certificate and the time. The zones beside the
    map (lab_zones.yaml beside lab.yaml) are obeyed as a robot obeys them.

    example: vsx plan --start 0,0,0 --goal 2,-1,90 --phi 1 --plot plan.png"""
    add = parser.add_argument
    add("--start", type=pose, required=True, metavar="X,Y,DEG", help="metres and degrees")
    add("--goal", type=pose, required=True, metavar="X,Y,DEG", help="metres and degrees")
    add("--map", type=map_file, metavar="map.yaml|RUN", help="a map as map_server keeps it, or a run; else open floor")
    add("--phi", type=phi, metavar="RAD_PER_M", help="greatest change of view per metre driven")
    add("--planner", choices=PLANNERS, default="fov", metavar="fov|unconstrained|paper", help="motion planner (fov)")
    add("--seed", type=seed, default=0, help="of the randomised searches (default 0)")
    add("--json", action="store_true", help="print everything as JSON")
    add("--plot", type=Path, metavar="FILE", help="write a picture (.png or .jpg)")
    add_parameters(parser)


def evaluate(parser: argparse.ArgumentParser) -> None:
    """ATE, RPE, scale, coverage, map quality, U1, U2 and breaks of a run; or of two TUM files

    Compares a run folder with its ground truth, or any estimated trajectory with a true one. Trajectories are text
    files in TUM format (stamp tx ty tz qx qy qz qw).

    examples: vsx evaluate runs/today | vsx evaluate --estimate a.txt --truth b.txt --align sim3"""
    add = parser.add_argument
    add("run_folder", type=Path, nargs="?", metavar="RUN", help="a run folder")
    add("--estimate", type=Path, metavar="F", help="estimated trajectory")
    add("--truth", type=Path, metavar="F", help="true trajectory (default: the run's groundtruth.txt)")
    add(
        "--align", choices=("se3", "sim3", "yaw"),
        help="what the alignment may change: rotation and position (default of files), also size (of a run without "
        "odometry), or heading and position (of other runs)",
    )  # fmt: skip
    add("--max-gap", type=positive, default=0.02, metavar="S", help="largest gap between stamps (0.02)")
    add("--json", action="store_true", help="print JSON")


def report(parser: argparse.ArgumentParser) -> None:
    """write the report of a run folder, or compare two

    Writes report.html, one self-contained page: what happened, why it ended, the map, the trajectory, tracking
    over time, every number, and the command that repeats the run. With a second run, a page that shows both side by
    side, and the differences in numbers and settings.

    examples: vsx report runs/today | vsx report runs/before runs/after --out compared.html"""
    parser.add_argument("run_folder", type=Path, metavar="RUN", help="a run folder")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="another one, to compare with")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the comparison (default compared.html in OTHER)")


def reproduce(parser: argparse.ArgumentParser) -> None:
    """make the paper's table and figures again

    table1: drives of many worlds to goals that look elsewhere, by the constrained planner, by one that turns on the
    spot and by the paper's own, tracked as in the paper and by the full tracker. fig2, fig6: their paths, planned and
    tracked. fig3: states to which one segment leads. fig4: points, planes and surface. fig5: the sparse and the dense
    ground map beside the truth. fig7: the map at stages of an exploration. Each writes a self-contained page
    and its numbers. Ctrl-C interrupts, the same command continues.

    examples: vsx reproduce all --quick | vsx reproduce table1 --seeds 100:120 --jobs 2 | vsx reproduce fig5 --seeds
    101:102 --time 90"""
    add = parser.add_argument
    add("what", metavar="WHAT", choices=(*EXPERIMENTS, "all"), help=", ".join((*EXPERIMENTS, "all")))
    add("--world", default="lab", metavar="NAME", help="lab, office, corridor, building or a file")
    add("--seeds", type=seeds, metavar="A:B", help="worlds A to B - 1 (default 100:120; figures: A)")
    add("--seed", type=seed, metavar="N", help="the same as --seeds N:N+1")
    add("--noises", type=count, default=1, metavar="K", help="drives of each with other noise (default 1)")
    add("--time", type=positive, metavar="S", help="emulated time of fig4, fig5 (90), fig7 (600)")
    add("--quick", action="store_true", help="two worlds and a minute: done in some minutes")
    add("--out", type=Path, default=Path("results"), metavar="FOLDER", help="default: results")
    add_engine(parser)


def sweep(parser: argparse.ArgumentParser) -> None:
    """explore many worlds, compare planners and settings

    Explores every world with every seed and planner, in lock-step, one after the other in this process, in several
    processes (--jobs), or by a dask scheduler's workers (--scheduler), and writes results.jsonl (one line per run when
    it ends), sweep.csv and sweep.html. Ctrl-C interrupts, the same command continues with the missing runs.

    examples: vsx sweep --worlds lab,corridor --seeds 0:20 --jobs 2 | vsx sweep --seeds 100:400 --planners
    fov,unconstrained --scheduler tcp://10.0.0.5:8786"""
    add = parser.add_argument
    add("--worlds", default="lab", metavar="NAME,...", help="lab, office, corridor, building, or files")
    add("--seeds", type=seeds, default=range(20), metavar="A:B", help="A to B - 1 (default 0:20)")
    add("--planners", default="fov", metavar="NAME,...", help="fov, unconstrained, paper or a plug-in's (fov)")
    add("--time", type=positive, default=600.0, metavar="S", help="emulated time of each (default 600)")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="override a parameter")
    add("--out", type=Path, default=Path("sweep"), metavar="FOLDER", help="default: sweep")
    add_engine(parser)
