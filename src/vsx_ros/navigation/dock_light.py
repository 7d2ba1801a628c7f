"""What a base may see of its dock: the beams of each kind of dock, the receivers of each kind of base.

Frame of the dock: origin at its emitters, x out of it, y to its own left. Nobody publishes the exact shapes, docks
differ, and walls reflect. So the edges are soft here, and only their symmetry about the axis is relied upon."""

import math
from enum import IntFlag
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.se2 import SE2

_EDGE_RAD, _VIEW_RAD, _RANGE_RATIO = math.radians(3.0), math.radians(8.0), 0.12  # softness of the edges
_HIT, _GHOST = 0.9, 0.06  # chance to see a beam that falls on the receiver, and one that does not


class DockBeam(IntFlag):
    """The bits on the topic mobile_base/sensors/dock_ir. LEFT and RIGHT are named from the dock, which looks ahead."""

    NEAR_LEFT = 1
    NEAR_CENTER = 2
    NEAR_RIGHT = 4
    CENTER = 8
    LEFT = 16
    RIGHT = 32
    HALO = 64


class DockSight(NamedTuple):
    """Bits of DockBeam on the receivers that look to the right, ahead and to the left."""

    right: int = 0
    centre: int = 0
    left: int = 0


class _Beam(NamedTuple):
    bit: DockBeam
    middle_rad: float
    half_rad: float
    range_m: float


class _Receiver(NamedTuple):
    """number: its place in DockSight. ahead_m: of the centre of the base. The rest: what it sees."""

    number: int
    ahead_m: float
    middle_rad: float
    half_rad: float


class DockLight(NamedTuple):
    """One kind of base at its dock. seat_m: distance of its centre from the emitters when it charges. stand_m: where to
    look for the dock and align with it."""

    beams: tuple[_Beam, ...]
    receivers: tuple[_Receiver, ...]
    seat_m: float
    stand_m: float

    def chances(self, T_base_docks: FloatArray) -> FloatArray:
        """(N, R, B): how likely each receiver sees each beam, for docks (N, 3) x, y [m], heading [rad] as seen from the
        base."""
        receivers = np.array([receiver[1:] for receiver in self.receivers])  # (R, 3)
        beams = np.array([beam[1:] for beam in self.beams])  # (B, 3)
        dx, dy = T_base_docks[:, None, 0] - receivers[:, 0], T_base_docks[:, None, 1]
        bearing = np.arctan2(dy, dx)
        away_m = np.hypot(dx, dy)
        azimuth = bearing + math.pi - T_base_docks[:, None, 2]  # of the receiver, at the dock
        view = _soft(receivers[:, 2] - np.abs(_wrapped(bearing - receivers[:, 1])), _VIEW_RAD)
        off = np.abs(_wrapped(azimuth[..., None] - beams[:, 0]))
        reach = _soft(beams[:, 2] - away_m[..., None], _RANGE_RATIO * beams[:, 2])
        return np.asarray(view[..., None] * reach * _soft(beams[:, 1] - off, _EDGE_RAD))

    def log_likelihood(self, T_base_docks: FloatArray, seen: FloatArray) -> FloatArray:
        """(N,): of docks (N, 3) as in ``chances``. seen (R, B): in which share of the readings each beam was seen."""
        chance = _GHOST + (_HIT - _GHOST) * self.chances(T_base_docks)
        return np.asarray((seen * np.log(chance) + (1.0 - seen) * np.log(1.0 - chance)).sum(axis=(1, 2)))

    def shares(self, sights: list[DockSight]) -> FloatArray:
        """(R, B): in which share of these readings each beam was seen by each receiver."""
        bits = np.array([beam.bit for beam in self.beams])
        told = np.array(sights)[:, [receiver.number for receiver in self.receivers]]
        return np.asarray(((told[..., None] & bits) != 0).mean(axis=0))

    def seat(self, T_dock: SE2) -> SE2:
        """The pose of the base that charges at this dock."""
        return T_dock @ SE2(self.seat_m, 0.0, math.pi)

    def dock_at(self, T_base: SE2) -> SE2:
        """The dock of a base that charges here; the inverse of ``seat``."""
        return T_base @ SE2(self.seat_m, 0.0, math.pi)


def _soft(inside: FloatArray, width: float | FloatArray) -> FloatArray:
    """From 0 to 1 across an edge."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * inside / width))


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _deg(*degrees: float) -> tuple[float, ...]:
    return tuple(math.radians(angle) for angle in degrees)


_SIDE, _WIDE, _NARROW, _NEAR_M, _FAR_M = *_deg(32.0, 25.0, 9.0), 0.8, 2.5
_KOBUKI_BEAMS = (
    _Beam(DockBeam.NEAR_LEFT, _SIDE, _WIDE, _NEAR_M), _Beam(DockBeam.LEFT, _SIDE, _WIDE, _FAR_M),
    _Beam(DockBeam.NEAR_CENTER, 0.0, _NARROW, _NEAR_M), _Beam(DockBeam.CENTER, 0.0, _NARROW, _FAR_M),
    _Beam(DockBeam.NEAR_RIGHT, -_SIDE, _WIDE, _NEAR_M), _Beam(DockBeam.RIGHT, -_SIDE, _WIDE, _FAR_M),
)  # fmt: skip
_BUOY, _APERTURE = _deg(10.0, 15.0)
_HOME_BASE_BEAMS = (
    _Beam(DockBeam.LEFT, _BUOY, _APERTURE, 1.0), _Beam(DockBeam.RIGHT, -_BUOY, _APERTURE, 1.0),
    _Beam(DockBeam.HALO, 0.0, 2.0 * math.pi, 0.61),
)  # fmt: skip
_KOBUKI_RECEIVERS = tuple(_Receiver(k, 0.16, *_deg(60.0 * (k - 1), 45.0)) for k in range(3))
_OMNI = _Receiver(1, 0.14, *_deg(0.0, 110.0))
_CREATE_2_RECEIVERS = (_Receiver(0, 0.16, *_deg(-30.0, 45.0)), _OMNI, _Receiver(2, 0.16, *_deg(30.0, 45.0)))
DOCK_LIGHTS = {
    "kobuki": DockLight(_KOBUKI_BEAMS, _KOBUKI_RECEIVERS, 0.21, 0.8),
    "create": DockLight(_HOME_BASE_BEAMS, (_OMNI,), 0.21, 0.7),
    "create2": DockLight(_HOME_BASE_BEAMS, _CREATE_2_RECEIVERS, 0.21, 0.7),
}


def dock_light(kind: str) -> DockLight:
    """Raises ConfigError for a base that has no dock."""
    if kind not in DOCK_LIGHTS:
        raise ConfigError(f"base {kind!r} has no dock that is known; docking needs one of {', '.join(DOCK_LIGHTS)}")
    return DOCK_LIGHTS[kind]
