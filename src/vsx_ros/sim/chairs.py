"""Chairs that somebody moves while the robot does not look."""

import math
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.sim.doors import Door
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.moving import Robot, outline
from vsx_ros.sim.truth import free_places, gap_to_walls
from vsx_ros.sim.world import Material, Point, Prism, rectangle

SIDE_M, SEAT_M, BACK_M, LEG_M = 0.42, 0.45, 0.88, 0.035
STAYS_S = 30.0, 90.0  # at a place, at least
UNSEEN_M, UNSEEN_RAD = 2.0, 0.8  # how far away the robot is then, and how far it looks aside
PLACES = 5
_APART_M = 1.0  # places from each other, from the robot's start, and a chair from people
_TRIES = 300


def _square(x: float, y: float, heading: float) -> Points2:
    """The seat."""
    return rectangle(x, y, heading, SIDE_M, SIDE_M)


def _parts(name: str) -> list[list[Prism]]:
    half, in_m = 0.5 * SIDE_M, 0.5 * (SIDE_M - LEG_M)
    feet = [(x, y) for x in (-in_m, in_m) for y in (-in_m, in_m)]
    legs = [Prism(rectangle(x, y, 0.0, LEG_M, LEG_M), 0.0, SEAT_M - 0.03, name) for x, y in feet]
    seat = Prism(_square(0.0, 0.0, 0.0), SEAT_M - 0.03, SEAT_M, name)
    back = Prism(rectangle(-half + 0.015, 0.0, 0.0, 0.03, SIDE_M), SEAT_M, BACK_M, name)
    return [[*legs, seat, back]]


class Chair:
    """state: x, y, heading. places: (N, 3) where it may stand."""

    is_person, pushes = False, False

    def __init__(self, number: int, places: FloatArray, rng: np.random.Generator) -> None:
        name = f"chair {number}"
        self.materials = {name: Material(kind="wood", seed=int(rng.integers(1 << 30)), brightness=0.4, texel_m=0.002)}
        self.parts: Sequence[Sequence[Prism]] = _parts(name)
        self.places, self._rng = places, rng
        self._left_s = float(rng.uniform(*STAYS_S))
        self.state = np.array(places[0])

    def step(self, dt_s: float, robot: Robot, people: FloatArray, things: FloatArray) -> None:
        """Stand; or stand elsewhere, if neither the old place nor the new one is in sight and nobody is there."""
        self._left_s -= dt_s
        if self._left_s > 0.0:
            return
        self._left_s = float(self._rng.uniform(*STAYS_S))
        then = self.places[int(self._rng.integers(len(self.places)))]
        taken = len(people) and float(np.hypot(*(people[:, :2] - then[:2]).T).min()) < _APART_M
        taken = taken or (len(things) and float(gap_to_walls(things, then[None, :2])[0]) < SIDE_M)
        if not taken and all(_is_unseen(robot, place) for place in (self.state, then)):
            self.state = np.array(then)

    def poses(self, state: FloatArray) -> FloatArray:
        """See Mover."""
        x, y, heading = state.tolist()
        return np.array([[x, y, 0.0, heading, 0.0]])

    def borders(self, state: FloatArray) -> FloatArray:
        """See Mover: the seat's outline, because no robot fits between the legs."""
        return outline(_square(*state.tolist()))


def _is_unseen(robot: Robot, place: FloatArray) -> bool:
    x, y = float(place[0]), float(place[1])
    aside = math.atan2(y - robot.pose.y, x - robot.pose.x) - robot.pose.theta
    return robot.gap_m(x, y) > UNSEEN_M and math.cos(aside) < math.cos(UNSEEN_RAD)


def chairs(world: EmulatedWorld, number: int, rng: np.random.Generator, hung: Sequence[Door] = ()) -> list[Chair]:
    """So many chairs, none where one of the hung doors swings; fewer where there is no room for them."""
    free, start = free_places(world), world.start_pose
    taken: list[Point] = [(start.x, start.y)]
    found = []
    for k in range(number):
        places: list[FloatArray] = []
        for _ in range(_TRIES if len(free) else 0):
            x, y = free[int(rng.integers(len(free)))].tolist()
            if any(door.gap_m(x, y) < SIDE_M for door in hung):
                continue
            if len(places) < PLACES and min(math.hypot(x - px, y - py) for px, py in taken) > _APART_M:
                taken.append((x, y))
                places.append(np.array([x, y, float(rng.uniform(-math.pi, math.pi))]))
        if places:
            found.append(Chair(k, np.array(places), rng))
    return found
