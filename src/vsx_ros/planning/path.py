"""Results of planning: a Path is geometry, a Plan a path to a goal, a Trajectory has time, a Refusal a reason."""

import enum
import itertools
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import PlannerConfig
from vsx_ros.errors import PlanningError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.planning.pieces import Piece

_CURVATURE_JUMP = 1e-6  # rad/m; less is rounding, and the base continues without a stop
_TURN_STEP_RAD = 0.1  # between samples of a turn on the spot


class RefusalKind(enum.Enum):
    """Why there is no plan."""

    START_BLOCKED = "start blocked"
    GOAL_BLOCKED = "goal blocked"
    DISCONNECTED = "disconnected"
    BUDGET = "budget"
    INFEASIBLE = "infeasible"
    BLIND = "blind"
    ZONE = "zone"


@dataclass(frozen=True, slots=True)
class Refusal:
    """No plan, and the reason in words."""

    kind: RefusalKind
    reason: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """What is proved or measured of a path.

    curvature_bound_rad_m: no point of the path turns faster than this per metre (infinite with turns on the spot).
    method: how that was proved or measured. end_error_m, end_error_rad: distance of the last pose from the goal.
    min_clearance_m: least distance of the base's centre to ground not known to be free, or None when no map was used.
    """

    curvature_bound_rad_m: float
    method: str
    end_error_m: float
    end_error_rad: float
    min_clearance_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Pieces in driving order; empty where start and goal are the same pose."""

    start: SE2
    pieces: tuple[Piece, ...]
    certificate: Certificate

    @property
    def length_m(self) -> float:
        """Arc length in both directions together [m]."""
        return sum(piece.length_m for piece in self.pieces)

    @property
    def end(self) -> SE2:
        """The last pose; theta unwrapped along the path."""
        return self.pieces[-1].end if self.pieces else self.start

    @property
    def reverse_m(self) -> float:
        """Arc length driven in reverse [m]."""
        return sum(piece.length_m for piece in self.pieces if piece.direction < 0)

    @property
    def longest_reverse_m(self) -> float:
        """The longest leg driven in reverse without a change of direction [m]."""
        legs = itertools.groupby(self.pieces, key=lambda piece: piece.direction)
        return max((sum(p.length_m for p in leg) for direction, leg in legs if direction < 0), default=0.0)

    @property
    def turn_on_spot_rad(self) -> float:
        """Total heading change in turns on the spot [rad]."""
        return sum(abs(piece.turn_rad) for piece in self.pieces if piece.direction == 0)

    @property
    def cusps(self) -> tuple[float, ...]:
        """Arc lengths [m] at which the driving direction changes."""
        ends = itertools.accumulate(piece.length_m for piece in self.pieces)
        pairs = zip(self.pieces, self.pieces[1:])
        return tuple(s for s, (a, b) in zip(ends, pairs) if a.direction * b.direction < 0)

    def stretches(self) -> list[list[Piece]]:
        """Runs of pieces between stops: the base stands where direction or curvature jumps."""
        runs: list[list[Piece]] = []
        for piece in self.pieces:
            if runs and _runs_on(runs[-1][-1], piece):
                runs[-1].append(piece)
            else:
                runs.append([piece])
        return runs

    @property
    def jumps(self) -> int:
        """How often the base stops only because the curvature jumps."""
        return max(0, len(self.stretches()) - 1 - len(self.cusps))

    def cost_m(self, config: PlannerConfig) -> float:
        """Length plus the cost of stops, by which paths are chosen [m]."""
        return self.length_m + config.cusp_cost_m * len(self.cusps) + config.stop_cost_m * self.jumps

    def sample(self, step_m: float) -> FloatArray:
        """(N, 5) x, y, theta (unwrapped), kappa, direction, at most step_m apart; piece ends included.

        Turns on the spot are sampled every 0.1 rad. Raises PlanningError for a step that is not positive."""
        if not step_m > 0.0:
            raise PlanningError(f"cannot sample a path every {step_m} m; the step must be positive")
        if not self.pieces:
            return np.array([[self.start.x, self.start.y, self.start.theta, 0.0, 0.0]])
        rows = []
        for piece in self.pieces:
            if piece.direction == 0:
                n = max(1, int(np.ceil(abs(piece.turn_rad) / _TURN_STEP_RAD)))
                turn = np.zeros((n + 1, 5))
                turn[:, :2] = piece.table[0, 1:3]
                turn[:, 2] = np.linspace(piece.start.theta, piece.end.theta, n + 1)
                rows.append(turn)
            else:
                n = max(1, int(np.ceil(piece.length_m / step_m)))
                rows.append(piece.at(np.linspace(0.0, piece.length_m, n + 1)))
        return np.concatenate(rows)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON: totals, certificate and the poses every 5 cm."""
        bound = self.certificate.curvature_bound_rad_m
        return {
            "length_m": self.length_m,
            "reverse_m": self.reverse_m,
            "cusps_m": list(self.cusps),
            "turn_on_spot_rad": self.turn_on_spot_rad,
            "pieces": [{"direction": p.direction, "length_m": p.length_m, "turn_rad": p.turn_rad} for p in self.pieces],
            "certificate": {**asdict(self.certificate), "curvature_bound_rad_m": bound if np.isfinite(bound) else None},
            "poses": [[round(float(v), 6) for v in row] for row in self.sample(0.05)],
        }


def _runs_on(before: Piece, piece: Piece) -> bool:
    """Whether the base need not stop between two pieces."""
    same = before.direction == piece.direction != 0
    return bool(same and abs(before.table[-1, 4] - piece.table[0, 4]) <= _CURVATURE_JUMP)


def certified(start: SE2, goal: SE2, pieces: tuple[Piece, ...], method: str) -> Path:
    """The path with its certificate filled in from the pieces."""
    end = pieces[-1].end if pieces else start
    bound = max((piece.curvature_bound for piece in pieces), default=0.0)
    error_m, error_rad = end.distance_to(goal), abs(wrap_angle(end.theta - goal.theta))
    return Path(start, pieces, Certificate(bound, method, end_error_m=error_m, end_error_rad=error_rad))


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A path to a goal and the name of the planner that made it.

    blind_spans (K, 2): first and last arc length [m] of every stretch along which the camera sees too few landmarks,
    None when the planner was given no landmarks."""

    goal: SE2
    path: Path
    planner: str
    blind_spans: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A path in time, as samples.

    times_s (N,) not decreasing; poses (N, 3) x, y [m], theta [rad, unwrapped]; v (N,) [m/s], negative in reverse;
    omega (N,) [rad/s]. Raises PlanningError for arrays that do not fit together."""

    times_s: FloatArray
    poses: FloatArray
    v: FloatArray
    omega: FloatArray

    def __post_init__(self) -> None:
        n = len(self.times_s)
        shapes = (np.shape(self.times_s), np.shape(self.poses), np.shape(self.v), np.shape(self.omega))
        if n == 0 or shapes != ((n,), (n, 3), (n,), (n,)):
            raise PlanningError(f"a trajectory needs arrays (N,), (N, 3), (N,), (N,) with N >= 1, got {shapes}")
        for name in ("times_s", "poses", "v", "omega"):
            array = np.array(getattr(self, name), float)
            if not np.all(np.isfinite(array)):
                raise PlanningError(f"the trajectory's {name} hold a number that is not finite; plan again")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if np.any(np.diff(self.times_s) < 0.0):
            raise PlanningError("the trajectory's times run backwards; plan again")

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    def at(self, t_s: float) -> tuple[SE2, float, float]:
        """Pose, v [m/s] and omega [rad/s] at t_s after the start, held at both ends.

        The pose is cubic between the samples, with their speeds as slopes; omega is the slope of its heading. With
        linear interpolation the turn rate would jump at each sample."""
        t = float(np.clip(t_s, 0.0, self.duration_s)) + float(self.times_s[0])
        i = int(np.clip(np.searchsorted(self.times_s, t, side="right") - 1, 0, max(0, len(self.times_s) - 2)))
        j = min(i + 1, len(self.times_s) - 1)
        span = float(self.times_s[j] - self.times_s[i])
        u = (t - float(self.times_s[i])) / span if span > 0.0 else 0.0
        ends = slice(i, j + 1, max(1, j - i))
        v, omega, theta = self.v[ends], self.omega[ends], self.poses[ends, 2]
        slopes = span * np.column_stack([v * np.cos(theta), v * np.sin(theta), omega])
        pose, slope = _cubic(self.poses[i], self.poses[j], slopes[0], slopes[-1], u)
        turn_rate = float(slope[2]) / span if span > 0.0 else float(omega[0])
        return SE2(*(float(c) for c in pose)), float((1.0 - u) * v[0] + u * v[-1]), turn_rate


class TimedPlan(NamedTuple):
    """A plan and the speeds to drive it at. clearance_m: (N,) ``planned_clearance``; None for a way without a map."""

    plan: Plan
    trajectory: Trajectory
    clearance_m: FloatArray | None = None


def _cubic(a: FloatArray, b: FloatArray, da: FloatArray, db: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
    """Values and slopes at u in [0, 1] of the cubics with these values and slopes at 0 and 1 (Hermite)."""
    w = 1.0 - u
    values: FloatArray = a + u * u * (3.0 - 2.0 * u) * (b - a) + u * w * (w * da - u * db)
    return values, 6.0 * u * w * (b - a) + w * (1.0 - 3.0 * u) * da + u * (3.0 * u - 2.0) * db
