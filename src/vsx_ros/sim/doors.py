"""Doors that open and close in the gaps of an emulated building's walls. One that would hit somebody waits."""

import math
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.interior import jambs
from vsx_ros.sim.moving import Borders, Robot, outline
from vsx_ros.sim.truth import ROBOT_RADIUS_M, gap_to_walls
from vsx_ros.sim.world import Material, Prism, World, rectangle

WIDTH_M = 0.7, 1.8  # of the gaps that get a door
SPLIT_M = 0.01  # between leaf and jambs
THICK_M, HIGH_M = 0.04, 2.05
OPEN_S, CLOSED_S = (25.0, 60.0), (20.0, 40.0)  # how long it stays so
TURN_RAD_S = 1.0
OPEN_RAD = 0.5 * math.pi
_SPARE_M = 0.03  # to whoever stands in the way
_START_M = ROBOT_RADIUS_M + 0.1  # from the robot's start to where a leaf swings


class Door:
    """hinge: T_world_hinge of the closed leaf, which lies along its x. turn: 1 or -1, the direction of its opening.
    state: the angle by which it is open [rad]."""

    is_person, pushes = False, False

    def __init__(self, number: int, hinge: SE2, width_m: float, turn: int, rng: np.random.Generator) -> None:
        name = f"door {number}"
        leaf = rectangle(0.5 * width_m, 0.0, 0.0, width_m, THICK_M)
        self.materials = {name: Material(kind="wood", seed=int(rng.integers(1 << 30)), brightness=0.55)}
        self.parts: Sequence[Sequence[Prism]] = [[Prism(leaf, 0.01, HIGH_M, name)]]
        self._leaf, self._hinge, self._turn, self._rng = leaf, hinge, turn, rng
        self._width_m = width_m
        self._opens, self._left_s = True, float(rng.uniform(*OPEN_S))
        self.state = np.array([OPEN_RAD])

    def step(self, dt_s: float, robot: Robot, people: FloatArray, things: FloatArray) -> None:
        """Turn, unless somebody is in the way; then wait for the next time."""
        wanted = OPEN_RAD if self._opens else 0.0
        angle = float(self.state[0])
        if angle != wanted:
            step = TURN_RAD_S * dt_s
            moved = np.array([angle + float(np.clip(wanted - angle, -step, step))])
            if not self._hits(moved, robot, people):
                self.state = moved
            return
        self._left_s -= dt_s
        if self._left_s <= 0.0:
            self._opens = not self._opens
            self._left_s = float(self._rng.uniform(*(OPEN_S if self._opens else CLOSED_S)))

    def _hits(self, state: FloatArray, robot: Robot, people: FloatArray) -> bool:
        discs = [(robot.pose.x, robot.pose.y, robot.radius_m), *map(tuple, people.tolist())]
        now, then = self.borders(self.state), self.borders(state)
        for x, y, radius_m in discs:
            gap_m = Borders(then).nearest(x, y).distance_m
            if gap_m < radius_m + _SPARE_M and gap_m < Borders(now).nearest(x, y).distance_m:
                return True
        return False

    def gap_m(self, x: float, y: float) -> float:
        """From a place to the ground that the leaf sweeps [m]; 0 on it."""
        return _swept_gap_m(self._hinge, self._width_m, self._turn, x, y)

    def poses(self, state: FloatArray) -> FloatArray:
        """See Mover."""
        return np.array([[self._hinge.x, self._hinge.y, 0.0, self._hinge.theta + self._turn * float(state[0]), 0.0]])

    def borders(self, state: FloatArray) -> FloatArray:
        """See Mover."""
        return outline(SE2(self._hinge.x, self._hinge.y, self._hinge.theta + self._turn * float(state[0])) @ self._leaf)


def gaps(world: World) -> list[tuple[Points2, Points2]]:
    """The two jambs of every gap in the free-standing walls where a door fits, in the order of the walls."""
    ends = [np.array(end) for end in jambs(world)]
    found = []
    for i, a in enumerate(ends):
        for b in ends[i + 1 :]:
            across = np.abs(b - a)
            if across.min() < 1e-6 and WIDTH_M[0] < across.max() < WIDTH_M[1] and not _walled(world, 0.5 * (a + b)):
                found.append((a, b))
    return found


def _walled(world: World, place: Points2) -> bool:
    """Whether a wall covers the place."""
    ends = np.array([[*wall.points[0], *wall.points[-1]] for wall in world.walls])
    return float(gap_to_walls(ends, place[None])[0]) < 0.1


def _swings_free(segments: FloatArray, hinge: SE2, width_m: float, turn: int) -> bool:
    """Whether the leaf touches nothing while it opens; its hinge is in the wall."""
    angles = hinge.theta + turn * np.linspace(0.15, OPEN_RAD, 12)
    radii = np.linspace(0.25, 1.0, 8) * width_m
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None, :] * radii[:, None]
    return bool((gap_to_walls(segments, (np.array([hinge.x, hinge.y]) + rays).reshape(-1, 2)) > 0.05).all())


def _swept_gap_m(hinge: SE2, width_m: float, turn: int, x: float, y: float) -> float:
    """From a place to the quarter of a disc that a leaf sweeps [m]; 0 on it."""
    dx, dy = x - hinge.x, y - hinge.y
    cos, sin = math.cos(hinge.theta), math.sin(hinge.theta)
    ahead, aside = cos * dx + sin * dy, turn * (cos * dy - sin * dx)
    nearest = np.maximum([ahead, aside], 0.0)
    nearest *= min(1.0, width_m / max(float(np.hypot(*nearest)), 1e-12))
    return max(math.hypot(ahead - nearest[0], aside - nearest[1]) - 0.5 * THICK_M, 0.0)


def doors(world: World, number: int, rng: np.random.Generator) -> list[Door]:
    """So many doors, in gaps by rng; fewer where a leaf would not swing freely, or through the robot's start."""
    segments, places = world.obstacle_segments(0.0, HIGH_M), gaps(world)
    start = world.start
    found: list[Door] = []
    for k in rng.permutation(len(places)).tolist():
        for a, b in (places[k], places[k][::-1]):
            gap_m = float(np.hypot(*(b - a)))
            (dx, dy), width_m = ((b - a) / gap_m).tolist(), gap_m - 2.0 * SPLIT_M
            hinge = SE2(a[0] + SPLIT_M * dx, a[1] + SPLIT_M * dy, math.atan2(dy, dx))
            free = (turn for turn in (1, -1) if _swings_free(segments, hinge, width_m, turn))
            turn = next((t for t in free if _swept_gap_m(hinge, width_m, t, start.x, start.y) > _START_M), None)
            if turn is not None and len(found) < number:
                found.append(Door(k, hinge, width_m, turn, rng))
                break
    return found
