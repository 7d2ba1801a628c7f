"""Time along a path under limits of speed, acceleration, jerk, turn rate and turn acceleration (paper 4.3, last lines).

Every stretch between stops is cut into segments. In each, the curvature's size and slope turn the limits of the body
into limits of the path speed, the speeds at the cuts follow from a forward and a backward pass, and ruckig gives the
time-optimal jerk-limited move between them. The result is checked densely and slowed as a whole if it exceeds anything.
(ruckig's own way-points are not used: that interface needs a network service.)
"""

from __future__ import annotations

import math

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import LimitsConfig
from vsx_ros.errors import PlanningError
from vsx_ros.planning.path import Path, Trajectory
from vsx_ros.planning.pieces import Piece
from vsx_ros.planning.speed_profile import NOWHERE, Geometry, Profile, cut_speeds, excess, segment_limits

SAMPLE_S = 0.02
_SEGMENT_M = (0.07, 0.12, 0.3)
_SLOPE_SHARE = (0.8,)
_MARGIN = 1e-3


def _profile(g: Geometry, limits: LimitsConfig, segment_m: float, share: float) -> Profile | None:
    n = max(1, math.ceil(g.length / segment_m))
    cuts = np.linspace(0.0, g.length, n + 1)
    v, a = segment_limits(g, cuts, limits, share)
    speeds = cut_speeds(np.diff(cuts), v, a, limits.jerk_m_s3)
    profile = Profile()
    for i in range(n):
        ends = float(speeds[i]), float(speeds[i + 1])
        bounds = max(float(v[i]), *ends), float(a[i]), limits.jerk_m_s3
        if not profile.add_move(float(cuts[i]), float(cuts[i + 1] - cuts[i]), ends, bounds):
            return None
    return profile


def _scale_stretch(
    g: Geometry, limits: LimitsConfig, sample_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """times, poses (N, 3), v, omega of one stretch, from rest to rest."""
    best: tuple[float, float, Profile] | None = None
    for segment_m in _SEGMENT_M:
        for share in _SLOPE_SHARE:
            profile = _profile(g, limits, segment_m, share)
            if profile is not None:
                stretch = excess(g, profile, limits)
                if best is None or stretch * profile.duration < best[0]:
                    best = stretch * profile.duration, stretch, profile
    if best is None:
        raise PlanningError(f"no speed profile over a stretch of {g.length:.4f} m; are the limits {limits} sensible?")
    _, stretch, profile = best
    stretch = stretch * (1.0 + _MARGIN) if stretch > 1.0 else 1.0
    times = np.linspace(0.0, profile.duration, max(2, math.ceil(profile.duration * stretch / sample_s) + 1))
    s, speed, _ = profile.at(times)
    speed = np.maximum(speed, 0.0) / stretch
    speed[0] = speed[-1] = 0.0
    rows = g.at(np.clip(s, 0.0, g.length))
    return times * stretch, rows[:, :3], g.direction * speed, rows[:, 3] * speed


def _scale_turn(
    piece: Piece, limits: LimitsConfig, sample_s: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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


def time_scale(
    path: Path,
    limits: LimitsConfig,
    slow_spans: FloatArray | None = None,
    slow_v_m_s: float = math.inf,
    sample_s: float = SAMPLE_S,
) -> Trajectory:
    """The path in time, starting and ending at rest, standing still at cusps and curvature jumps.

    Speed, acceleration, jerk, turn rate and turn acceleration stay within ``limits``, and the speed within slow_v_m_s
    along slow_spans (K, 2), arc lengths from and to [m]; samples are sample_s apart. An empty path gives one.
    """
    slow = NOWHERE if slow_spans is None else slow_spans
    driven_m = 0.0
    times, poses, v, omega = [np.zeros(1)], [path.start.as_array()[None]], [np.zeros(1)], [np.zeros(1)]
    now = 0.0
    for run in path.stretches():
        if run[0].direction == 0:
            if abs(run[0].turn_rad) < 1e-9:
                continue
            part = _scale_turn(run[0], limits, sample_s)
        else:
            geometry = Geometry(run, slow - driven_m, slow_v_m_s)
            driven_m += geometry.length
            if geometry.length < 1e-9:
                continue
            part = _scale_stretch(geometry, limits, sample_s)
        times.append(part[0][1:] + now)
        poses.append(part[1][1:])
        v.append(part[2][1:])
        omega.append(part[3][1:])
        now = float(times[-1][-1])
    return Trajectory(np.concatenate(times), np.concatenate(poses), np.concatenate(v), np.concatenate(omega))
