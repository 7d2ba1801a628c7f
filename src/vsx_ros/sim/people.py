"""People who walk through an emulated building, to and fro between places that they see. Half of them stop before the
robot; the others walk on until they touch it."""

import math
from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.sim.doors import Door
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.moving import PERSON_RADIUS_M, Borders, Robot, outline
from vsx_ros.sim.truth import free_places, gap_to_walls
from vsx_ros.sim.world import Material, Prism, TextureKind, rectangle

SPEED_M_S = 0.3, 1.2
STEP_M = 0.7  # of one leg
SWING_RAD = 0.45  # of a leg to each side at 1.2 m/s
STOPS_BEFORE_M = 0.5  # the robot, one who stops
PATIENCE_S = 2.0  # until one turns round
HIP_M, SHOULDER_M, CHIN_M, TOP_M = 0.85, 1.42, 1.48, 1.72
PLACES = 16  # that one walks between
_TRIES = 400
_APART_M = 2.5  # of a person from the robot, at the beginning
_ROOM_M = PERSON_RADIUS_M + 0.06  # free around a way
_BODY_HEIGHT_M = 1.8


def _ring(x: float, y: float, length: float, width: float) -> Points2:
    return rectangle(x, y, 0.0, length, width)


def _parts(shirt: str, trousers: str, skin: str) -> list[list[Prism]]:
    """Trunk with head; legs, whose frames are the hips; arms, whose frames are the shoulders. They look along x."""
    trunk = [
        Prism(_ring(0.0, 0.0, 0.22, 0.38), HIP_M - 0.05, SHOULDER_M, shirt),
        Prism(_ring(0.02, 0.0, 0.19, 0.16), CHIN_M, TOP_M, skin),
    ]
    leg = [Prism(_ring(0.0, 0.0, 0.15, 0.14), 0.07 - HIP_M, 0.0, trousers)]
    shoe = [Prism(_ring(0.05, 0.0, 0.26, 0.1), -HIP_M, 0.07 - HIP_M, skin)]
    arm = [Prism(_ring(0.0, 0.0, 0.09, 0.09), -0.58, 0.0, shirt)]
    return [trunk, leg + shoe, leg + shoe, arm, arm]


class Person:
    """state: x, y, heading and the way walked. places: (N, 2), each in sight of those before and after it."""

    is_person = True

    def __init__(self, number: int, places: Points2, rng: np.random.Generator) -> None:
        self._speed_m_s = float(rng.uniform(*SPEED_M_S))
        self._stops = number % 2 == 0
        names = [f"person {number} {what}" for what in ("shirt", "trousers", "skin")]
        kinds: list[TextureKind] = ["print", "wallpaper", "plain"]
        bright = rng.uniform([0.35, 0.2, 0.3], [0.65, 0.4, 0.5]).tolist()
        tints = rng.uniform(0.6, 1.0, (3, 3)).tolist()
        self.materials = {
            name: Material(
                kind=kind, seed=int(rng.integers(1 << 30)), brightness=value, contrast=1.3, texel_m=0.002,
                tint=(red, green, blue),
            )
            for name, kind, value, (red, green, blue) in zip(names, kinds, bright, tints)
        }  # fmt: skip
        self.parts: Sequence[Sequence[Prism]] = _parts(*names)
        self._places, self._at, self._towards = places, 0, 1
        self._held_s = 0.0
        self.pushes = False
        self.state = np.array([*places[0], 0.0, 0.0])

    def step(self, dt_s: float, robot: Robot, people: FloatArray, things: FloatArray) -> None:
        """Walk on, wait, or turn round."""
        self.pushes = False
        x, y, _, way = self.state.tolist()
        gx, gy = self._places[self._at + self._towards].tolist()
        left_m, heading = math.hypot(gx - x, gy - y), math.atan2(gy - y, gx - x)
        on_m = min(self._speed_m_s * dt_s, left_m)
        nx, ny = x + on_m * math.cos(heading), y + on_m * math.sin(heading)
        gap_m = robot.gap_m(nx, ny) - PERSON_RADIUS_M
        nears = gap_m < robot.gap_m(x, y) - PERSON_RADIUS_M
        if nears and gap_m < (STOPS_BEFORE_M if self._stops else 0.0):
            self.pushes = not self._stops
            self._held_s += dt_s
            if self._held_s > PATIENCE_S:
                self._turn_round()
            return
        self._held_s = 0.0
        if self._is_blocked(nx, ny, people, things) and not self._is_blocked(x, y, people, things):
            self._turn_round()
            return
        self.state = np.array([nx, ny, heading, way + on_m])
        if left_m - on_m < 1e-6:
            self._at += self._towards
            if not 0 <= self._at + self._towards < len(self._places):
                self._towards = -self._towards

    def _is_blocked(self, x: float, y: float, people: FloatArray, things: FloatArray) -> bool:
        if len(people) and float(np.hypot(people[:, 0] - x, people[:, 1] - y).min()) < 2.0 * PERSON_RADIUS_M:
            return True
        return bool(len(things)) and Borders(things).nearest(x, y).distance_m < PERSON_RADIUS_M

    def _turn_round(self) -> None:
        self._at += self._towards
        self._towards, self._held_s = -self._towards, 0.0

    def poses(self, state: FloatArray) -> FloatArray:
        """See Mover. Legs and arms swing with the way walked."""
        x, y, heading, way = state.tolist()
        swing = SWING_RAD * self._speed_m_s / SPEED_M_S[1] * math.sin(math.pi * way / STEP_M)
        rows = [[x, y, 0.0, heading, 0.0]]
        legs, arms = ((0.1, HIP_M, swing), (-0.1, HIP_M, -swing)), ((0.25, 1.38, -swing), (-0.25, 1.38, swing))
        for side, height, pitch in legs + arms:
            rows.append([x - side * math.sin(heading), y + side * math.cos(heading), height, heading, pitch])
        return np.array(rows)

    def borders(self, state: FloatArray) -> FloatArray:
        """See Mover: an octagon around the person's disc."""
        angles = (np.arange(8) + 0.5) * (math.pi / 4.0)
        return outline(
            state[:2] + PERSON_RADIUS_M / math.cos(math.pi / 8.0) * np.column_stack([np.cos(angles), np.sin(angles)])
        )


def _can_walk(segments: FloatArray, a: Points2, b: Points2) -> bool:
    """Whether the straight way from a to b is free."""
    steps = max(math.ceil(float(np.hypot(*(b - a))) / 0.1), 1)
    points = a + np.linspace(0.0, 1.0, steps + 1)[:, None] * (b - a)
    low, high = points.min(axis=0) - _ROOM_M, points.max(axis=0) + _ROOM_M
    begin, end = segments[:, :2], segments[:, 2:]
    near = segments[(np.maximum(begin, end) >= low).all(axis=1) & (np.minimum(begin, end) <= high).all(axis=1)]
    return not len(near) or bool((gap_to_walls(near, points) > _ROOM_M).all())


def _walk(world: EmulatedWorld, segments: FloatArray, hung: Sequence[Door], rng: np.random.Generator) -> Points2 | None:
    """(N, 2) places to walk between, the first far from the robot's start and from where a door swings; None if nobody
    can walk here."""
    free, start = free_places(world), world.start
    far = free[np.hypot(free[:, 0] - start.x, free[:, 1] - start.y) > _APART_M]
    if not len(far):
        return None
    drawn = (far[int(rng.integers(len(far)))] for _ in range(_TRIES))
    beside = (place for place in drawn if all(door.gap_m(*place.tolist()) > PERSON_RADIUS_M for door in hung))
    first = next((place for place in beside if _can_walk(segments, place, place)), None)
    if first is None:
        return None
    places = [first]
    for _ in range(_TRIES):
        place = free[int(rng.integers(len(free)))]
        if float(np.hypot(*(place - places[-1]))) > 1.0 and _can_walk(segments, places[-1], place):
            places.append(place)
            if len(places) == PLACES:
                break
    return np.array(places) if len(places) > 1 else None


def people(world: EmulatedWorld, number: int, rng: np.random.Generator, hung: Sequence[Door] = ()) -> list[Person]:
    """So many people, at first beside the hung doors; fewer where there is no room to walk."""
    segments = world.obstacle_segments(0.0, _BODY_HEIGHT_M)
    walks = (_walk(world, segments, hung, rng) for _ in range(number))
    return [Person(k, places, rng) for k, places in enumerate(walks) if places is not None]
