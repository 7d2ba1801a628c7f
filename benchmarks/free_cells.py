"""Whether free cells are free as often as the ground map says, and what becomes of things that only a robot would hit.

    PYTHONPATH=src:hw python benchmarks/free_cells.py run [--seeds 100-119] [--slam] [--jobs 2]
    PYTHONPATH=src:hw python benchmarks/free_cells.py fit [--seeds 0-19] [--slam-seeds 20-22]
    PYTHONPATH=src:hw python benchmarks/free_cells.py draw

``run``: explores labs without the SLAM (as in exploration_strategy.py) until 30, 60 and 90 % are known, or with SLAM
and surfaces (``--slam``) for 60 s. For each free cell of the maps it compares the told probability of an obstacle with
the truth at the cell's centre. It also counts the cells with something between 0.1 and 0.6 m of height: thin things
(legs, poles: less than 0.03 m2) and others. Each run writes a row; ``tables.py`` makes the table, ``draw`` the diagram.
``fit``: prints the log-odds of ``vsx_ros.occupancy.certainty`` from tuning labs.
"""

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from certainty_bins import EDGES
from exploration_strategy import STRATEGIES, Run
from seeds import seed_range
from table_free_cells import diagram
from tables import RESULTS, ROOT, newest, rooms_of

from vsx_ros.config import Config
from vsx_ros.evaluation.map_quality import on_truth
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store, read_rows, tell
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy import certainty, ground_map
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world import World
from vsx_ros.system import ExplorationSystem

STAGES, WAY_M, TIME_S, SLAM_S = (0.3, 0.6, 0.9), 120.0, 600.0, (30.0, 60.0)
THIN_M2, LOW_M, HIGH_M = 0.03, 0.1, 0.6
RIDGE, ROUNDS = 1.0, 30  # of the fit: as if each level had been seen wrong and right half a time


class Looking(NamedTuple):
    """A lab, explored with the SLAM or without."""

    seed: int
    slam: bool


class Judged(NamedTuple):
    """Free cells of the maps of one exploration: told probability, level of each term, whether an obstacle is there.
    things: for thin and other ones the number of cells that the last map calls free, occupied and unknown."""

    told: np.ndarray
    levels: np.ndarray
    wrong: np.ndarray
    things: dict[str, list[int]]


def judged(task: Looking) -> Judged:
    world, levels = generate_world("lab", task.seed), []
    remembered = certainty.obstacle_probability

    def noted(data, evidence):
        levels[:] = [np.stack(evidence.levels(data), axis=1)]
        return remembered(data, evidence)

    ground_map.obstacle_probability = noted
    try:
        stages = [(grid, levels[0]) for grid in (_with_slam if task.slam else _without_slam)(world, task.seed)]
    finally:
        ground_map.obstacle_probability = remembered
    ground = Config().ground_map
    truth = ground_truth_grid(world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m)
    told = [grid.probability[grid.data == FREE] for grid, _ in stages]
    wrong = [_holds_something(grid, truth, world.start_pose) for grid, _ in stages]
    things = _things(stages[-1][0], world, ground.resolution_m)
    return Judged(np.concatenate(told), np.concatenate([seen for _, seen in stages]), np.concatenate(wrong), things)


def _without_slam(world: World, seed: int):
    run = Run(seed, STRATEGIES["views"])
    for until in STAGES:
        why = run.explore(until, WAY_M, TIME_S)
        run.curve.clear()  # the map is built now
        run._refresh()
        yield run._grid
        if why != "enough is known":
            return


def _with_slam(world: World, seed: int):
    config = Config()
    robot = EmulatedRobot(world, seed, SimulationConfig(threads=1), config.robot)
    system, command, stages = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, seed), STOP, 0
    while system.mission.outcome is None and stages < len(SLAM_S):
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > SLAM_S[stages]:
            stages += 1
            yield system.ground.grid(system.slam.snapshot())
        command = system.step(frame, odometry, "bumper pressed" if any(robot.body.bumper) else None).command


def _holds_something(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_map: SE2) -> np.ndarray:
    """Of each free cell, whether the truth is not free at its centre."""
    cells = truth.cells(T_truth_map @ grid.centres(np.argwhere(grid.data == FREE)))
    inside = truth.contains(cells)
    wrong = ~inside
    wrong[inside] = truth.data[tuple(cells[inside].T)] != FREE
    return wrong


def _things(grid: OccupancyGrid, world: World, resolution: float) -> dict[str, list[int]]:
    truth = ground_truth_grid(world, resolution, LOW_M, HIGH_M)
    values, solid = on_truth(grid, truth, world.start_pose), (truth.data != FREE).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    thin = stats[labels, cv2.CC_STAT_AREA] * resolution**2 < THIN_M2
    surface = truth.data == OCCUPIED
    return {
        name: [int(np.count_nonzero(values[surface & which] == value)) for value in (FREE, OCCUPIED, UNKNOWN)]
        for name, which in (("thin", thin), ("others", ~thin))
    }


def measured(task: Looking) -> dict[str, object]:
    """cells, wrong and told: number of free cells in each bin of told probability, of those with an obstacle, and the
    sum of the probabilities; things: of ``Judged``."""
    found = judged(task)
    into = np.digitize(found.told, EDGES[1:-1])
    counts = {
        name: np.bincount(into, values, len(EDGES) - 1)
        for name, values in (("cells", None), ("wrong", found.wrong), ("told", found.told))
    }
    return {name: np.round(values, 3).tolist() for name, values in counts.items()} | {"things": found.things}


def fit(tasks: list[Looking]) -> None:
    """Logistic regression with one indicator per level; a ridge keeps levels without errors finite."""
    found = []
    for task in tasks:
        found.append(judged(task))
        tell(f"{task}: {len(found[-1].told)} free cells, {np.mean(found[-1].wrong):.4f} hold something")
    levels = np.concatenate([one.levels for one in found])
    kinds, of, n = np.unique(levels, axis=0, return_inverse=True, return_counts=True)
    wrong = np.bincount(of.ravel(), np.concatenate([one.wrong for one in found]))
    sizes = [len(term.log_odds) for term in certainty.TERMS.values()]
    begins = np.concatenate([[1], 1 + np.cumsum(sizes)])
    X = np.zeros((len(kinds), begins[-1]))
    X[:, 0] = 1.0
    for k, begin in enumerate(begins[:-1]):
        X[np.arange(len(kinds)), begin + kinds[:, k]] = 1.0
    w, ridge = np.zeros(X.shape[1]), np.diag([1e-6, *np.full(X.shape[1] - 1, RIDGE)])
    for _ in range(ROUNDS):
        p = 1.0 / (1.0 + np.exp(-X @ w))
        H = (X * (n * p * (1.0 - p))[:, None]).T @ X + ridge
        w += np.linalg.solve(H, X.T @ (wrong - n * p) - ridge @ w)
    print(f"BIAS = {w[0]:.2f}\nTERMS = {{")
    for (name, term), begin, size in zip(certainty.TERMS.items(), begins, sizes):
        numbers = ", ".join(f"{x:.2f}" for x in w[begin : begin + size])
        print(f'    "{name}": Term({term.uppers}, ({numbers})),')
    print("}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "fit", "draw"))
    parser.add_argument("--seeds", type=seed_range, help="labs (run: 100-119, fit: 0-19)")
    parser.add_argument("--slam", action="store_true", help="run: with SLAM and surfaces, twenty times slower")
    parser.add_argument("--slam-seeds", type=seed_range, default=[], help="fit: labs explored with SLAM, too")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=RESULTS / "free_cells.jsonl")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.what == "fit":
        labs = args.seeds if args.seeds is not None else range(20)
        fit([*(Looking(seed, False) for seed in labs), *(Looking(seed, True) for seed in args.slam_seeds)])
    elif args.what == "run":
        tasks = [Looking(seed, args.slam) for seed in args.seeds or range(100, 120)]
        run_campaign(tasks, measured, Store(args.out, rooms=rooms_of("free_cells")), Engine(args.jobs))
    else:
        rows = newest(read_rows(args.out, tell), {})
        if not rows:
            sys.exit(f"{args.out} has no rows; run 'free_cells.py run' first")
        (ROOT / "docs/images/free_cells.svg").write_text(diagram(rows))


if __name__ == "__main__":
    main()
