"""``vsx plan``: one motion with its certificate, and its picture: map, path coloured by direction, footprints, and the
change of view below."""

import argparse
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from vsx_ros.arrays import ColorImage, FloatArray
from vsx_ros.config import Config
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.map_file import load_map
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.zoned_grid import with_zones
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.planning.joint_qp import check_question
from vsx_ros.planning.path import Plan, Refusal, Trajectory
from vsx_ros.robot import MAP_FRAME
from vsx_ros.runs.parameters import load
from vsx_ros.runs.places import zones_beside
from vsx_ros.runs.process import DONE, FAILED
from vsx_ros.sim.picture import write_picture

_OPEN_FLOOR_MARGIN_M = 3.0  # around start and goal if no map is given: room for any curve
_FORWARD, _REVERSE, _INK, _FAINT = (180, 90, 0), (40, 40, 220), (40, 40, 40), (200, 200, 200)  # BGR
_ZONES = {  # BGR
    ZoneKind.NO_GO: (30, 30, 230), ZoneKind.WALL: (30, 30, 230), ZoneKind.ONLY: (60, 150, 60),
    ZoneKind.SLOW: (30, 140, 240), ZoneKind.LOOK: (220, 110, 60),
}  # fmt: skip
_LONG_SIDE_PX = 900  # of the picture
_PROFILE_PX = 220  # height of the curve under it
_MARGIN_M = 1.0  # around the path in the picture


def plan(args: argparse.Namespace) -> int:
    """Plan, print, and draw; 1 when the plan is refused."""
    assignments = list(args.set) + ([f"planner.phi_rad_m={args.phi!r}"] if args.phi is not None else [])
    config = load(args.config, assignments)
    start, goal = SE2(*args.start), SE2(*args.goal)
    check_question(start, goal, config.planner.phi_rad_m)
    grid = load_map(args.map) if args.map is not None else _open_floor(start, goal)
    zones = zones_beside(args.map) if args.map is not None else []
    planner = GoalPlanner(config, args.planner, args.seed)
    planner.take_grid(with_zones(grid, zones, config.planner.zone_margin_m, config.robot.radius_m), 0)
    timed = planner.timed(start, goal, MAP_FRAME)
    question = {"start": list(args.start), "goal": list(args.goal), "planner": args.planner}
    question |= {"phi_rad_m": config.planner.phi_rad_m, "map": None if args.map is None else str(args.map)}
    question |= {"zones": [zone.tree() for zone in zones]}
    if isinstance(timed, Refusal):
        tree = {"solved": False, "refusal": {"kind": timed.kind.value, "reason": timed.reason}}
        words = f"no plan ({timed.kind.value}): {timed.reason}"
    else:
        plan, trajectory = timed.plan, timed.trajectory
        tree, words = _as_dict(plan, trajectory), _in_words(plan, trajectory, config, args.map is not None)
    obeyed = "".join(f"\nobeyed zone     {zone.words()}" for zone in zones)
    print(json.dumps({**question, **tree}, indent=1, allow_nan=False) if args.json else words + obeyed)
    if isinstance(timed, Refusal):
        return FAILED
    if args.plot is not None:
        rows = timed.plan.path.sample(0.01)
        picture = [_map(grid, zones, timed.plan, rows, config), _profile(rows, config.planner.phi_rad_m)]
        write_picture(np.concatenate(picture), args.plot)
    return DONE


def _open_floor(start: SE2, goal: SE2) -> OccupancyGrid:
    """Known free ground around both poses."""
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


def _in_words(plan: Plan, trajectory: Trajectory, config: Config, in_map: bool) -> str:
    path, c = plan.path, plan.path.certificate
    clearance = "unlimited: open floor, no map was given"
    if in_map:
        clearance = "no obstacle near" if c.min_clearance_m is None else f"{c.min_clearance_m:.3f} m"
    limits = f"at most {config.limits.v_m_s:g} m/s and {config.limits.omega_rad_s:g} rad/s"
    view = (
        f"at most {c.curvature_bound_rad_m:.6f} rad/m (phi {config.planner.phi_rad_m:g}), by {c.method}"
        if math.isfinite(c.curvature_bound_rad_m)
        else f"unbounded: {math.degrees(path.turn_on_spot_rad):.0f} deg of turns on the spot"
    )
    return "\n".join([
        f"length          {path.length_m:.3f} m, {path.reverse_m:.3f} m of it in reverse, {len(path.cusps)} cusps",
        f"change of view  {view}",
        f"end pose        {c.end_error_m:.1e} m and {c.end_error_rad:.1e} rad from the goal",
        f"clearance       {clearance}",
        f"drive           {trajectory.duration_s:.2f} s from rest to rest, {limits}",
    ])  # fmt: skip


def _map(grid: OccupancyGrid, zones: Sequence[Zone], plan: Plan, rows: FloatArray, config: Config) -> ColorImage:
    poses = np.concatenate([rows[:, :2], [[plan.goal.x, plan.goal.y]]])
    low, high = poses.min(axis=0) - _MARGIN_M, poses.max(axis=0) + _MARGIN_M
    scale = _LONG_SIDE_PX / float(max(high - low))
    height = math.ceil(float(high[1] - low[1]) * scale)

    def pixel(x: float, y: float) -> tuple[int, int]:
        return round((x - float(low[0])) * scale), round((float(high[1]) - y) * scale)

    # For each pixel, the nearest cell of the map.
    u, v = np.meshgrid(np.arange(_LONG_SIDE_PX), np.arange(height))
    cells = grid.cells(np.stack([low[0] + u.ravel() / scale, high[1] - v.ravel() / scale], axis=1))
    inside = grid.contains(cells)
    values = np.full(len(cells), -1, np.int8)
    values[inside] = grid.data[cells[inside, 0], cells[inside, 1]]
    shade = np.where(values == FREE, 255, np.where(values == OCCUPIED, 0, 190)).astype(np.uint8)
    canvas = cv2.cvtColor(shade.reshape(v.shape), cv2.COLOR_GRAY2BGR)
    _draw_zones(canvas, zones, pixel)
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


def _draw_zones(canvas: ColorImage, zones: Sequence[Zone], pixel: Callable[[float, float], tuple[int, int]]) -> None:
    """Border and name of each zone."""
    for zone in zones:
        corners, colour = np.array([pixel(x, y) for x, y in zone.points], np.int32), _ZONES[zone.kind]
        cv2.polylines(canvas, [corners], zone.kind is not ZoneKind.WALL, colour, 2, cv2.LINE_AA)
        x, y = corners.min(axis=0).tolist()
        place = max(4, x + 4), max(40, y + 16)
        cv2.putText(canvas, zone.words(), place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)


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
