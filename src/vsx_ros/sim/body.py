"""The emulated base: differential drive with lag, latency, imperfect wheels, encoders, gyro and a bumper."""

import math
from collections import deque
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, body_twist, integrate, wrap_angle
from vsx_ros.sim.moving import Borders, Moving, Nearest, Robot

SUBSTEP_NS = 5_000_000  # 1.5 mm at full speed
HISTORY = 512  # substeps, 2.5 s: longer than an image needs the body's motion
FREE_AGAIN_M = 0.003  # play of a bumper between pressed and released
BUMPER_CENTRE_RAD = math.radians(25.0)  # of the middle one of three, to each side
SEEN_RAD = math.radians(28.0)  # to each side, by a Kinect's colour camera
BUMPER_SIDE_RAD = math.radians(90.0)  # the bumper is the front half
STANDS_M_S = 0.02  # slower, a base has as good as stopped
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


class Contacts(NamedTuple):
    """Contacts by cause. things: the robot drove into what stood there, a door or a chair. into_people: it drove into a
    person that its camera could see. by_people: a person walked into it, or stood where it does not look."""

    things: int = 0
    into_people: int = 0
    by_people: int = 0


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
    """A disc of the given radius [m] among wall segments (N, 4) [m] and movers. Not thread-safe: one owner advances it,
    and the movers with it. Public state: time_ns, T_world_base, path_length_m, contacts, min_clearance_m, bumper."""

    def __init__(
        self, segments: FloatArray, start: SE2, radius: float, settings: BodySettings, rng: np.random.Generator,
        moving: Moving | None = None,
    ) -> None:  # fmt: skip
        self._walls, self._moving = Borders(segments), moving
        self._radius, self._settings, self._rng = radius, settings, rng
        scale = rng.uniform(-1.0, 1.0, 2) * settings.wheel_scale_error
        self._scale_left, self._scale_right = ((1.0 + scale) * settings.true_way).tolist()
        self._gyro_scale = (1.0 + float(rng.uniform(-1.0, 1.0)) * settings.gyro_scale_error) * settings.gyro_scale
        self._gyro_bias = float(rng.uniform(-1.0, 1.0)) * settings.gyro_bias_rad_s + settings.gyro_zero_rad_s
        self._wheel_base_m = settings.wheel_base_m * settings.true_track
        self.time_ns = 0
        self.T_world_base = start
        self.path_length_m = 0.0
        self.contacts = Contacts()
        self.bumper = Bumper()
        self._in_contact = False
        self.min_clearance_m = self.clearance(start.x, start.y)
        self._pending: deque[tuple[int, float, float]] = deque()
        self._wanted = (0.0, 0.0)
        self._wheels = (0.0, 0.0)
        self._rolled_left = self._rolled_right = 0.0
        self._gyro = 0.0
        self._history: deque[tuple[float, ...]] = deque(maxlen=HISTORY)
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

    @property
    def collisions(self) -> int:
        """Contacts by the robot's own motion."""
        return self.contacts.things + self.contacts.into_people

    def clearance(self, x: float, y: float) -> float:
        """Gap between a body at x, y and the nearest wall or mover [m]; negative if they overlap."""
        return self._nearest(x, y).distance_m - self._radius

    def poses_at(self, stamps_ns: IntArray) -> FloatArray:
        """(N, 4 + K) x, y, theta and travelled path at the stamps (N,), and the K numbers of the movers' states, by
        interpolation. Raises InputError when a stamp lies outside the remembered 2.5 s or in the future."""
        past = np.array(self._history)
        first, last = int(past[0, 0]), self.time_ns
        if len(stamps_ns) and (int(stamps_ns.min()) < first or int(stamps_ns.max()) > last):
            raise InputError(
                f"poses asked for {stamps_ns.min()}..{stamps_ns.max()} ns, but the body remembers {first}..{last} ns; "
                "advance the body past the end of the exposure first"
            )
        return np.column_stack([np.interp(stamps_ns, past[:, 0], past[:, k]) for k in range(1, past.shape[1])])

    def _remember(self) -> None:
        pose = self.T_world_base
        moved = () if self._moving is None else self._moving.state
        self._history.append((self.time_ns, pose.x, pose.y, pose.theta, self.path_length_m, *moved))

    def _nearest(self, x: float, y: float) -> Nearest:
        wall = self._walls.nearest(x, y)
        return wall if self._moving is None else min(wall, self._moving.nearest(x, y))

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
        if self._moving is not None:
            self._let_others_move(self._moving, dt)
        self._gyro += turn * self._gyro_scale + self._gyro_bias * dt
        self._remember()

    def _move(self, distance: float, turn: float) -> None:
        """Follow the arc, or only turn if a wall is in the way."""
        before = self.T_world_base
        after = integrate(before, distance, turn)
        near = self._nearest(after.x, after.y)
        clearance = near.distance_m - self._radius
        blocked = clearance < 0.0 and clearance < self.clearance(before.x, before.y)
        if blocked:
            self.T_world_base = SE2(before.x, before.y, after.theta)
            self.min_clearance_m = min(self.min_clearance_m, 0.0)
            side = wrap_angle(math.atan2(near.dy, near.dx) - after.theta)
            person = self._moving is not None and near.mover >= 0 and self._moving.movers[near.mover].is_person
            if person:
                drives = abs(sum(self._wheels)) > 2.0 * STANDS_M_S
                self._touch("into_people" if drives and abs(side) < SEEN_RAD else "by_people", side)
            else:
                self._touch("things", side)
            return
        self.T_world_base = after
        self.path_length_m += abs(distance)
        self.min_clearance_m = min(self.min_clearance_m, clearance)
        if clearance > FREE_AGAIN_M and not (self._moving is not None and self._moving.pushes):
            self._in_contact = False
            self.bumper = Bumper()

    def _touch(self, cause: str, side: float) -> None:
        """Press the bumper towards side [rad], and count a contact that begins."""
        if not self._in_contact:
            self.contacts = self.contacts._replace(**{cause: getattr(self.contacts, cause) + 1})
        self._in_contact = True
        self.bumper = Bumper(
            BUMPER_CENTRE_RAD < side <= BUMPER_SIDE_RAD,
            abs(side) <= BUMPER_CENTRE_RAD,
            -BUMPER_SIDE_RAD <= side < -BUMPER_CENTRE_RAD,
        )

    def _let_others_move(self, moving: Moving, dt: float) -> None:
        pose = self.T_world_base
        moving.step(dt, Robot(pose, self._radius))
        for mover in moving.movers:
            if mover.pushes:
                x, y = mover.state[:2].tolist()
                self._touch("by_people", wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.theta))
