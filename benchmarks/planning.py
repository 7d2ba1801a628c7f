"""How well and how fast motion planning works: ``python benchmarks/planning.py [--quick] [--phi 0.5] [section ...]``,
src and hw in PYTHONPATH.

Sections: connect, lab, maps, costs, time, paper (all by default); at the end comes a table of required and desired
values. Seeds are fixed, so everything except the milliseconds repeats exactly. The peers (planning_problems.py) are
measured in the same run if installed, else skipped with a note. Times are processor time of this process, including
Python. tests/control measures how well trajectories are followed.
"""

import argparse
import math
import os
import sys
import time
from dataclasses import dataclass
from itertools import compress

import numpy as np
from planning_problems import (
    LIMITS,
    ROBOT,
    TOPPRA,
    OmplPeer,
    Question,
    map_names,
    map_problems,
    ompl_peer,
    peer_toppra,
    problems,
    random_goals,
)

from vsx_ros.config import PlannerConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.planning.coarse_path import shortest_word
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Plan, Trajectory
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.planners import UnconstrainedPlanner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.planning.two_level_qp import connect_paper, feasible

PHIS = [0.5, 1.0, 2.0]
_OPTIMAL_EACH = 10  # of the questions in labs, for the planners that take a second each


@dataclass(frozen=True)
class Row:
    """A line of the table; ``least``: the measured value must be at least ``must``, else at most."""

    what: str
    must: float
    aim: float
    measured: float
    least: bool = False

    def meets(self, bound: float) -> bool:
        return self.measured >= bound if self.least else self.measured <= bound

    def __str__(self) -> str:
        word = "aim" if self.meets(self.aim) else "must" if self.meets(self.must) else "MISSED"
        return f"{self.what:58s} {self.must:12.7g} {self.aim:12.7g} {self.measured:12.7g}  {word}"


def percentiles(values: list[float], scale: float = 1.0) -> str:
    p50, p90, p99, most = np.percentile(np.array(values) * scale, [50, 90, 99, 100])
    return f"mean {np.mean(values) * scale:.3f}  median {p50:.3f}  p90 {p90:.3f}  p99 {p99:.3f}  max {most:.3f}"


def section_connect(quick: bool, phis: list[float]) -> list[Row]:
    """Free space: solved, certificate, length over the Reeds-Shepp length, time."""
    n, rows = 500 if quick else 10_000, []
    for phi in phis:
        goals = random_goals(n, 0)
        shortest = [shortest_word(SE2(), SE2(*goal.tolist()), phi).length_m for goal in goals]
        ratio, seconds, bound, end, words = [], [], 0.0, 0.0, 0
        for goal, least in zip(goals, shortest):
            begun = time.process_time()
            path = connect(SE2(), SE2(*goal.tolist()), phi)
            seconds.append(time.process_time() - begun)
            if isinstance(path, Path):
                ratio.append(path.length_m / least)
                bound = max(bound, path.certificate.curvature_bound_rad_m / phi)
                end = max(end, path.certificate.end_error_m, path.certificate.end_error_rad)
                words += path.certificate.method == "arcs and lines"
        print(f"phi {phi}: solved {len(ratio)}/{n}, {words} of them by arcs and lines")
        print(f"  length / Reeds-Shepp: {percentiles(ratio)}")
        print(f"  ms: {percentiles(seconds, 1e3)}")
        rows += [
            Row(f"connect, phi {phi}: solved [%]", 99.9, 100.0, 100.0 * len(ratio) / n, True),
            Row(f"connect, phi {phi}: bound / phi - 1", 1e-9, 1e-9, bound - 1.0),
            Row(f"connect, phi {phi}: end error [m or rad]", 1e-9, 1e-9, end),
            Row(f"connect, phi {phi}: median time [ms]", 5.0, 1.5, 1e3 * float(np.median(seconds))),
        ]
        if phi == 1.0:
            median, p99 = np.percentile(ratio, [50, 99])
            rows.append(Row("connect, phi 1.0: length / Reeds-Shepp, median", 1.01, 1.003, median))
            rows.append(Row("connect, phi 1.0: length / Reeds-Shepp, p99", 1.08, 1.03, p99))
    return rows


def section_lab(quick: bool, phis: list[float]) -> list[Row]:
    """Boxes and a wall: share solved of the solvable problems with this bound, time, length relative to OMPL's."""
    questions, rows, peer = problems(range(0, 20), 4) if quick else problems(range(100, 200), 10), [], ompl_peer()
    for phi in phis:
        config = PlannerConfig(phi_rad_m=phi)
        ours, generic = Planner(config, ROBOT), UnconstrainedPlanner(config, ROBOT)
        seconds, plans, joined = [], [], []
        for grid, start, goal in questions:
            begun = time.process_time()
            plan = ours.plan(start, goal, grid, np.random.default_rng(1))
            seconds.append(time.process_time() - begun)
            plans.append(plan.path if isinstance(plan, Plan) else None)
            joined.append(isinstance(generic.plan(start, goal, grid, np.random.default_rng(1)), Plan))
        solved = [path for path in plans if path is not None]
        smooth = sum(not path.jumps for path in solved)
        print(
            f"phi {phi}: {len(questions)} asked, {sum(joined)} joined, {len(solved)} solved, {smooth} of them smooth",
            flush=True,
        )
        print(f"  ms: {percentiles(seconds, 1e3)}")
        asked = list(compress(zip(questions, plans, seconds), joined))
        alone, compared = peer_rows(phi, asked, config, peer) if peer is not None else (0, [])
        share = 100.0 * len(solved) / (len(solved) + alone)
        rows += [
            Row(f"lab, phi {phi}: solved of what any planner solves [%]", 99.0, 99.5, share, True),
            Row(f"lab, phi {phi}: median time [ms]", 20.0, 8.0, 1e3 * float(np.median(seconds))),
            Row(f"lab, phi {phi}: p99 time [ms]", 300.0, 100.0, 1e3 * float(np.percentile(seconds, 99))),
            *compared,
        ]
    return rows


def peer_rows(
    phi: float, answered: list[tuple[Question, Path | None, float]], config: PlannerConfig, peer: OmplPeer
) -> tuple[int, list[Row]]:
    """OMPL on the same questions: how many it alone solved, and the rows of the table, on what both solve."""
    first = peer.answers([question for question, _, _ in answered], config, "RRTConnect", solve_s=10.0, simplify_s=0.5)
    alone = sum(path is None and way is not None for (_, path, _), way in zip(answered, first))
    both = [(seconds, path.length_m, *way) for (_, path, seconds), way in zip(answered, first) if path and way]
    took, length, peer_took, peer_length = np.mean(both, axis=0)
    print(f"  OMPL RRTConnect + simplify: {alone} solved by it alone; the mean of {len(both)} that both solve:")
    print(f"  {1e3 * took:.1f} ms, {length:.3f} m; OMPL {1e3 * peer_took:.1f} ms, {peer_length:.3f} m")
    for name, times in (("ours", [row[0] for row in both]), ("OMPL", [row[2] for row in both])):
        print(f"  ms of those, {name}: {percentiles(times, 1e3)}")
    some = answered[::_OPTIMAL_EACH]
    optimal = [
        peer.answers([question for question, _, _ in some], config, name, 1.0) for name in ("BITstar", "AITstar")
    ]
    least = [min((way[1] for way in ways if way), default=math.inf) for ways in zip(*optimal)]
    pairs = [(path.length_m, metres) for (_, path, _), metres in zip(some, least) if path and math.isfinite(metres)]
    mine, best = np.mean(pairs, axis=0)
    print(f"  the better of BIT* and AIT* after 1 s, mean of {len(pairs)} of {len(some)} that both solve:")
    print(f"  {mine:.3f} m; OMPL {best:.3f} m", flush=True)
    return alone, [
        Row(f"lab, phi {phi}: mean length / RRTConnect's", 0.93, 0.9, length / peer_length),
        Row(f"lab, phi {phi}: mean time / RRTConnect's", 0.8, 0.5, took / peer_took),
        Row(f"lab, phi {phi}: mean length / best of BIT*, AIT*", 1.0, 0.97, mine / best),
    ]


def section_maps(quick: bool, phis: list[float]) -> list[Row]:
    """Maps of real buildings: solved, needless stops, time, length and seconds of the drive."""
    rows = []
    for phi in phis:
        planner = Planner(PlannerConfig(phi_rad_m=phi), ROBOT)
        seconds, solved, stops, asked = [], 0, 0, 0
        for name in map_names(tuning=quick):
            paths, before = [], len(seconds)
            for grid, start, goal in map_problems(name, 20 if quick else 100):
                begun = time.process_time()
                plan = planner.plan(start, goal, grid, np.random.default_rng(1))
                seconds.append(time.process_time() - begun)
                paths += [plan.path] if isinstance(plan, Plan) else []
            n, jumps = len(seconds) - before, [path.jumps for path in paths]
            asked, solved, stops = asked + n, solved + len(paths), stops + sum(jumps)
            length_m = np.mean([path.length_m for path in paths])
            drive_s = np.mean([time_scale(path, LIMITS).duration_s for path in paths])
            cusps = np.mean([len(path.cusps) for path in paths])
            print(
                f"phi {phi}, {name}: {len(paths)}/{n} solved, {sum(jumps)} needless stops in {np.count_nonzero(jumps)}"
            )
            print(
                f"  {length_m:.2f} m, {drive_s:.2f} s, {cusps:.2f} cusps; ms: {percentiles(seconds[before:], 1e3)}",
                flush=True,
            )
        if asked:
            rows += [
                Row(f"maps, phi {phi}: solved [%]", 99.0, 100.0, 100.0 * solved / asked, True),
                Row(f"maps, phi {phi}: stops where nothing reverses", 0.0, 0.0, stops),
                Row(f"maps, phi {phi}: median time [ms]", 60.0, 25.0, 1e3 * float(np.median(seconds))),
                Row(f"maps, phi {phi}: p99 time [ms]", 400.0, 150.0, 1e3 * float(np.percentile(seconds, 99))),
            ]
    return rows


def section_costs(quick: bool, phis: list[float]) -> list[Row]:
    """Time to cost views: every pose of a map around its obstacles."""
    axes = np.arange(-5.95, 6.0, 0.1), np.arange(-3.95, 4.0, 0.1), np.arange(24) * (np.pi / 12.0)
    every = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    rows = []
    for phi in phis:
        config = PlannerConfig(phi_rad_m=phi)
        planner = Planner(config, ROBOT)
        seconds, ratio = [], []
        for grid, start, goal in problems(range(5 if quick else 20), 1):
            begun = time.process_time()
            planner.travel_costs(start, grid, config.clearance_m, every)
            seconds.append(time.process_time() - begun)
            cost = float(planner.travel_costs(start, grid, config.clearance_m, goal.as_array()[None])[0])
            plan = planner.plan(start, goal, grid, np.random.default_rng(0))
            if isinstance(plan, Plan) and np.isfinite(cost):
                ratio.append(cost / plan.path.length_m)
        print(f"phi {phi}: travel_costs of {len(every)} poses, ms: {percentiles(seconds, 1e3)}")
        print(f"  cost / planned length: {percentiles(ratio)}")
        rows.append(Row(f"every pose of a map, phi {phi}, median [ms]", 200.0, 80.0, 1e3 * float(np.median(seconds))))
    return rows


def excess(trajectory: Trajectory) -> float:
    """The largest of five quantities relative to its limit; rates are divided differences of the samples."""
    t = trajectory.times_s
    keep = np.append(True, np.diff(t) > 1e-6)
    t, v, omega = t[keep], trajectory.v[keep], trajectory.omega[keep]
    a, alpha, middle = np.diff(v) / np.diff(t), np.diff(omega) / np.diff(t), 0.5 * (t[1:] + t[:-1])
    jerk = np.diff(a) / np.diff(middle)
    named = (
        (v, LIMITS.v_m_s), (omega, LIMITS.omega_rad_s), (a, LIMITS.a_m_s2), (alpha, LIMITS.alpha_rad_s2),
        (jerk, LIMITS.jerk_m_s3),
    )  # fmt: skip
    return max(float(np.abs(values).max(initial=0.0)) / limit for values, limit in named)


def section_time(quick: bool, phis: list[float]) -> list[Row]:
    """Time scaling: duration relative to toppra's, milliseconds, the worst of five limits."""
    rows, n = [], 20 if quick else 200
    for phi in phis:
        ours, peer, seconds, worst = 0.0, 0.0, [], 0.0
        for goal in random_goals(n, 1):
            path = connect(SE2(), SE2(*goal.tolist()), phi)
            assert isinstance(path, Path)
            begun = time.process_time()
            trajectory = time_scale(path, LIMITS)
            seconds.append(time.process_time() - begun)
            ours += trajectory.duration_s
            peer += peer_toppra(path) if TOPPRA else 0.0
            worst = max(worst, excess(time_scale(path, LIMITS, sample_s=0.001)))
        print(f"phi {phi}: total {ours:.1f} s for {n} paths; ms: {percentiles(seconds, 1e3)}")
        rows.append(Row(f"time scaling, phi {phi}: worst of five limits at 1 kHz", 1.000001, 1.000001, worst))
        if TOPPRA:
            rows.append(Row(f"time scaling, phi {phi}: duration / toppra's", 1.1, 1.06, ours / peer))
    return rows


def section_paper(quick: bool, phis: list[float]) -> list[Row]:
    """The paper's method: reach, solved share of it, violation between grid points, time."""
    rows, n = [], 100 if quick else 1000
    for phi in phis:
        reachable, seconds, excess_ = 0, [], []
        for goal in random_goals(n, 2):
            pose = SE2(*goal.tolist())
            reachable += feasible(SE2(), pose, phi).ok or feasible(SE2(), pose, phi, reverse=True).ok
            begun = time.process_time()
            path = connect_paper(SE2(), pose, phi)
            if isinstance(path, Path):
                seconds.append(time.process_time() - begun)
                excess_.append(path.certificate.curvature_bound_rad_m / phi)
        print(
            f"phi {phi}: reachable {reachable}/{n}, solved {len(seconds)}; ms where solved: {percentiles(seconds, 1e3)}"
        )
        rows.append(Row(f"paper's method, phi {phi}: max curvature / phi", 1.001, 1.001, max(excess_)))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help="connect, lab, maps, costs, time, paper")
    parser.add_argument("--quick", action="store_true", help="a tenth of the questions")
    parser.add_argument("--phi", type=float, action="append", help="a bound on the change of view; may be repeated")
    args = parser.parse_args()
    todo = {
        "connect": section_connect, "lab": section_lab, "maps": section_maps, "costs": section_costs,
        "time": section_time, "paper": section_paper,
    }  # fmt: skip
    unknown = set(args.sections) - set(todo)
    if unknown:
        parser.error(f"there is no section {', '.join(sorted(unknown))}")
    if not TOPPRA:
        print("toppra is not installed: its columns are left out")
    warm_up("planning")
    rows = []
    for name in args.sections or todo:
        print(f"\n== {name} (load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)", flush=True)
        rows += todo[name](args.quick, args.phi or PHIS)
    print(f"\n{'quantity':58s} {'must':>12s} {'aim':>12s} {'measured':>12s}  meets")
    print(*rows, sep="\n", flush=True)
    sys.exit(0 if all(row.meets(row.must) for row in rows) else 1)


if __name__ == "__main__":
    main()
