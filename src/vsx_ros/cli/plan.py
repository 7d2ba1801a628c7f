"""``vsx plan``: plan one motion from pose to pose and prove what it promises

Plans from pose to pose, in a map or on open floor, and prints the certificate and the time.

example: vsx plan --start 0,0,0 --goal 2,-1,90 --phi 1 --plot plan.png
"""

from __future__ import annotations

import argparse
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsx_ros.cli.config import add_parameters
from vsx_ros.registry import Kinds
from vsx_ros.runs.exit_codes import DONE, FAILED

if TYPE_CHECKING:
    from vsx_ros.config import Config
    from vsx_ros.geometry.se2 import SE2
    from vsx_ros.occupancy.grid import OccupancyGrid
    from vsx_ros.planning.path import Plan, Trajectory

PLANNERS = Kinds(("fov", "unconstrained", "paper"))
_OPEN_FLOOR_MARGIN_M = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    # Poses may begin with a minus sign.
    parser._negative_number_matcher = re.compile(r"^-[\d.]")
    parser.add_argument("--start", type=_pose, required=True, metavar="X,Y,DEG", help="metres and degrees")
    parser.add_argument("--goal", type=_pose, required=True, metavar="X,Y,DEG", help="metres and degrees")
    parser.add_argument("--map", type=Path, metavar="map.yaml", help="a map as map_server keeps it; else open floor")
    parser.add_argument("--phi", type=float, metavar="RAD_PER_M", help="greatest change of view per metre driven")
    parser.add_argument("--planner", choices=PLANNERS, default="fov", help="default: fov, the certified method")
    parser.add_argument("--seed", type=int, default=0, help="of the randomised searches (default 0)")
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a picture (.png)")
    add_parameters(parser)


def _pose(text: str) -> tuple[float, float, float]:
    try:
        x, y, degrees = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a pose; write X,Y,DEG, e.g. 1.5,-2,90") from None
    return x, y, math.radians(degrees)


def run(args: argparse.Namespace) -> int:
    """Plan, print, and draw; 1 when the plan is refused."""
    import numpy as np

    from vsx_ros.geometry.se2 import SE2
    from vsx_ros.io.map_file import load_map
    from vsx_ros.planning import planners
    from vsx_ros.planning.feasibility import check_question
    from vsx_ros.planning.path import Refusal
    from vsx_ros.planning.time_scaling import time_scale
    from vsx_ros.runs.parameters import load

    assignments = list(args.set) + ([f"planner.phi_rad_m={args.phi!r}"] if args.phi is not None else [])
    config = load(args.config, assignments)
    start, goal = SE2(*args.start), SE2(*args.goal)
    check_question(start, goal, config.planner.phi_rad_m)
    grid = load_map(args.map) if args.map is not None else _open_floor(start, goal)
    planner = planners.PLANNERS[args.planner](config.planner, config.robot)
    plan = planner.plan(start, goal, grid, np.random.default_rng(args.seed))
    question = {
        "start": list(args.start),
        "goal": list(args.goal),
        "planner": args.planner,
        "phi_rad_m": config.planner.phi_rad_m,
        "map": None if args.map is None else str(args.map),
    }
    if isinstance(plan, Refusal):
        tree = {"solved": False, "refusal": {"kind": plan.kind.value, "reason": plan.reason}}
        words = f"no plan ({plan.kind.value}): {plan.reason}"
    else:
        trajectory = time_scale(plan.path, config.limits)
        tree, words = _as_dict(plan, trajectory), _in_words(plan, trajectory, config)
    print(json.dumps({**question, **tree}, indent=1, allow_nan=False) if args.json else words)
    if isinstance(plan, Refusal):
        return FAILED
    if args.plot is not None:
        from vsx_ros.cli.plan_picture import draw

        draw(args.plot, grid, plan, config)
    return DONE


def _open_floor(start: SE2, goal: SE2) -> OccupancyGrid:
    """Known free ground around both poses."""
    import numpy as np

    from vsx_ros.errors import PlanningError
    from vsx_ros.occupancy.grid import OccupancyGrid

    resolution = 0.05
    reach = start.distance_to(goal) + _OPEN_FLOOR_MARGIN_M
    if reach > 100.0:
        raise PlanningError(f"start and goal are {start.distance_to(goal):.0f} m apart; give poses within 97 m")
    cells = math.ceil(2.0 * reach / resolution)
    x, y = 0.5 * (start.x + goal.x), 0.5 * (start.y + goal.y)
    return OccupancyGrid(np.zeros((cells, cells), np.int8), resolution, x - reach, y - reach)


def _as_dict(plan: Plan, trajectory: Trajectory) -> dict[str, Any]:
    samples = [
        [round(float(v), 6) for v in (t, *pose, v, omega)]
        for t, pose, v, omega in zip(trajectory.times_s, trajectory.poses, trajectory.v, trajectory.omega)
    ]
    timed = {"duration_s": trajectory.duration_s, "t_x_y_theta_v_omega": samples}
    return {"solved": True, "path": plan.path.as_dict(), "trajectory": timed}


def _in_words(plan: Plan, trajectory: Trajectory, config: Config) -> str:
    path, c = plan.path, plan.path.certificate
    view = (
        f"at most {c.curvature_bound_rad_m:.6f} rad/m (phi {config.planner.phi_rad_m:g}), by {c.method}"
        if math.isfinite(c.curvature_bound_rad_m)
        else f"unbounded: {math.degrees(path.turn_on_spot_rad):.0f} deg of turns on the spot"
    )
    return "\n".join([
        f"length          {path.length_m:.3f} m, {path.reverse_m:.3f} m of it in reverse, {len(path.cusps)} cusps",
        f"change of view  {view}",
        f"end pose        {c.end_error_m:.1e} m and {c.end_error_rad:.1e} rad from the goal",
        f"clearance       {'open floor' if c.min_clearance_m is None else f'{c.min_clearance_m:.3f} m'}",
        f"time            {trajectory.duration_s:.2f} s",
    ])  # fmt: skip
