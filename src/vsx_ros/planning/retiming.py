"""Slows, holds and resumes a drive: gives the rest of a planned trajectory new times within the limits.

Playing a time-optimal plan slower by a changing factor adds to accelerations and jerks that are at their limits
already. So the speed is planned again from the present speed and acceleration: a jerk-limited change (ruckig) to a
speed from which the segments of ``speed_profile`` continue. Every candidate is checked densely."""

import itertools
import math
from functools import partial
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import LimitsConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.path import Trajectory
from vsx_ros.planning.pieces import Piece
from vsx_ros.planning.speed_profile import Geometry, Profile, excess

_SAMPLE_S = 0.02  # finer than the follower's 1/30 s
_SEGMENTS_M = (0.12, 0.3)  # of the speed profile: fine ones follow bends, long ones always find a profile
_ENTRY_SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the present speed: the first from which a profile continues
_BRAKE_SHARES = (1.0, 0.75, 0.5, 0.35)  # of the deceleration: a smaller one jerks less on bends
_TOLERANCE = 2e-3  # allowed share over the limits: sampling is not more exact
_NOTHING = 1e-9  # m, m/s: rounding


class Timing(NamedTuple):
    """A trajectory along a planned one. places_s (N,): positions of its samples, as times of the planned one [s]."""

    trajectory: Trajectory
    places_s: FloatArray


class _Stretch:
    """The planned trajectory between two stops, over arc length, or over the angle of a turn on the spot."""

    def __init__(self, planned: Trajectory, place_s: float, limits: LimitsConfig) -> None:
        times = planned.times_s - planned.times_s[0]
        stands = np.flatnonzero((planned.v == 0.0) & (planned.omega == 0.0))
        k = int(np.clip(np.searchsorted(times[stands], place_s, side="right") - 1, 0, max(0, len(stands) - 2)))
        first, self.last = int(stands[k]), int(stands[min(k + 1, len(stands) - 1)])
        part = slice(first, self.last + 1)
        self.times, v, omega = times[part], planned.v[part], planned.omega[part]
        self.turns = bool(np.all(v == 0.0))
        self.sign = float(np.sign(np.sum(omega if self.turns else v)))
        self.speed: FloatArray = np.abs(omega if self.turns else v)
        self.limits = limits
        half = 0.5 * np.diff(planned.poses[part, 2])
        step = 2.0 * np.abs(half)
        kappa = np.zeros(len(v))
        if self.turns:
            a, alpha = limits.a_m_s2, limits.alpha_rad_s2
            self.limits = LimitsConfig(v_m_s=limits.omega_rad_s, a_m_s2=alpha, jerk_m_s3=alpha * limits.jerk_m_s3 / a)
        else:
            # From chord to arc.
            step = np.hypot(*np.diff(planned.poses[part, :2], axis=0).T) / np.sinc(half / math.pi)
            inner = slice(1, -1)
            kappa[inner] = omega[inner] / self.speed[inner]
            kappa[0], kappa[-1] = kappa[1 % len(v)], kappa[-2 % len(v)]
        self.s: FloatArray = np.concatenate([[0.0], np.cumsum(step)])
        table = np.column_stack([self.s, planned.poses[part], kappa])
        self.geometry = Geometry([Piece(int(self.sign), table, math.inf)])

    def at(self, s: FloatArray, speed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Poses (N, 3), omega (N,) and v (N,) at places and speeds; heading and turn rate are from one curve."""
        if self.turns:
            start = self.geometry.pieces[0].start
            poses = np.column_stack([np.full_like(s, start.x), np.full_like(s, start.y), start.theta + self.sign * s])
            return poses, self.sign * speed, np.zeros_like(s)
        rows = self.geometry.at(s)
        return rows[:, :3], rows[:, 3] * speed, self.sign * speed

    def nearest(self, s: float, pose: SE2) -> float:
        """The place of a pose on the stretch, from a place some hundredths of a millimetre off."""
        if self.turns:
            off = self.sign * (pose.theta - self.geometry.pieces[0].start.theta) - s
        else:
            x, y, theta = (float(number) for number in self.geometry.at(np.array([s]))[0, :3])
            off = self.sign * ((pose.x - x) * math.cos(theta) + (pose.y - y) * math.sin(theta))
        return min(max(s + off, 0.0), self.geometry.length)

    def envelope(self, factor: float, cuts: FloatArray) -> FloatArray:
        """(n,) the largest speed in each segment: the planned one's maximum, times a factor.

        Where the plan cruises, something bounds it, such as a slow zone: segments that touch that place keep to it."""
        inside = [self.speed[(self.s > low) & (self.s < high)].max(initial=0.0) for low, high in zip(cuts, cuts[1:])]
        at_cuts = np.interp(cuts, self.s, self.speed)
        most = np.maximum(np.array(inside), np.maximum(at_cuts[1:], at_cuts[:-1]))
        cruises = np.abs(np.diff(self.speed)) < _NOTHING
        begin, end, speed = self.s[:-1][cruises], self.s[1:][cruises], self.speed[1:][cruises]
        bound = [speed[(begin < high) & (end > low)].min(initial=math.inf) for low, high in zip(cuts, cuts[1:])]
        return np.asarray(factor * np.minimum(most, bound), np.float64)

    def profile(self, s: float, u: float, a: float, factor: float) -> tuple[Profile, float] | None:
        """The fastest profile found from a place, speed and acceleration, and the factor to stretch its time by."""
        g = self.geometry
        best: tuple[Profile, float] | None = None
        free = factor * float(np.interp(s, self.s, self.speed))
        entry = min(max(u + a * abs(a) / (2.0 * self.limits.jerk_m_s3), 0.0), free)
        rests, envelope = u < _NOTHING, partial(self.envelope, factor)
        entries = [share * entry for share in _ENTRY_SHARES] if factor > 0.0 and not rests else [0.0]
        for entry, share in itertools.product(entries, _BRAKE_SHARES):
            for segment_m in _SEGMENTS_M:
                profile = Profile()
                if not rests and not profile.add_change(s, (u, a), entry, share * self.limits.a_m_s2, self.limits):
                    continue
                reached = profile.end if profile.rows else s
                if reached > g.length + _NOTHING:
                    continue
                if factor > 0.0 and not profile.add_way(g, reached, segment_m, self.limits, entry, envelope):
                    continue
                if not profile.rows:
                    continue
                stretch = excess(g, profile, self.limits)
                if stretch > 1.0 + _TOLERANCE and not rests:
                    continue
                if best is None or stretch * profile.duration < best[1] * best[0].duration:
                    best = profile, stretch
            if best is not None:
                return best
        return best


def retime(planned: Trajectory, current: Timing, t_s: float, factor: float, limits: LimitsConfig) -> Timing | None:
    """The rest of ``current`` after t_s, at ``factor`` times the planned speeds.

    It begins with the speed and acceleration at t_s; factor 0 comes to rest on the path as soon as possible. None when
    no such change keeps the limits now: the current timing keeps them, so continue with it and try again later."""
    t = float(np.clip(t_s, 0.0, current.trajectory.duration_s))
    times = current.trajectory.times_s - current.trajectory.times_s[0]
    place = float(np.interp(t, times, current.places_s))
    if len(planned.times_s) < 2 or place >= planned.duration_s:
        return _standing(planned, place)
    stretch = _Stretch(planned, place, limits)
    u, a = _speed_and_acceleration(current.trajectory, times, t, stretch.turns)
    a = min(max(a, -stretch.limits.a_m_s2), stretch.limits.a_m_s2)
    if u < _NOTHING and factor == 0.0:
        return _standing(planned, place)
    s = stretch.nearest(float(np.interp(place, stretch.times, stretch.s)), current.trajectory.at(t)[0])
    if u < _NOTHING and stretch.geometry.length - s < _NOTHING:  # it came to rest where this stretch ends
        if stretch.last == len(planned.times_s) - 1:
            return _standing(planned, planned.duration_s)
        place, s = float(stretch.times[-1]), 0.0
        stretch = _Stretch(planned, place, limits)
    found = stretch.profile(s, u, a, factor)
    return None if found is None else _sampled(planned, stretch, place, *found, factor)


def stop_m(planned: Trajectory, t_s: float, limits: LimitsConfig) -> float:
    """Length of the stop along a planned trajectory from its speed at t_s [m]; infinite if none keeps the limits."""
    held = retime(planned, Timing(planned, planned.times_s - planned.times_s[0]), t_s, 0.0, limits)
    if held is None:
        return math.inf
    return float(np.sum(np.hypot(*np.diff(held.trajectory.poses[:, :2], axis=0).T)))


def _speed_and_acceleration(trajectory: Trajectory, times: FloatArray, t: float, turns: bool) -> tuple[float, float]:
    """|speed| at an instant and its rate of change, interpolated from the slopes at the middles of the intervals."""
    speed = np.abs(trajectory.omega if turns else trajectory.v)
    steps = np.diff(times)
    keep = steps > 0.0
    if not np.any(keep) or t >= times[-1]:
        return float(speed[-1]) if t >= times[-1] else 0.0, 0.0
    middles = 0.5 * (times[1:] + times[:-1])[keep]
    slopes = (np.diff(speed)[keep]) / steps[keep]
    u = float(np.interp(t, times, speed))
    return u, float(np.interp(t, middles, slopes)) if u > 0.0 else 0.0


def _standing(planned: Trajectory, place: float) -> Timing:
    pose = planned.at(place)[0]
    return Timing(Trajectory(np.zeros(1), pose.as_array()[None], np.zeros(1), np.zeros(1)), np.array([place]))


def _sampled(
    planned: Trajectory, stretch: _Stretch, place: float, profile: Profile, slowed: float, factor: float
) -> Timing:
    """The samples of the profile from a place on, followed by the later stretches, slowed by the factor."""
    n = max(2, math.ceil(profile.duration * slowed / _SAMPLE_S) + 1)
    times = np.linspace(0.0, profile.duration, n)
    s, speed, _ = profile.at(times)
    speed = np.maximum(speed, 0.0) / slowed
    speed[-1] = 0.0
    places = np.maximum(np.interp(s, stretch.s, stretch.times), place)
    own = planned.times_s - planned.times_s[0]
    poses, turn_rate, v = stretch.at(s, speed)
    times = times * slowed
    if factor == 0.0:
        return Timing(Trajectory(times, poses, v, turn_rate), places)
    later = slice(stretch.last + 1, None)
    after = times[-1] + (own[later] - own[stretch.last]) / factor
    columns = (
        (times, after), (poses, planned.poses[later]), (v, factor * planned.v[later]),
        (turn_rate, factor * planned.omega[later]),
    )  # fmt: skip
    joined = Trajectory(*(np.concatenate(column) for column in columns))
    return Timing(joined, np.concatenate([places, own[later]]))
