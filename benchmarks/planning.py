"""How well and how fast motion planning works: ``PYTHONPATH=src:hw python benchmarks/planning.py [section ...]``.

Sections: connect, lab, costs, time, paper (all when none is given). Seeds are fixed, so everything but the milliseconds
repeats exactly. Peers (OMPL's RRTConnect with its simplification, toppra) are measured in the same run where
``pip install ompl toppra`` provides them, and left out with a note where not. Times are
processor time of this process, Python included.
"""

import argparse
import importlib.util
import os
import sys
import time

import numpy as np

from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.reeds_shepp import reeds_shepp_lengths
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.connect import connect
from vsx_ros.planning.corridor import build_corridor
from vsx_ros.planning.path import Path, Plan, Refusal
from vsx_ros.planning.planner import Planner, UnconstrainedPlanner
from vsx_ros.planning.time_scaling import time_scale

PHIS = (0.5, 1.0, 2.0)
ROBOT, LIMITS = RobotConfig(), LimitsConfig()


def random_goals(n: int, seed: int) -> np.ndarray:
    """(n, 3) poses, uniform in a disc of 4 m, any heading."""
    rng = np.random.default_rng(seed)
    radius, bearing = 4.0 * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
    return np.stack([radius * np.cos(bearing), radius * np.sin(bearing), rng.uniform(-np.pi, np.pi, n)], axis=1)


def lab(seed: int) -> OccupancyGrid:
    """12 m x 8 m at 5 cm, 12 boxes of 0.4 to 1.4 m, a wall with a gap of 1.2 m."""
    rng = np.random.default_rng(seed)
    data = np.zeros((160, 240), np.int8)
    data[:2] = data[-2:] = 100
    data[:, :2] = data[:, -2:] = 100
    for _ in range(12):
        width, height = rng.integers(8, 28, 2)
        row, column = rng.integers(0, 160 - height), rng.integers(0, 240 - width)
        data[row : row + height, column : column + width] = 100
    wall, gap = rng.integers(80, 160), rng.integers(10, 126)
    data[:, wall : wall + 3] = 100
    data[gap : gap + 24, wall : wall + 3] = 0
    return OccupancyGrid(data, 0.05, -6.0, -4.0)


def free_pose(grid: OccupancyGrid, rng: np.random.Generator) -> SE2:
    field = clearance_field(grid)
    while True:
        pose = SE2(float(rng.uniform(-6, 6)), float(rng.uniform(-4, 4)), float(rng.uniform(-np.pi, np.pi)))
        if field.at(np.array([[pose.x, pose.y]]))[0] > 0.23:
            return pose


def problems(labs: int, each: int) -> list[tuple[OccupancyGrid, SE2, SE2]]:
    out = []
    for seed in range(labs):
        grid, rng = lab(seed), np.random.default_rng(1000 + seed)
        out += [(grid, free_pose(grid, rng), free_pose(grid, rng)) for _ in range(each)]
    return out


def percentiles(values: list[float], scale: float = 1.0) -> str:
    p50, p90, p99, most = np.percentile(np.array(values) * scale, [50, 90, 99, 100])
    return f"mean {np.mean(values) * scale:.3f}  median {p50:.3f}  p90 {p90:.3f}  p99 {p99:.3f}  max {most:.3f}"


def section_connect(n: int) -> None:
    """Free space: solved, certificate, length over the Reeds-Shepp length, time."""
    for phi in PHIS:
        goals = random_goals(n, 0)
        shortest = reeds_shepp_lengths(np.zeros((n, 3)), goals, phi)
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
        print(f"  bound / phi {bound:.12f}, end error {end:.1e}")
        print(f"  length / Reeds-Shepp: {percentiles(ratio)}")
        print(f"  ms: {percentiles(seconds, 1e3)}")


def section_lab(labs: int, each: int = 4) -> None:
    """Boxes and a wall: solved of what anyone solves, time, length against the generic planner and OMPL."""
    questions = problems(labs, each)
    ompl = importlib.util.find_spec("ompl") is not None
    if not ompl:
        print("ompl is not installed: its columns are left out")
    for phi in PHIS:
        config = PlannerConfig(phi_rad_m=phi)
        ours, generic = Planner(config, ROBOT), UnconstrainedPlanner(config, ROBOT)
        seconds, smooth, solved, solvable, longer, peer_better = [], 0, 0, 0, [], []
        peer_solved, peer_seconds = 0, []
        for grid, start, goal in questions:
            begun = time.process_time()
            plan = ours.plan(start, goal, grid, np.random.default_rng(1))
            seconds.append(time.process_time() - begun)
            joined = isinstance(generic.plan(start, goal, grid, np.random.default_rng(1)), Plan)
            peer = peer_rrt_connect(grid, start, goal, config) if ompl and joined else None
            if peer is not None:
                peer_solved += 1
                peer_seconds.append(peer[0])
            if isinstance(plan, Refusal):
                solvable += peer is not None or joined
                continue
            solvable += 1
            solved += 1
            smooth += len(plan.path.stretches()) == 1 + len(plan.path.cusps)
            other = generic.plan(start, goal, grid, np.random.default_rng(1))
            assert isinstance(other, Plan)
            longer.append(plan.path.length_m / other.path.length_m)
            if peer is not None:
                peer_better.append((plan.path.length_m, peer[1]))
        print(f"phi {phi}: solved {solved} of {solvable} joined ({len(questions)} asked), {smooth} smooth")
        print(f"  ms: {percentiles(seconds, 1e3)}")
        print(f"  length / generic planner's: {percentiles(longer)}")
        if peer_better:
            both = np.array(peer_better)
            print(f"  OMPL RRTConnect + simplify: solved {peer_solved}, ms {percentiles(peer_seconds, 1e3)}")
            print(f"  mean length ours {both[:, 0].mean():.3f} m, OMPL {both[:, 1].mean():.3f} m on {len(both)}")


def peer_rrt_connect(grid: OccupancyGrid, start: SE2, goal: SE2, config: PlannerConfig) -> tuple[float, float] | None:
    """(seconds, length [m]) of OMPL's RRTConnect over Reeds-Shepp curves, simplified for at most half a second."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(1)
    corridor = build_corridor(grid, start, goal, config, ROBOT)
    assert not isinstance(corridor, Refusal)
    margin = corridor.margin
    space = base.ReedsSheppStateSpace(1.0 / config.phi_rad_m)
    bounds = base.RealVectorBounds(2)
    for axis, (low, high) in enumerate(((-6.0, 6.0), (-4.0, 4.0))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    point = np.empty((1, 2))

    def free(state: object) -> bool:
        point[0] = state.getX(), state.getY()  # type: ignore[attr-defined]
        return bool(margin.at(point)[0] >= 0.0)

    setup.setStateValidityChecker(free)
    setup.getSpaceInformation().setStateValidityCheckingResolution(0.003)
    ends = []
    for pose in (start, goal):
        state = space.allocState()
        state.setX(pose.x)
        state.setY(pose.y)
        state.setYaw(pose.wrapped().theta)
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    begun = time.process_time()
    if not setup.solve(10.0) or not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution(0.5)
    return time.process_time() - begun, float(setup.getSolutionPath().length())


def section_costs() -> None:
    """Costing views: the obstacle-free bound, and around the obstacles."""
    rng = np.random.default_rng(0)
    poses = np.stack([rng.uniform(-6, 6, 500), rng.uniform(-4, 4, 500), rng.uniform(-3, 3, 500)], axis=1)
    seconds = []
    for _ in range(20):
        begun = time.process_time()
        reeds_shepp_lengths(np.zeros((500, 3)), poses, 1.0)
        seconds.append(time.process_time() - begun)
    print(f"500 poses, obstacle-free bound, ms: {percentiles(seconds, 1e3)}")
    for phi in PHIS:
        planner = Planner(PlannerConfig(phi_rad_m=phi), ROBOT)
        seconds, ratio = [], []
        for grid, start, goal in problems(10, 1):
            ends = np.concatenate([poses, goal.as_array()[None]])
            begun = time.process_time()
            costs = planner.travel_costs(start, grid, ends)
            seconds.append(time.process_time() - begun)
            plan = planner.plan(start, goal, grid, np.random.default_rng(0))
            if isinstance(plan, Plan) and np.isfinite(costs[-1]):
                ratio.append(costs[-1] / plan.path.length_m)
        print(f"phi {phi}: travel_costs of 501 poses, ms: {percentiles(seconds, 1e3)}")
        print(f"  cost / planned length: {percentiles(ratio)}")


def section_time(n: int) -> None:
    """Time scaling: duration, speed, milliseconds, excess over the limits between samples; toppra's duration."""
    toppra = importlib.util.find_spec("toppra") is not None
    if not toppra:
        print("toppra is not installed: its column is left out")
    for phi in PHIS:
        ours, peer, seconds, alpha = 0.0, 0.0, [], []
        for goal in random_goals(n, 1):
            path = connect(SE2(), SE2(*goal.tolist()), phi)
            assert isinstance(path, Path)
            begun = time.process_time()
            trajectory = time_scale(path, LIMITS)
            seconds.append(time.process_time() - begun)
            ours += trajectory.duration_s
            peer += peer_toppra(path) if toppra else 0.0
            change = np.abs(np.diff(trajectory.omega) / np.diff(trajectory.times_s)).max()
            alpha.append(change / LIMITS.alpha_rad_s2)
        print(f"phi {phi}: total {ours:.1f} s for {n} paths; ms: {percentiles(seconds, 1e3)}")
        print(f"  |alpha| / limit: {percentiles(alpha)}")
        if toppra:
            print(f"  / toppra without jerk limit: {ours / peer:.3f}")


def peer_toppra(path: Path) -> float:
    """Duration [s] of toppra's time-optimal profiles over the stretches between stops, without jerk limits."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    total = 0.0
    for run in path.stretches():
        s = np.concatenate([piece.table[:, 0] + sum(p.length_m for p in run[:k]) for k, piece in enumerate(run)])
        kappa = np.concatenate([piece.table[:, 4] for piece in run])
        even = np.linspace(0.0, s[-1], max(30, int(s[-1] / 0.01)))
        turned = np.concatenate([[0.0], np.cumsum(np.interp(0.5 * (even[1:] + even[:-1]), s, kappa) * np.diff(even))])
        curve = toppra.SplineInterpolator(even, np.stack([even, turned], axis=1))
        v, a = (LIMITS.v_m_s, LIMITS.omega_rad_s), (LIMITS.a_m_s2, LIMITS.alpha_rad_s2)
        bounds = [
            constraint.JointVelocityConstraint(np.array([[-m, m] for m in v])),
            constraint.JointAccelerationConstraint(np.array([[-m, m] for m in a])),
        ]
        solver = algorithm.TOPPRA(bounds, curve, gridpoints=np.linspace(0.0, s[-1], 201))
        total += float(solver.compute_trajectory().duration)
    return total


def section_paper(n: int) -> None:
    """The paper's method: reach, share of it solved, violation between grid points, time."""
    from vsx_ros.planning.reach import feasible

    for phi in PHIS:
        reachable, solved, excess, seconds = 0, 0, [], []
        for goal in random_goals(n, 2):
            pose = SE2(*goal.tolist())
            reachable += feasible(SE2(), pose, phi).ok or feasible(SE2(), pose, phi, reverse=True).ok
            begun = time.process_time()
            path = connect(SE2(), pose, phi, mode="paper")
            if isinstance(path, Path):
                solved += 1
                seconds.append(time.process_time() - begun)
                excess.append(path.certificate.curvature_bound_rad_m / phi)
        print(f"phi {phi}: reachable {reachable}/{n}, solved {solved}; max curvature / phi: {max(excess):.5f}")
        print(f"  ms where solved: {percentiles(seconds, 1e3)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help="connect, lab, costs, time, paper")
    parser.add_argument("--pairs", type=int, default=2000, help="random pairs in free space (default 2000)")
    parser.add_argument("--labs", type=int, default=50, help="random labs, four questions each (default 50)")
    args = parser.parse_args()
    warm_up()
    todo = {
        "connect": lambda: section_connect(args.pairs),
        "lab": lambda: section_lab(args.labs),
        "costs": section_costs,
        "time": lambda: section_time(max(20, args.pairs // 40)),
        "paper": lambda: section_paper(max(100, args.pairs // 5)),
    }
    unknown = set(args.sections) - set(todo)
    if unknown:
        parser.error(f"there is no section {', '.join(sorted(unknown))}")
    for name in args.sections or todo:
        print(f"\n== {name} (load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)", flush=True)
        todo[name]()
    sys.stdout.flush()


if __name__ == "__main__":
    main()
