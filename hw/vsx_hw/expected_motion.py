"""What to expect of wheels and gyro: the ways that were told lately, and by how much a gyro and the wheels differ
although both are sound. Pure; time is an argument."""

import math
from collections import deque

Span = tuple[float, float]

LAGS_NS = tuple(range(0, 600_000_000, 100_000_000))
"""How late a command may show in a report: a Kobuki's dead time is 0.2 s, its speed control needs as long again, and
the reports may be delayed too."""
LONGEST_PAUSE_NS = 2_000_000_000
"""Between reports; after a longer one nothing is known of what was before. A Create 1 tells its motion twice a second,
less often on a busy machine."""
MEMORY_NS = 4_500_000_000  # Window, longest lag and longest pause

FOLLOWS, RUNS_AWAY = 0.1, 1.5
"""Shares of the commanded way. A sound wheel, whose speed is controlled, makes 0.7 to 1.1 of it; one that is blocked or
whose encoder stands 0, one that counts each edge twice 2, one whose phases are swapped -1."""
WAY_M, SLACK_M = 0.02, 0.015
"""Slower wheels are not judged: friction may hold them. Slack: two reports of a Create 1 are rounded by 7 mm; as much
again for the roll after a command was lowered."""
BEGUN = 0.5  # The least way told, by the longest lag, has this share of the most: the start-up is over

WAY_RAD_M, TURN_SHARE = 0.25, 0.1
"""Deviations before anything is learned: wheels that differ by 6 % bend a way of a metre by 0.25 rad; wheels, wheel
base and gyro make a turn of another size."""
NOISE_RAD2_S, CHANGE_PER_M, CHANGE_PER_RAD = 2e-4, 8e-4, 2e-4
"""How fast: a second of driving halves the deviations, after another floor they follow within a few metres."""

HELD = "does not follow the command"


class CommandTrace:
    """``tell`` a command, ``advance`` with each report; then ask what could have been rolled."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float, float]] = deque([(0, 0.0, 0.0)])
        self._speeds = (0.0, 0.0)

    @property
    def time_ns(self) -> int:
        """The latest instant."""
        return self._points[-1][0]

    def tell(self, left_m_s: float, right_m_s: float) -> None:
        """The speeds from the latest ``advance`` on."""
        self._speeds = left_m_s, right_m_s

    def advance(self, now_ns: int) -> None:
        """Time has passed at the speeds told; after a pause, or a clock that was set, as if the wheels had stood."""
        then_ns, left_m, right_m = self._points[-1]
        if not 0 <= now_ns - then_ns <= LONGEST_PAUSE_NS:
            self._points = deque([(now_ns, 0.0, 0.0)])
            return
        dt_s = (now_ns - then_ns) * 1e-9
        self._points.append((now_ns, left_m + self._speeds[0] * dt_s, right_m + self._speeds[1] * dt_s))
        while self._points[0][0] < now_ns - MEMORY_NS:
            self._points.popleft()

    def between(self, begin_ns: int, end_ns: int, wheel_base_m: float) -> tuple[Span, Span, Span]:
        """(way of the left wheel, of the right one [m], turn [rad]) told for this time, from the least to the most that
        the lags make of it."""
        spans = []
        for lag_ns in LAGS_NS:
            left, right = (b - a for a, b in zip(self._at(begin_ns - lag_ns), self._at(end_ns - lag_ns)))
            spans.append((left, right, (right - left) / wheel_base_m))
        lefts, rights, turns = zip(*spans)
        return (min(lefts), max(lefts)), (min(rights), max(rights)), (min(turns), max(turns))

    def _at(self, time_ns: int) -> tuple[float, float]:
        """Ways of both wheels by then; before the memory they stood."""
        later = self._points[-1]
        for point in reversed(self._points):
            if point[0] <= time_ns:
                share = (time_ns - point[0]) / (later[0] - point[0]) if later[0] > point[0] else 0.0
                return point[1] + share * (later[1] - point[1]), point[2] + share * (later[2] - point[2])
            later = point
        return later[1], later[2]


def wheel_verdict(way_m: float, told: Span) -> str | None:
    """What is wrong with the way of a wheel over a second, in words, empty if nothing; None where it cannot be judged:
    too slow, or not yet, or no longer."""
    least, most = sorted(told, key=abs)
    if abs(most) < WAY_M:
        return None
    if abs(way_m) > RUNS_AWAY * abs(most) + SLACK_M:
        return f"counts {abs(way_m):.2f} m for {abs(most):.2f} m told"
    if told[0] * told[1] <= 0.0 or abs(least) < max(WAY_M, BEGUN * abs(most)):
        return None
    return HELD if way_m * math.copysign(1.0, least) < FOLLOWS * abs(least) else ""


class TurnMismatch:
    """By how much a gyro and the wheels differ, learned while they agree: a Kalman filter of two constants, radians per
    metre of way and per radian of turn."""

    def __init__(self) -> None:
        self._per_m = self._per_rad = 0.0
        self._P = (WAY_RAD_M**2, 0.0, TURN_SHARE**2)

    def expected(self, way_m: float, turn_rad: float) -> tuple[float, float]:
        """(gyro minus wheels [rad], its deviation) over a way and a turn of the wheels."""
        a, b, c = self._P
        variance = a * way_m**2 + 2.0 * b * way_m * turn_rad + c * turn_rad**2
        return self._per_m * way_m + self._per_rad * turn_rad, math.sqrt(max(0.0, variance))

    def learn(self, way_m: float, turn_rad: float, difference_rad: float, dt_s: float) -> None:
        """Take in what gyro and wheels differed by."""
        a, b, c = self._P
        u, w = a * way_m + b * turn_rad, b * way_m + c * turn_rad
        variance = u * way_m + w * turn_rad + NOISE_RAD2_S * dt_s
        error = difference_rad - self._per_m * way_m - self._per_rad * turn_rad
        self._per_m += u / variance * error
        self._per_rad += w / variance * error
        self._P = (
            min(WAY_RAD_M**2, a - u * u / variance + CHANGE_PER_M * abs(way_m)),
            b - u * w / variance,
            min(TURN_SHARE**2, c - w * w / variance + CHANGE_PER_RAD * abs(turn_rad)),
        )
