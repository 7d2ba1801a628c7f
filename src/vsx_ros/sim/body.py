"""The emulated base: differential drive with lag, latency, imperfect wheels, encoders, gyro and a bumper."""

import math
from collections import deque
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, body_twist, integrate, wrap_angle

SUBSTEP_NS = 5_000_000  # 1.5 mm at full speed
HISTORY = 512  # substeps, 2.5 s: longer than an image needs the body's motion
FREE_AGAIN_M = 0.003  # play of a bumper between pressed and released
BUMPER_CENTRE_RAD = math.radians(25.0)  # of the middle one of three, to each side
BUMPER_SIDE_RAD = math.radians(90.0)  # the bumper is the front half
STUCK_NS = 400_000_000  # of a wheel that sticks
Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]


class BodySettings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A Kobuki by default: wheel base, encoder step and gyro step are its own; errors are half-widths or deviations.
    true_way, true_track: true distance rolled and true wheel distance, relative to the driver's. gyro_scale: read turn
    / true turn. gyro_zero_rad_s: reading at standstill. sticks_every_s: mean time until a wheel sticks; 0: never."""

    wheel_base_m: Positive = 0.230
    tick_m: Positive = 0.000085292
    lag_s: Positive = 0.08
    latency_ns: Annotated[int, Meta(ge=0)] = 60_000_000
    wheel_scale_error: NonNegative = 0.005
    slip: NonNegative = 0.02
    gyro_scale_error: NonNegative = 0.003
    gyro_bias_rad_s: NonNegative = 0.0003
    gyro_step_rad: Positive = 0.00017453
    true_way: Positive = 1.0
    true_track: Positive = 1.0
    gyro_scale: Positive = 1.0
    gyro_zero_rad_s: float = 0.0
    sticks_every_s: NonNegative = 0.0


class Bumper(NamedTuple):
    """Which sectors of the front bumper are pressed."""

    left: bool = False
    centre: bool = False
    right: bool = False


class StickyWheel:
    """One wheel that sometimes stands still for a moment, whatever it is told."""

    def __init__(self, every_s: float, rng: np.random.Generator) -> None:
        self._every_s, self._rng = every_s, rng
        self._is_left = bool(rng.integers(2))
        self._from_ns = self._until_ns = 0

    def turned(self, now_ns: int, left: float, right: float) -> tuple[float, float]:
        """The speeds [m/s] that the wheels are driven with."""
        if now_ns >= self._until_ns:
            self._from_ns = now_ns + round(1e9 * float(self._rng.exponential(self._every_s)))
            self._until_ns = self._from_ns + STUCK_NS
        if now_ns < self._from_ns:
            return left, right
        return (0.0, right) if self._is_left else (left, 0.0)


class Body:
    """A disc of the given radius [m] among wall segments (N, 4) [m]. Not thread-safe: one owner advances it. Public
    state: time_ns, T_world_base, path_length_m, collisions, min_clearance_m, bumper."""

    def __init__(
        self, segments: FloatArray, start: SE2, radius: float, settings: BodySettings, rng: np.random.Generator
    ) -> None:
        self._a, self._edge = segments[:, :2], segments[:, 2:] - segments[:, :2]
        self._length2 = np.maximum((self._edge**2).sum(axis=1), 1e-12)
        self._radius, self._settings, self._rng = radius, settings, rng
        scale = rng.uniform(-1.0, 1.0, 2) * settings.wheel_scale_error
        self._scale_left, self._scale_right = ((1.0 + scale) * settings.true_way).tolist()
        self._gyro_scale = (1.0 + float(rng.uniform(-1.0, 1.0)) * settings.gyro_scale_error) * settings.gyro_scale
        self._gyro_bias = float(rng.uniform(-1.0, 1.0)) * settings.gyro_bias_rad_s + settings.gyro_zero_rad_s
        self._wheel_base_m = settings.wheel_base_m * settings.true_track
        self.time_ns = 0
        self.T_world_base = start
        self.path_length_m = 0.0
        self.collisions = 0
        self.bumper = Bumper()
        self._in_contact = False
        self.min_clearance_m = self.clearance(start.x, start.y)
        self._pending: deque[tuple[int, float, float]] = deque()
        self._wanted = (0.0, 0.0)
        self._wheels = (0.0, 0.0)
        self._rolled_left = self._rolled_right = 0.0
        self._gyro = 0.0
        self._history: deque[tuple[int, float, float, float, float]] = deque(maxlen=HISTORY)
        self._sticky = StickyWheel(settings.sticks_every_s, rng.spawn(1)[0]) if settings.sticks_every_s else None
        self._remember()

    def set_wheel_speeds(self, left: float, right: float) -> None:
        """Command wheel speeds [m/s]; they take effect after the latency."""
        if not (math.isfinite(left) and math.isfinite(right)):
            raise InputError(f"wheel speeds ({left}, {right}) m/s must be finite")
        self._pending.append((self.time_ns + self._settings.latency_ns, left, right))

    def advance(self, dt_ns: int) -> None:
        """Let dt_ns pass."""
        end_ns = self.time_ns + dt_ns
        while self.time_ns < end_ns:
            self._substep(min(SUBSTEP_NS, end_ns - self.time_ns))

    def encoders(self) -> tuple[int, int]:
        """(left, right) ticks rolled since the start, not wrapped."""
        tick = self._settings.tick_m
        return math.floor(self._rolled_left / tick), math.floor(self._rolled_right / tick)

    @property
    def gyro_angle_rad(self) -> float:
        """Heading by the gyro, zero at the start, with drift, quantised in its steps, not wrapped."""
        step = self._settings.gyro_step_rad
        return math.floor(self._gyro / step + 0.5) * step

    def clearance(self, x: float, y: float) -> float:
        """Gap between a body at x, y and the nearest wall [m]; negative if they overlap."""
        return self._nearest(x, y)[0] - self._radius

    def poses_at(self, stamps_ns: IntArray) -> FloatArray:
        """(N, 4) x, y, theta and travelled path at the stamps (N,), by interpolation. Raises InputError when a stamp
        lies outside the remembered 2.5 s or in the future."""
        past = np.array(self._history)
        first, last = int(past[0, 0]), self.time_ns
        if len(stamps_ns) and (int(stamps_ns.min()) < first or int(stamps_ns.max()) > last):
            raise InputError(
                f"poses asked for {stamps_ns.min()}..{stamps_ns.max()} ns, but the body remembers {first}..{last} ns; "
                "advance the body past the end of the exposure first"
            )
        return np.column_stack([np.interp(stamps_ns, past[:, 0], past[:, k]) for k in range(1, 5)])

    def _remember(self) -> None:
        pose = self.T_world_base
        self._history.append((self.time_ns, pose.x, pose.y, pose.theta, self.path_length_m))

    def _nearest(self, x: float, y: float) -> tuple[float, float, float]:
        """Distance to the nearest wall and the vector to it [m]."""
        offset = np.array([x, y]) - self._a
        ratio = np.clip((offset * self._edge).sum(axis=1) / self._length2, 0.0, 1.0)
        gap = ratio[:, None] * self._edge - offset
        squared = (gap**2).sum(axis=1)
        k = int(np.argmin(squared))
        return math.sqrt(float(squared[k])), float(gap[k, 0]), float(gap[k, 1])

    def _substep(self, dt_ns: int) -> None:
        dt = dt_ns * 1e-9
        while self._pending and self._pending[0][0] <= self.time_ns:
            _, left, right = self._pending.popleft()
            self._wanted = (left, right)
        wanted = self._wanted if self._sticky is None else self._sticky.turned(self.time_ns, *self._wanted)
        follow = 1.0 - math.exp(-dt / self._settings.lag_s)
        left = self._wheels[0] + follow * (wanted[0] - self._wheels[0])
        right = self._wheels[1] + follow * (wanted[1] - self._wheels[1])
        self._wheels = (left, right)
        self._rolled_left += left * dt
        self._rolled_right += right * dt
        slip = 1.0 + self._settings.slip * self._rng.standard_normal(2)
        ground_left = left * dt * self._scale_left * float(slip[0])
        ground_right = right * dt * self._scale_right * float(slip[1])
        distance, turn = body_twist(ground_left, ground_right, self._wheel_base_m)
        self.time_ns += dt_ns
        self._move(distance, turn)
        self._gyro += turn * self._gyro_scale + self._gyro_bias * dt
        self._remember()

    def _move(self, distance: float, turn: float) -> None:
        """Follow the arc, or only turn if a wall is in the way."""
        before = self.T_world_base
        after = integrate(before, distance, turn)
        gap, dx, dy = self._nearest(after.x, after.y)
        clearance = gap - self._radius
        blocked = clearance < 0.0 and clearance < self.clearance(before.x, before.y)
        if blocked:
            self.T_world_base = SE2(before.x, before.y, after.theta)
            self.min_clearance_m = min(self.min_clearance_m, 0.0)
            if not self._in_contact:
                self.collisions += 1
            self._in_contact = True
            side = wrap_angle(math.atan2(dy, dx) - after.theta)
            self.bumper = Bumper(
                BUMPER_CENTRE_RAD < side <= BUMPER_SIDE_RAD,
                abs(side) <= BUMPER_CENTRE_RAD,
                -BUMPER_SIDE_RAD <= side < -BUMPER_CENTRE_RAD,
            )
            return
        self.T_world_base = after
        self.path_length_m += abs(distance)
        self.min_clearance_m = min(self.min_clearance_m, clearance)
        if clearance > FREE_AGAIN_M:
            self._in_contact = False
            self.bumper = Bumper()
