"""Problems for the planners, and the peers that solve the same ones: OMPL in C++, and toppra 0.6.10.

``apt install g++ pkg-config libompl-dev`` and ``pip install toppra==0.6.10`` (into a separate environment) provide the
peers; nothing else needs them.
"""

import importlib.util
import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path as File
from typing import TypeAlias

import numpy as np
from rooms import plan as plan_of_picture

from vsx_ros.config import LimitsConfig, PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.distance import clearance_field, travel_distance
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.corridor import build_corridor
from vsx_ros.planning.path import Path, Refusal

ROBOT, LIMITS = RobotConfig(), LimitsConfig()
TOPPRA = importlib.util.find_spec("toppra") is not None
TUNING_MAPS = ("lab_ipa", "office_b")  # the planner was tuned on these; results are reported on the others


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


def problems(seeds: range, each: int) -> list[tuple[OccupancyGrid, SE2, SE2]]:
    """Problems (map, start, goal), ``each`` of them in every lab."""
    out = []
    for seed in seeds:
        grid, rng = lab(seed), np.random.default_rng(1000 + seed)
        out += [(grid, free_pose(grid, rng), free_pose(grid, rng)) for _ in range(each)]
    return out


def map_names(tuning: bool) -> list[str]:
    """Names of the maps in $VSX_DATA/maps: those for tuning, or the others. Empty without the data."""
    names = sorted(file.stem for file in (File(os.environ.get("VSX_DATA", "")) / "maps").glob("*.png"))
    return [name for name in names if name.startswith(TUNING_MAPS) == tuning]


def map_problems(name: str, n: int) -> list[tuple[OccupancyGrid, SE2, SE2]]:
    """n problems in a map of a real building, random poses that a base joins which turns on the spot."""
    grid = plan_of_picture(File(os.environ["VSX_DATA"]) / "maps" / f"{name}.png")
    field, rng = clearance_field(grid), np.random.default_rng(0)
    field = field._replace(values=field.values - ROBOT.radius_m - PlannerConfig().clearance_m - 0.01)
    rows, columns = np.nonzero(field.values >= 0.0)

    def draw() -> SE2:
        k, theta = rng.integers(len(rows)), rng.uniform(-np.pi, np.pi)
        half = 0.5 * field.resolution
        x, y = columns[k] * field.resolution + field.origin_x + half, rows[k] * field.resolution + field.origin_y + half
        return SE2(float(x), float(y), float(theta))

    out: list[tuple[OccupancyGrid, SE2, SE2]] = []
    while len(out) < n:
        start, goal = draw(), draw()
        if np.isfinite(travel_distance(field, (start.x, start.y))[field.cell(goal.x, goal.y)]):
            out.append((grid, start, goal))
    return out


Question: TypeAlias = tuple[OccupancyGrid, SE2, SE2]  # map, start, goal


class OmplPeer:
    """OMPL's planners, compiled from ompl_peer.cpp. Raises OSError or CalledProcessError without what that needs."""

    def __init__(self) -> None:
        source = File(__file__).with_name("ompl_peer.cpp")
        flags = subprocess.run(["pkg-config", "--cflags-only-I", "ompl"], capture_output=True, text=True, check=True)
        self._program = File(tempfile.mkdtemp()) / "ompl_peer"
        optimised = ["-std=c++17", "-O3", "-march=native", *flags.stdout.split()]
        subprocess.run(["g++", *optimised, str(source), "-o", str(self._program), "-lompl"], check=True)

    def answers(
        self,
        questions: Sequence[Question],
        config: PlannerConfig,
        planner: str,
        solve_s: float,
        simplify_s: float = 0.0,
    ) -> list[tuple[float, float] | None]:
        """(seconds, length [m]) for each question. It gets the margins of our corridor; making them takes us time."""
        asked = b"".join(self._question(grid, start, goal, config) for grid, start, goal in questions)
        command = [str(self._program), planner, f"{solve_s:g}", f"{simplify_s:g}"]
        said = subprocess.run(command, input=asked, capture_output=True, check=True).stdout.decode().splitlines()
        rows = [None if line == "none" else tuple(map(float, line.split())) for line in said]
        return [None if row is None else (row[0], row[1]) for row in rows]

    @staticmethod
    def _question(grid: OccupancyGrid, start: SE2, goal: SE2, config: PlannerConfig) -> bytes:
        corridor = build_corridor(grid, start, goal, config, ROBOT)
        assert not isinstance(corridor, Refusal)
        values, resolution, x0, y0 = corridor.margin
        poses = (*start.as_array().tolist(), *goal.wrapped().as_array().tolist())
        head = (*values.shape, *map(float, (resolution, x0, y0, config.phi_rad_m)), *poses)
        return " ".join(map(repr, head)).encode() + b"\n" + np.ascontiguousarray(values, np.float64).tobytes()


def ompl_peer() -> OmplPeer | None:
    """The compiled peer; None, and a note, without what it needs."""
    try:
        return OmplPeer()
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"OMPL's columns are left out: {error}")
        return None


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
