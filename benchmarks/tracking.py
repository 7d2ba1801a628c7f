"""How well a timed path is followed: ``PYTHONPATH=src:hw:tests python benchmarks/tracking.py``.

The simulated base of tests/following.py on random motion-bounded trajectories: SLAM poses 100 ms late at 15 Hz with 1
cm and 0.4 deg noise, 30 % of them missing, wheels 2 % off in either direction, commands 50 ms late with a lag of 80 ms;
then the same with one value worse at a time. Everything repeats exactly.
"""

import argparse
import math

import numpy as np
from following import drive

from vsx_ros.config import LimitsConfig
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Trajectory
from vsx_ros.planning.time_scaling import time_scale

CONDITIONS = {
    "100 ms, 2 % wheels, 30 % missing": {},
    "200 ms latency": {"latency_s": 0.2},
    "50 % missing": {"dropouts": 0.5},
    "5 % wheels": {"wheel_error": 0.05},
    "perfect wheels": {"wheel_error": 0.0},
}
GOALS = ("rms cm", 1.0, 0.7), ("final cm", 1.5, 1.0), ("final deg", 1.5, 1.0)


def trajectories(n: int, seed: int) -> list[Trajectory]:
    """n paths to random poses within 2.5 m in x and y; phi is .5, 1 and 2 in turn."""
    rng = np.random.default_rng(seed)
    paths = [connect(SE2(), SE2(*rng.uniform(-2.5, 2.5, 3)), (0.5, 1.0, 2.0)[k % 3]) for k in range(n)]
    return [time_scale(path, LimitsConfig()) for path in paths if isinstance(path, Path)]


def figures(ways: list[Trajectory], seed: int, condition: dict[str, float]) -> tuple[np.ndarray, int]:
    """(N, 3) lateral rms [cm], final distance [cm], final heading [deg]; and how many did not arrive."""
    drives = [drive(way, seed + k, **condition) for k, way in enumerate(ways)]
    rows = [
        (100 * math.sqrt(np.mean(np.square(d.lateral_m))), 100 * d.final_m, math.degrees(d.final_rad)) for d in drives
    ]
    return np.array(rows), sum(d.status is not FollowStatus.ARRIVED for d in drives)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=60, help="trajectories (default 60)")
    parser.add_argument("--seed", type=int, default=100, help="of the ways and of the noise (default 100)")
    args = parser.parse_args()
    ways = trajectories(args.n, args.seed)
    print("must / aim: " + ", ".join(f"{name} {must:g} / {aim:g}" for name, must, aim in GOALS))
    print(
        f"{len(ways)} ways, median / p95" + " " * 16 + "".join(f"{name:>16}" for name, _, _ in GOALS) + "  not arrived"
    )
    for name, condition in CONDITIONS.items():
        rows, failed = figures(ways, args.seed, condition)
        cells = [f"{np.median(column):.2f} / {np.percentile(column, 95):.2f}" for column in rows.T]
        print(f"{name:36s}" + "".join(f"{cell:>16}" for cell in cells) + f"{failed:13d}", flush=True)


if __name__ == "__main__":
    main()
