"""Time along a path under limits of speed, acceleration, jerk, turn rate and turn acceleration (paper 4.3, last lines).

Every stretch between stops gets the speeds of ``speed_profile``. The result is checked densely and slowed as a whole if
it exceeds anything."""

import math

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import LimitsConfig
from vsx_ros.errors import PlanningError
from vsx_ros.planning.path import Path, Trajectory
from vsx_ros.planning.pieces import Piece
from vsx_ros.planning.speed_profile import NOWHERE, Geometry, Profile, excess

SAMPLE_S = 0.02  # finer than the follower's 1/30 s
_SEGMENT_M = (0.07, 0.12, 0.3)  # all are tried, the fastest is used: fine ones follow bends, long ones jerk less
_MARGIN, _NOTHING = 1e-3, 1e-9  # extra stretch of a profile over its limits, for the gaps between samples; rounding

_Samples = tuple[FloatArray, FloatArray, FloatArray, FloatArray]  # Times (N,), poses (N, 3), v (N,) and omega (N,)


def _scale_stretch(g: Geometry, limits: LimitsConfig, sample_s: float) -> _Samples:
    """One stretch, from rest to rest."""
    found: list[tuple[float, Profile]] = []
    for segment_m in _SEGMENT_M:
        profile = Profile()
        if profile.add_way(g, 0.0, segment_m, limits):
            found.append((excess(g, profile, limits), profile))
    if not found:
        raise PlanningError(f"no speed profile over a stretch of {g.length:.4f} m; are the limits {limits} sensible?")
    stretch, profile = min(found, key=lambda each: each[0] * each[1].duration)
    stretch = stretch * (1.0 + _MARGIN) if stretch > 1.0 else 1.0
    times = np.linspace(0.0, profile.duration, max(2, math.ceil(profile.duration * stretch / sample_s) + 1))
    s, speed, _ = profile.at(times)
    speed = np.maximum(speed, 0.0) / stretch
    speed[0] = speed[-1] = 0.0
    rows = g.at(np.clip(s, 0.0, g.length))
    return times * stretch, rows[:, :3], g.direction * speed, rows[:, 3] * speed


def _scale_turn(piece: Piece, limits: LimitsConfig, sample_s: float) -> _Samples:
    """A turn on the spot, from rest to rest, as smooth in angle as the drive is in length."""
    angle = piece.turn_rad
    profile = Profile()
    jerk = limits.alpha_rad_s2 * limits.jerk_m_s3 / limits.a_m_s2
    if not profile.add_move(0.0, abs(angle), (0.0, 0.0), (limits.omega_rad_s, limits.alpha_rad_s2, jerk)):
        raise PlanningError(f"no speed profile for a turn by {angle:.4f} rad; are the limits {limits} sensible?")
    times = np.linspace(0.0, profile.duration, max(2, math.ceil(profile.duration / sample_s) + 1))
    turned, rate, _ = profile.at(times)
    sign = 1.0 if angle > 0.0 else -1.0
    start = piece.start
    poses = np.stack([np.full_like(times, start.x), np.full_like(times, start.y), start.theta + sign * turned], axis=1)
    rate[0] = rate[-1] = 0.0
    return times, poses, np.zeros_like(times), sign * rate


def estimated_s(path: Path, limits: LimitsConfig) -> float:
    """About how long a drive takes [s], without its profile: the speeds that bends and their changes allow, and a loss
    at each stop. Speeding up between bends is left out."""
    total = len(path.stretches()) * (limits.v_m_s / limits.a_m_s2 + limits.a_m_s2 / limits.jerk_m_s3)
    for piece in path.pieces:
        if piece.direction == 0:
            total += abs(piece.turn_rad) / limits.omega_rad_s
            continue
        step = np.maximum(np.diff(piece.table[:, 0]), _NOTHING)
        bend, kappa = np.abs(np.diff(piece.table[:, 4])) / step, np.abs(piece.table[:, 4])
        slowest = np.maximum(np.maximum(kappa[1:], kappa[:-1]) / limits.omega_rad_s, 1.0 / limits.v_m_s)
        total += float(np.sum(step * np.maximum(slowest, np.sqrt(bend / limits.alpha_rad_s2))))
    return total


def time_scale(
    path: Path, limits: LimitsConfig, slow_spans: FloatArray | None = None, sample_s: float = SAMPLE_S
) -> Trajectory:
    """The path in time. It starts and ends at rest, and stops at cusps and curvature jumps.

    Speed, acceleration, jerk, turn rate and turn acceleration stay within ``limits``. slow_spans: (K, 3) arc lengths
    from and to [m] between which the speed also stays within the third number [m/s]. Samples are sample_s apart. An
    empty path gives one sample."""
    slow = NOWHERE if slow_spans is None else slow_spans
    driven_m, now = 0.0, 0.0
    parts: list[_Samples] = [(np.zeros(1), path.start.as_array()[None], np.zeros(1), np.zeros(1))]
    for run in path.stretches():
        if run[0].direction == 0:
            if abs(run[0].turn_rad) < _NOTHING:
                continue
            times, *moved = _scale_turn(run[0], limits, sample_s)
        else:
            geometry = Geometry(run, slow - [driven_m, driven_m, 0.0])
            driven_m += geometry.length
            if geometry.length < _NOTHING:
                continue
            times, *moved = _scale_stretch(geometry, limits, sample_s)
        poses, v, omega = (column[1:] for column in moved)
        parts.append((times[1:] + now, poses, v, omega))
        now = float(parts[-1][0][-1])
    return Trajectory(*(np.concatenate(column) for column in zip(*parts)))
