"""The picture of ``vsx plan``: map, path coloured by direction, footprints, and the change of view below."""

import math
from pathlib import Path

import cv2
import numpy as np

from vsx_ros.arrays import ColorImage, FloatArray
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning.path import Plan

_FORWARD, _REVERSE, _INK, _FAINT = (180, 90, 0), (40, 40, 220), (40, 40, 40), (200, 200, 200)
_LONG_SIDE_PX = 900
_PROFILE_PX = 220
_MARGIN_M = 1.0


def draw(file: Path, grid: OccupancyGrid, plan: Plan, config: Config) -> None:
    """Write the picture. Raises InputError when the file cannot be written."""
    rows = plan.path.sample(0.01)
    picture = np.concatenate([_map(grid, plan, rows, config), _profile(rows, config.planner.phi_rad_m)])
    try:
        written = cv2.imwrite(str(file), picture)
    except cv2.error:
        written = False
    if not written:
        raise InputError(f"the picture {file} cannot be written; give a name that ends in .png in a folder that exists")


def _map(grid: OccupancyGrid, plan: Plan, rows: FloatArray, config: Config) -> ColorImage:
    poses = np.concatenate([rows[:, :2], [[plan.goal.x, plan.goal.y]]])
    low, high = poses.min(axis=0) - _MARGIN_M, poses.max(axis=0) + _MARGIN_M
    scale = _LONG_SIDE_PX / float(max(high - low))
    height = math.ceil(float(high[1] - low[1]) * scale)

    def pixel(x: float, y: float) -> tuple[int, int]:
        return round((x - float(low[0])) * scale), round((float(high[1]) - y) * scale)

    # One look-up a pixel: nearest cell of the map.
    u, v = np.meshgrid(np.arange(_LONG_SIDE_PX), np.arange(height))
    cells = grid.cells(np.stack([low[0] + u.ravel() / scale, high[1] - v.ravel() / scale], axis=1))
    inside = grid.contains(cells)
    values = np.full(len(cells), -1, np.int8)
    values[inside] = grid.data[cells[inside, 0], cells[inside, 1]]
    shade = np.where(values == FREE, 255, np.where(values == OCCUPIED, 0, 190)).astype(np.uint8)
    canvas = cv2.cvtColor(shade.reshape(v.shape), cv2.COLOR_GRAY2BGR)
    radius = round(config.robot.radius_m * scale)
    for row in rows[:: max(1, len(rows) // 12)]:
        cv2.circle(canvas, pixel(row[0], row[1]), radius, _FAINT, 1, cv2.LINE_AA)
    for a, b in zip(rows[:-1], rows[1:]):
        colour = _REVERSE if b[4] < 0 else _FORWARD
        cv2.line(canvas, pixel(a[0], a[1]), pixel(b[0], b[1]), colour, 2, cv2.LINE_AA)
    for x, y, theta in ((rows[0, 0], rows[0, 1], rows[0, 2]), (plan.goal.x, plan.goal.y, plan.goal.theta)):
        tip = pixel(x + 0.3 * math.cos(theta), y + 0.3 * math.sin(theta))
        cv2.arrowedLine(canvas, pixel(x, y), tip, _INK, 2, cv2.LINE_AA, tipLength=0.3)
        cv2.circle(canvas, pixel(x, y), radius, _INK, 1, cv2.LINE_AA)
    text = f"{plan.planner}: {plan.path.length_m:.2f} m, {len(plan.path.cusps)} cusps (red: reverse)"
    cv2.putText(canvas, text, (10, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _INK, 1, cv2.LINE_AA)
    return np.asarray(canvas, np.uint8)


def _profile(rows: FloatArray, phi: float) -> ColorImage:
    """Curvature over arc length with both bounds."""
    canvas = np.full((_PROFILE_PX, _LONG_SIDE_PX, 3), 255, np.uint8)
    steps = np.hypot(*np.diff(rows[:, :2], axis=0).T)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    across = (_LONG_SIDE_PX - 20) / max(float(s[-1]), 1e-9)
    middle, unit = _PROFILE_PX // 2, 0.36 * _PROFILE_PX / phi
    for level, colour in ((0.0, _FAINT), (phi, _REVERSE), (-phi, _REVERSE)):
        y = round(middle - level * unit)
        cv2.line(canvas, (10, y), (_LONG_SIDE_PX - 10, y), colour, 1)
    points = np.stack([10 + s * across, middle - np.clip(rows[:, 3], -1.3 * phi, 1.3 * phi) * unit], axis=1)
    cv2.polylines(canvas, [np.round(points).astype(np.int32)], False, _FORWARD, 2, cv2.LINE_AA)
    text = f"dtheta/ds over {float(s[-1]):.2f} m; bounds +-{phi:g} rad/m"
    cv2.putText(canvas, text, (10, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _INK, 1, cv2.LINE_AA)
    return canvas
