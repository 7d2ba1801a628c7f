"""A picture of a world for the user."""

import math
from pathlib import Path

import cv2
import numpy as np

from vsx_ros.arrays import ColorImage
from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE, OCCUPIED
from vsx_ros.robot import STOP
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.truth import ground_truth_grid

BAND_M = (0.06, 0.60)  # heights that count as obstacle, as in ground_map
RESOLUTION_M = 0.02  # of the picture


def world_picture(world: EmulatedWorld, seed: int) -> ColorImage:
    """(H, W, 3) uint8: the plan from above with the start, beside the first view in colour."""
    grid = ground_truth_grid(world, RESOLUTION_M, *BAND_M)
    plan = np.full((*grid.shape, 3), 205, np.uint8)
    plan[grid.data == FREE] = 254
    plan[grid.data == OCCUPIED] = 0
    row, column = grid.cells(np.array([[world.start.x, world.start.y]]))[0]
    tip = (int(column + 30 * math.cos(world.start.theta_rad)), int(row + 30 * math.sin(world.start.theta_rad)))
    cv2.arrowedLine(plan, (int(column), int(row)), tip, (40, 40, 220), 4, tipLength=0.4)
    view = first_view(world, seed)
    plan = np.flipud(plan)
    scale = view.shape[0] / plan.shape[0]
    plan = cv2.resize(plan, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.hstack([plan[: view.shape[0]], view])


def first_view(world: EmulatedWorld, seed: int) -> ColorImage:
    """(H, W, 3) uint8: what the emulated camera sees at the start."""
    robot = EmulatedRobot(world, seed)
    stamp_ns = robot.step(STOP).frame.stamp_ns
    mosaic = robot.camera.render_bayer(stamp_ns, robot.body.poses_at)
    return np.asarray(cv2.cvtColor(mosaic, cv2.COLOR_BayerGB2BGR), np.uint8)


def write_picture(picture: ColorImage, path: Path) -> None:
    """Write a PNG or JPEG. Raises ConfigError when that fails."""
    try:
        done = cv2.imwrite(str(path), picture)
    except cv2.error:
        done = False
    if not done:
        raise ConfigError(f"picture {path} cannot be written; the name must end in .png or .jpg in an existing folder")
