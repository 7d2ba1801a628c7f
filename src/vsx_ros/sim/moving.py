"""Things that move by themselves in an emulated world while the robot drives; metres, world frame.

What a mover is doing is its state, a few numbers that may be interpolated over time. They say where its rigid parts are
and what the robot can touch, so that another process can draw what this one moves."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.world import Material, Prism


class Robot(NamedTuple):
    """The robot as the others see it: its centre's pose in the world and its radius [m]."""

    pose: SE2
    radius_m: float

    def gap_m(self, x: float, y: float) -> float:
        """From its hull to a point."""
        return math.hypot(x - self.pose.x, y - self.pose.y) - self.radius_m


class Mover(Protocol):
    """A person, a door, a chair. parts: the solids of each rigid part, in the part's frame; materials: of these, by
    name. is_person: whether it walks. pushes: whether it walks against the robot right now."""

    parts: Sequence[Sequence[Prism]]
    materials: dict[str, Material]
    state: FloatArray
    is_person: bool
    pushes: bool

    def step(self, dt_s: float, robot: Robot, people: FloatArray, things: FloatArray) -> None:
        """Move on; people (N, 3): x, y, radius of the others, things (M, 4): borders of the other movers."""

    def poses(self, state: FloatArray) -> FloatArray:
        """(P, 5) x, y, z, yaw, pitch of the parts; pitch turns downwards, before yaw."""

    def borders(self, state: FloatArray) -> FloatArray:
        """(N, 4) x0, y0, x1, y1 of what a robot can touch, solid to the left."""


class Nearest(NamedTuple):
    """Distance [m] and vector from a point to the nearest border, and the number of the mover, -1 for a wall."""

    distance_m: float
    dx: float
    dy: float
    mover: int


class Borders:
    """Borders (N, 4), N > 0, of a mover by its number, or of walls."""

    def __init__(self, segments: FloatArray, mover: int = -1) -> None:
        self._a, self._edge = segments[:, :2], segments[:, 2:] - segments[:, :2]
        self._length2 = np.maximum((self._edge**2).sum(axis=1), 1e-12)
        self._mover = mover

    def nearest(self, x: float, y: float) -> Nearest:
        """The nearest of their points."""
        offset = np.array([x, y]) - self._a
        ratio = np.clip((offset * self._edge).sum(axis=1) / self._length2, 0.0, 1.0)
        gap = ratio[:, None] * self._edge - offset
        squared = (gap**2).sum(axis=1)
        k = int(np.argmin(squared))
        return Nearest(math.sqrt(float(squared[k])), float(gap[k, 0]), float(gap[k, 1]), self._mover)


class Moving:
    """All movers of a world, in their order. One owner advances it; drawing needs only their states."""

    def __init__(self, movers: Sequence[Mover]) -> None:
        self.movers = movers
        self._borders = [mover.borders(mover.state) for mover in movers]

    @property
    def state(self) -> tuple[float, ...]:
        """The states of all movers, one after another."""
        return tuple(value for mover in self.movers for value in mover.state.tolist())

    @property
    def pushes(self) -> bool:
        """Whether somebody walks against the robot right now."""
        return any(mover.pushes for mover in self.movers)

    def step(self, dt_s: float, robot: Robot) -> None:
        """Move them all on, one after another."""
        for k, mover in enumerate(self.movers):
            others = [other for other in self.movers if other is not mover]
            people = [[*other.state[:2], PERSON_RADIUS_M] for other in others if other.is_person]
            things = [b for b, other in zip(self._borders, self.movers) if other is not mover and not other.is_person]
            mover.step(dt_s, robot, np.array(people).reshape(-1, 3), np.concatenate([NO_BORDERS, *things]))
            self._borders[k] = mover.borders(mover.state)

    def nearest(self, x: float, y: float) -> Nearest:
        """The nearest border of any mover."""
        return min(Borders(borders, k).nearest(x, y) for k, borders in enumerate(self._borders))


PERSON_RADIUS_M = 0.22
NO_BORDERS = np.zeros((0, 4))


def outline(corners: FloatArray) -> FloatArray:
    """(N, 4) borders of a convex footprint (N, 2), counter-clockwise."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])
