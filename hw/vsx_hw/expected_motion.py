"""The motion to expect of wheels and gyro: the distances commanded recently, and how much gyro and wheels differ when
both work. Pure; time is an argument."""

import math
from collections import deque

Span = tuple[float, float]

LAGS_NS = tuple(range(0, 600_000_000, 100_000_000))
"""Possible delays between a command and its effect in a report. A Kobuki's dead time is 0.2 s, its speed control takes
another 0.2 s, and the reports may be delayed too."""
LONGEST_PAUSE_NS = 2_000_000_000
"""Longest pause between reports; a longer one makes the earlier motion unknown. A Create 1 reports its motion twice a
second, less often on a busy machine."""
MEMORY_NS = 4_500_000_000  # Window, longest lag and longest pause

FOLLOWS, RUNS_AWAY = 0.1, 1.5
"""Shares of the commanded distance. A working wheel with speed control makes 0.7 to 1.1 of it. A blocked wheel or a
dead encoder gives 0, an encoder that counts each edge twice 2, swapped phases -1."""
WAY_M, SLACK_M = 0.02, 0.015
"""Slower wheels are not judged: friction may hold them. Slack: two reports of a Create 1 are rounded by 7 mm; the same
again for wheels that roll on after a slower command."""
BEGUN = 0.5  # Start-up is over when the smallest expected distance has this share of the largest

WAY_RAD_M, TURN_SHARE = 0.25, 0.1
"""Standard deviations before learning. Wheels that differ by 6 % bend a path by 0.25 rad per metre. Errors of wheels,
wheel base and gyro scale a turn."""
LEARNED_SIGMAS = 1.8
"""The most that is learned, in these standard deviations. Wheels that differ by 10 % take 1.74 of them; a growing drift
of the gyro would take more."""
NOISE_RAD2_S, CHANGE_PER_M, CHANGE_PER_RAD = 2e-4, 2.5e-5, 6e-6
"""Speed of learning: a second of driving halves the deviations; after a change of floor they adapt in some ten metres.
Thirty times as fast, a drift of the gyro that grows by 1 deg/s per second is learned on an arc."""

HELD = "does not follow the command"


class CommandTrace:
    """Call ``tell`` with a command and ``advance`` with each report; ``between`` gives the distances to expect."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float, float]] = deque([(0, 0.0, 0.0)])
        self._speeds = (0.0, 0.0)

    @property
    def time_ns(self) -> int:
        """The latest instant."""
        return self._points[-1][0]

    def tell(self, left_m_s: float, right_m_s: float) -> None:
        """Set the commanded speeds from the latest ``advance`` on."""
        self._speeds = left_m_s, right_m_s

    def advance(self, now_ns: int) -> None:
        """Let time pass at the commanded speeds. After a pause or a clock change, assume that the wheels stood."""
        then_ns, left_m, right_m = self._points[-1]
        if not 0 <= now_ns - then_ns <= LONGEST_PAUSE_NS:
            self._points = deque([(now_ns, 0.0, 0.0)])
            return
        dt_s = (now_ns - then_ns) * 1e-9
        self._points.append((now_ns, left_m + self._speeds[0] * dt_s, right_m + self._speeds[1] * dt_s))
        while self._points[0][0] < now_ns - MEMORY_NS:
            self._points.popleft()

    def between(self, begin_ns: int, end_ns: int, wheel_base_m: float) -> tuple[Span, Span, Span]:
        """(left wheel distance [m], right wheel distance [m], turn [rad]) commanded for this time, each as its smallest
        and largest value over all lags."""
        spans = []
        for lag_ns in LAGS_NS:
            left, right = (b - a for a, b in zip(self._at(begin_ns - lag_ns), self._at(end_ns - lag_ns)))
            spans.append((left, right, (right - left) / wheel_base_m))
        lefts, rights, turns = zip(*spans)
        return (min(lefts), max(lefts)), (min(rights), max(rights)), (min(turns), max(turns))

    def _at(self, time_ns: int) -> tuple[float, float]:
        """Distances of both wheels at this time; before the memory begins, they stood."""
        later = self._points[-1]
        for point in reversed(self._points):
            if point[0] <= time_ns:
                share = (time_ns - point[0]) / (later[0] - point[0]) if later[0] > point[0] else 0.0
                return point[1] + share * (later[1] - point[1]), point[2] + share * (later[2] - point[2])
            later = point
        return later[1], later[2]


def wheel_verdict(way_m: float, told: Span) -> str | None:
    """What is wrong with a wheel's distance over a second, in words; empty if nothing. None when it cannot be judged:
    too slow, just starting or just stopping."""
    least, most = sorted(told, key=abs)
    if abs(most) < WAY_M:
        return None
    if abs(way_m) > RUNS_AWAY * abs(most) + SLACK_M:
        return f"counts {abs(way_m):.2f} m for {abs(most):.2f} m told"
    if told[0] * told[1] <= 0.0 or abs(least) < max(WAY_M, BEGUN * abs(most)):
        return None
    return HELD if way_m * math.copysign(1.0, least) < FOLLOWS * abs(least) else ""


class TurnMismatch:
    """Learns the difference between gyro and wheels while they agree. A Kalman filter of two constants: radians per
    metre of distance and per radian of turn."""

    def __init__(self) -> None:
        self._per_m = self._per_rad = 0.0
        self._P = (WAY_RAD_M**2, 0.0, TURN_SHARE**2)

    def expected(self, way_m: float, turn_rad: float) -> tuple[float, float]:
        """(gyro minus wheels [rad], its standard deviation) over a distance and a turn of the wheels."""
        a, b, c = self._P
        variance = a * way_m**2 + 2.0 * b * way_m * turn_rad + c * turn_rad**2
        return self._per_m * way_m + self._per_rad * turn_rad, math.sqrt(max(0.0, variance))

    def learn(self, way_m: float, turn_rad: float, difference_rad: float, dt_s: float) -> None:
        """Update the filter with a measured difference between gyro and wheels."""
        a, b, c = self._P
        u, w = a * way_m + b * turn_rad, b * way_m + c * turn_rad
        variance = u * way_m + w * turn_rad + NOISE_RAD2_S * dt_s
        error = difference_rad - self._per_m * way_m - self._per_rad * turn_rad
        per_m, per_rad = self._per_m + u / variance * error, self._per_rad + w / variance * error
        share = min(1.0, LEARNED_SIGMAS / max(1e-9, math.hypot(per_m / WAY_RAD_M, per_rad / TURN_SHARE)))
        self._per_m, self._per_rad = share * per_m, share * per_rad
        self._P = (
            min(WAY_RAD_M**2, a - u * u / variance + CHANGE_PER_M * abs(way_m)),
            b - u * w / variance,
            min(TURN_SHARE**2, c - w * w / variance + CHANGE_PER_RAD * abs(turn_rad)),
        )
