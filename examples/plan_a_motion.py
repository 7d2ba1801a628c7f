"""One motion plan past a wall, its certificate, and where the robot is each second.

python examples/plan_a_motion.py
"""

import numpy as np

from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Refusal
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.time_scaling import time_scale


def main() -> None:
    config = Config()
    cells = np.zeros((80, 120), np.int8)  # 4 m x 6 m, rows along y; 0 free, 100 occupied, -1 unknown
    cells[:50, 58:62] = 100
    grid = OccupancyGrid(cells, 0.05, 0.0, 0.0)
    start, goal = SE2(1.0, 1.0, 0.0), SE2(5.0, 1.0, -1.57)
    plan = Planner(config.planner, config.robot).plan(start, goal, grid, np.random.default_rng(0))
    if isinstance(plan, Refusal):
        print(f"refused: {plan.reason}")
        return
    proved = plan.path.certificate
    print(f"{plan.path.length_m:.2f} m, turns by {proved.curvature_bound_rad_m:.2f} rad/m at most ({proved.method})")
    trajectory = time_scale(plan.path, config.limits)
    for t_s in np.arange(0.0, trajectory.duration_s, 1.0):
        pose, v, omega = trajectory.at(float(t_s))
        print(f"{t_s:4.0f} s  x {pose.x:5.2f} m  y {pose.y:5.2f} m  v {v:4.2f} m/s  turn rate {omega:+5.2f} rad/s")


if __name__ == "__main__":
    main()
