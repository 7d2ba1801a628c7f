"""Speed over the arc length of a stretch between two stops, as phases of constant jerk.

The stretch is cut into segments. In each, the curvature's size and slope turn the limits of the body into limits of the
path speed. A forward and a backward pass give the speeds at the cuts. ruckig gives the time-optimal jerk-limited move
between them. (ruckig's own way-points are not used: that interface needs a network service.)"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import ruckig

from vsx_ros.arrays import FloatArray
from vsx_ros.config import LimitsConfig
from vsx_ros.planning.pieces import Piece

NOWHERE: FloatArray = np.zeros((0, 3))  # no spans
_CHECK_S = 0.002  # between samples at which a profile is checked against the limits
_SLOPE_SHARE = 0.8  # of the turn acceleration, for the change of curvature
_NOTHING = 1e-9  # m, m/s: rounding


class Geometry:
    """Curvature over the arc length of one stretch."""

    def __init__(self, pieces: list[Piece], slow: FloatArray = NOWHERE) -> None:
        """slow: (K, 3) spans of arc length from and to [m], and the speed allowed there [m/s]."""
        self.slow = slow
        offsets = np.cumsum([0.0] + [piece.length_m for piece in pieces])
        self.pieces, self.offsets, self.direction = pieces, offsets, pieces[0].direction
        s = np.concatenate([piece.table[:, 0] + offset for piece, offset in zip(pieces, offsets)])
        kappa = np.concatenate([piece.table[:, 4] for piece in pieces])
        keep = np.concatenate([[True], np.diff(s) > 1e-9])
        self.s, self.kappa = s[keep], kappa[keep]
        if len(self.s) == 1:
            self.s, self.kappa = np.array([0.0, float(offsets[-1])]), np.repeat(self.kappa, 2)
        self.slope = np.diff(self.kappa) / np.diff(self.s)
        self.length = float(offsets[-1])

    def at(self, s: FloatArray) -> FloatArray:
        """(N, 5) of ``Piece.at`` over the whole stretch."""
        out = np.empty((len(s), 5))
        index = np.clip(np.searchsorted(self.offsets, s, side="right") - 1, 0, len(self.pieces) - 1)
        for k, piece in enumerate(self.pieces):
            mask = index == k
            if np.any(mask):
                out[mask] = piece.at(s[mask] - self.offsets[k])
        return out


def segment_limits(g: Geometry, cuts: FloatArray, limits: LimitsConfig) -> tuple[FloatArray, FloatArray]:
    """(n,) speed and (n,) acceleration allowed in each segment, so that any move keeps omega and alpha."""
    middle = 0.5 * (g.s[1:] + g.s[:-1])
    # Largest squared speed at a distance from rest: bounded by the acceleration, and nearer by the jerk.
    off = np.minimum(g.s[1:], g.length - g.s[:-1])
    from_rest = np.minimum(2.0 * limits.a_m_s2 * off, (4.5 * limits.jerk_m_s3 * off**2) ** (2.0 / 3.0))
    v_all, a_all = np.empty(len(cuts) - 1), np.empty(len(cuts) - 1)
    for i, (low, high) in enumerate(zip(cuts[:-1], cuts[1:])):
        first = max(0, int(np.searchsorted(g.s, low, side="right")) - 1)
        last = min(len(middle), int(np.searchsorted(g.s, high, side="left")))
        slope = np.abs(g.slope[first:last])
        kappa = float(np.max(np.abs(g.kappa[first : last + 1])))
        v = min(limits.v_m_s, limits.omega_rad_s / max(kappa, 1e-9))
        slow = (g.slow[:, 0] < high) & (g.slow[:, 1] > low)
        v = min(v, float(g.slow[slow, 2].min(initial=math.inf)))
        # Near a stop the curvature may change steeply, but the distance from rest bounds the speed there.
        room = from_rest[first:last]
        steep = slope * np.minimum(v * v, room)
        if float(steep.max()) > _SLOPE_SHARE * limits.alpha_rad_s2:
            binding = slope * room > _SLOPE_SHARE * limits.alpha_rad_s2
            if np.any(binding):
                v = min(v, math.sqrt(_SLOPE_SHARE * limits.alpha_rad_s2 / float(slope[binding].max())))
            steep = slope * np.minimum(v * v, room)
        left = limits.alpha_rad_s2 - float(steep.max())
        v_all[i] = v
        a_all[i] = min(limits.a_m_s2, max(left, 0.1 * limits.alpha_rad_s2) / max(kappa, 1e-9))
    return v_all, a_all


def _reach(v: float, length: float, a: float, jerk: float, v_max: float) -> float:
    """The largest speed that can be reached from v within the length, with zero acceleration at both ends."""

    def distance(target: float) -> float:
        dv = target - v
        duration = 2.0 * math.sqrt(dv / jerk) if dv * jerk <= a * a else dv / a + a / jerk
        return 0.5 * (v + target) * duration

    if distance(max(v, v_max)) <= length:
        return max(v, v_max)
    low, high = v, v_max
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if distance(middle) <= length else (low, middle)
    return low


def cut_speeds(lengths: FloatArray, v: FloatArray, a: FloatArray, jerk: float, entry: float = 0.0) -> FloatArray:
    """(n + 1,) speeds at the cuts, the entry's and zero at the ends, reachable from each other.

    If the entry is too fast for what follows, the first speed is lower than the entry."""
    n = len(lengths)
    speeds = np.concatenate([[min(entry, float(v[0]))], np.minimum(v[1:], v[:-1]), [0.0]])
    for i in range(n):
        speeds[i + 1] = min(speeds[i + 1], _reach(float(speeds[i]), float(lengths[i]), float(a[i]), jerk, float(v[i])))
    for i in range(n - 1, -1, -1):
        speeds[i] = min(speeds[i], _reach(float(speeds[i + 1]), float(lengths[i]), float(a[i]), jerk, float(v[i])))
    return speeds


class Profile:
    """Phases of constant jerk: start time, position, speed, acceleration and jerk of each."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, float, float, float, float]] = []
        self.duration = 0.0

    def add_way(
        self, g: Geometry, s: float, segment_m: float, limits: LimitsConfig, entry: float = 0.0,
        envelope: Callable[[FloatArray], FloatArray] | None = None,
    ) -> bool:  # fmt: skip
        """Append the drive from s, at speed entry, to rest at the end of the stretch; False if there is none.

        envelope: maps the cuts (n + 1,) between segments to the largest speeds (n,) in them."""
        if g.length - s < _NOTHING:
            return entry < _NOTHING
        cuts = np.linspace(s, g.length, max(1, math.ceil((g.length - s) / segment_m)) + 1)
        v, a = segment_limits(g, cuts, limits)
        v = v if envelope is None else np.minimum(v, envelope(cuts))
        speeds = cut_speeds(np.diff(cuts), v, a, limits.jerk_m_s3, entry)
        if speeds[0] < entry - _NOTHING:
            return False
        v[0] = max(v[0], entry)  # rounding; what follows is no faster than its own limit
        bounds = [(most, a_max, limits.jerk_m_s3) for most, a_max in zip(v.tolist(), a.tolist())]
        return all(map(self.add_move, cuts.tolist(), np.diff(cuts).tolist(), pairwise(speeds.tolist()), bounds))

    def add_move(self, s: float, length: float, ends: tuple[float, float], bounds: tuple[float, float, float]) -> bool:
        """Append the time-optimal move over a length between two speeds; False if there is none."""
        query = ruckig.InputParameter(1)
        query.current_position, query.current_velocity, query.current_acceleration = [0.0], [ends[0]], [0.0]
        query.target_position, query.target_velocity, query.target_acceleration = [length], [ends[1]], [0.0]
        query.max_velocity, query.max_acceleration, query.max_jerk = [bounds[0]], [bounds[1]], [bounds[2]]
        return self._append(query, s)

    def add_change(self, s: float, now: tuple[float, float], v: float, a_max: float, limits: LimitsConfig) -> bool:
        """Append the fastest change from a speed and acceleration to a constant speed v; False if there is none."""
        query = ruckig.InputParameter(1)
        query.control_interface = ruckig.ControlInterface.Velocity
        query.current_position, query.current_velocity, query.current_acceleration = [0.0], [now[0]], [now[1]]
        query.target_velocity, query.target_acceleration = [v], [0.0]
        query.max_acceleration, query.max_jerk = [a_max], [limits.jerk_m_s3]
        return self._append(query, s)

    @property
    def end(self) -> float:
        """Where the last phase ends."""
        return float(self.at(np.array([self.duration]))[0][0])

    def _append(self, query: ruckig.InputParameter, s: float) -> bool:
        move = ruckig.Trajectory(1)
        try:
            if ruckig.Ruckig(1).calculate(query, move) not in (ruckig.Result.Working, ruckig.Result.Finished):
                return False
        except ruckig.RuckigError:  # no numerical solution: speeds and lengths just do not fit each other
            return False
        profile = move.profiles[0][0]
        if profile.brake.duration > 0.0 or min(profile.v) < -1e-9:
            return False
        for t, p, v, a, j in zip(profile.t, profile.p, profile.v, profile.a, profile.j):
            if t > 0.0:
                self.rows.append((self.duration, s + p, v, a, j))
                self.duration += t
        return True

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration at times (N,)."""
        table = np.array(self.rows)
        row = table[np.clip(np.searchsorted(table[:, 0], times, side="right") - 1, 0, len(table) - 1)]
        u = np.clip(times, 0.0, self.duration) - row[:, 0]
        position = row[:, 1] + u * (row[:, 2] + u * (row[:, 3] / 2.0 + u * row[:, 4] / 6.0))
        return position, row[:, 2] + u * (row[:, 3] + u * row[:, 4] / 2.0), row[:, 3] + u * row[:, 4]


def excess(g: Geometry, profile: Profile, limits: LimitsConfig) -> float:
    """The factor by which time must be stretched so that every limit holds (1 when all hold)."""
    times = np.linspace(0.0, profile.duration, max(3, math.ceil(profile.duration / _CHECK_S)))
    s, v, a = profile.at(times)
    omega = np.interp(s, g.s, g.kappa) * v
    alpha = np.diff(omega) / np.diff(times)
    return max(
        1.0,
        float(np.max(v)) / limits.v_m_s,
        float(np.max(np.abs(omega))) / limits.omega_rad_s,
        math.sqrt(float(np.max(np.abs(a))) / limits.a_m_s2),
        math.sqrt(float(np.max(np.abs(alpha))) / limits.alpha_rad_s2),
    )
