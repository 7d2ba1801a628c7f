"""Where the dock is, from its light and the odometry: a particle filter over the dock's pose in the odometry frame."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DockLight, DockSight

_PARTICLES = 500
_MOVED_M, _MOVED_RAD = 0.015, math.radians(3.0)
"""Readings of one place are no new evidence: their errors are the same."""
_MOST_READINGS = 50  # of one place: a second
_TRUST = 0.5  # exponent of the likelihood: the shapes of the beams are known roughly
_ROUGH_M, _ROUGH_RAD = 0.004, math.radians(0.5)


class DockEstimate(NamedTuple):
    """T_odom_dock, and standard deviations of its position across the line of sight [m] and of its heading [rad]."""

    T_odom_dock: SE2
    sigma_m: float
    sigma_rad: float


class DockFilter:
    """seen: number of places at which the dock was seen since ``restart``."""

    def __init__(self, light: DockLight, rng: np.random.Generator) -> None:
        self._light, self._rng = light, rng
        self.restart(SE2(), 0.0, 0.0)

    def restart(self, T_odom_dock: SE2, sigma_m: float, sigma_rad: float) -> None:
        """Forget everything; the dock is about here."""
        noise = self._rng.standard_normal((_PARTICLES, 3)) * [sigma_m, sigma_m, sigma_rad]
        self._docks = T_odom_dock.as_array() + noise
        self._log_weights: FloatArray = np.zeros(_PARTICLES)
        self._sights: list[DockSight] = []
        self._place: SE2 | None = None
        self.seen = 0

    def loosen(self, sigma_m: float, sigma_rad: float) -> None:
        """Trust the estimate less: it led to no contact."""
        self._resample()
        self._docks = self._docks + self._rng.standard_normal((_PARTICLES, 3)) * [sigma_m, sigma_m, sigma_rad]

    def add(self, T_odom_base: SE2, sight: DockSight) -> None:
        """A reading of the receivers at this pose."""
        place = self._place
        if place is not None and self._sights and _has_moved(place, T_odom_base):
            self._weigh(place)
            self._sights = []
        if not self._sights:
            self._place = T_odom_base
        if len(self._sights) < _MOST_READINGS:
            self._sights.append(sight)

    def touched(self, T_odom_base: SE2, distance_m: float) -> None:
        """The base touches the dock, and its centre is so far from it: the estimate moves along the line of sight."""
        dock = self.estimate().T_odom_dock
        away_m = max(T_odom_base.distance_to(dock), 1e-6)
        moved = (distance_m / away_m - 1.0) * np.array([dock.x - T_odom_base.x, dock.y - T_odom_base.y, 0.0])
        self._docks = self._docks + moved

    def estimate(self) -> DockEstimate:
        """The mean of the particles."""
        weights = self._weights()
        x, y = (weights @ self._docks[:, :2]).tolist()
        heading = math.atan2(weights @ np.sin(self._docks[:, 2]), weights @ np.cos(self._docks[:, 2]))
        off = self._docks - [x, y, heading]
        turned = (off[:, 2] + math.pi) % math.tau - math.pi
        sigma_m, across = float(np.sqrt(weights @ (off[:, :2] ** 2).sum(axis=1))), math.inf
        if self._place is not None:
            sight = math.atan2(y - self._place.y, x - self._place.x)
            across = float(np.sqrt(weights @ (off[:, :2] @ [-math.sin(sight), math.cos(sight)]) ** 2))
        return DockEstimate(SE2(x, y, heading), min(sigma_m, across), float(np.sqrt(weights @ turned**2)))

    def _weigh(self, place: SE2) -> None:
        shares = self._light.shares(self._sights)
        self.seen += bool((shares > 0.5).any())
        likelihood = self._light.log_likelihood(_relative(place, self._docks), shares)
        self._log_weights = self._log_weights + _TRUST * likelihood
        weights = self._weights()
        if 1.0 / float((weights**2).sum()) < 0.5 * _PARTICLES:
            self._resample()

    def _weights(self) -> FloatArray:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(weights / weights.sum())

    def _resample(self) -> None:
        """Systematic, with some roughness, so that particles do not collapse."""
        steps = (np.arange(_PARTICLES) + self._rng.random()) / _PARTICLES
        chosen = np.minimum(np.searchsorted(np.cumsum(self._weights()), steps), _PARTICLES - 1)
        noise = self._rng.standard_normal((_PARTICLES, 3)) * [_ROUGH_M, _ROUGH_M, _ROUGH_RAD]
        self._docks = self._docks[chosen] + noise
        self._log_weights = np.zeros(_PARTICLES)


def _has_moved(a: SE2, b: SE2) -> bool:
    return a.distance_to(b) > _MOVED_M or abs(a.angle_to(b)) > _MOVED_RAD


def _relative(base: SE2, docks: FloatArray) -> FloatArray:
    """(N, 3): docks as seen from the base."""
    inverse = base.inverse()
    return np.column_stack([inverse @ docks[:, :2], docks[:, 2] - base.theta])
