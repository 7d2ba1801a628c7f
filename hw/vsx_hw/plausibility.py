"""Checks whether wheels, gyro and commands agree, and which turn to use. Pure; time is an argument.

Three sources describe one motion: the wheels measure distances, the gyro the turn, and the command sets both.

- A wheel whose distance over a second contradicts its command is at fault: the base cannot be steered and must stand.
- If gyro and wheels measure different turns, in one report or over a second, one of them is wrong. The one farther
  from the command is left out. The pose is uncertain until both have agreed over a turn or a distance."""

from __future__ import annotations

import math
from collections import deque
from operator import add
from typing import NamedTuple

from vsx_hw.expected_motion import HELD, LONGEST_PAUSE_NS, CommandTrace, Span, TurnMismatch, wheel_verdict

WINDOW_NS = 1_000_000_000  # over which turns are compared
PERIOD_NS = 20_000_000  # between two reports of a base

FRAME_RAD, FRAME_RAD_S = 0.02, 1.0
"""Largest difference of gyro and wheels in one report. A base that is blocked in a turn of 1.5 rad/s differs by 0.03
rad in 20 ms. The bound for 20 ms, 0.04 rad, also prevents heading jumps of 3 degrees, and refuses a changed bit of 2.56
degrees."""
REFUSED_REPORTS = 5  # This many refused reports of one sensor within a second are no accident

BASE_RAD, SLIP, SIGMAS = 0.03, 0.03, 3.0
"""Largest difference in a second, beyond what is learned: 1.7 degrees (not sampled at the same instant, a wheel on a
sill) and a share of the turn, for occasional slip. It detects a drift of 5 deg/s in a second; a smaller one may be a
difference of the wheels until the base stands."""
ZERO_RAD_S = math.radians(0.3)  # Turn rate that a good gyro may show at standstill; one that drifts by 1 deg/s is told
SLIP_NS = 200_000_000  # over which slip is judged
AGREED_RAD, AGREED_M = 0.5, 1.0
"""Turn over which both must agree again; if the gyro was not left out, this distance is enough. A dead gyro would also
agree on a straight."""


class CheckedMotion(NamedTuple):
    """The verdict on a report. turn_rad: the turn to use. doubt: why the pose is uncertain. fault: why the base must
    stand. Both are words, empty while all sources agree. gyro: whether the gyro is trusted."""

    turn_rad: float
    doubt: str = ""
    fault: str = ""
    gyro: bool = True


class _Sums(NamedTuple):
    """Sums since the start. wheels_rad, gyro_rad: turns. no_gyro, no_wheels: reports in which that one was left out."""

    time_ns: int
    left_m: float = 0.0
    right_m: float = 0.0
    wheels_rad: float = 0.0
    gyro_rad: float = 0.0
    no_gyro: int = 0
    no_wheels: int = 0

    @property
    def refused(self) -> int:
        """Reports in which one of the two was left out."""
        return self.no_gyro + self.no_wheels

    def after(self, step: _Sums) -> _Sums:
        """These sums plus one more step."""
        return _Sums(*map(add, self, step))


class MotionCheck:
    """Call ``command`` with every command sent, ``step`` with every report of motion. Not thread-safe. step_rad: how
    much rounding may change the wheels' turn in a report, beyond its mean; twice that when they report no turn."""

    def __init__(self, wheel_base_m: float, step_rad: float = 0.0) -> None:
        self._wheel_base_m, self._step_rad = wheel_base_m, step_rad
        self._trace = CommandTrace()
        self._mismatch = TurnMismatch()
        self._sums = deque([_Sums(0)])
        self._stood = _Sums(0)  # since when the base stands: neither told to move nor moved
        self._rate_rad_s = 0.0
        self._doubt, self._gyro_out = "", False
        self._unproven, self._wrong_ns = "", 0
        self._agreed_rad = self._agreed_m = 0.0

    def command(self, v_m_s: float, omega_rad_s: float) -> None:
        """Record the command that is valid from now on."""
        half = 0.5 * self._wheel_base_m * omega_rad_s
        self._trace.tell(v_m_s - half, v_m_s + half)

    def listen(self, now_ns: int) -> None:
        """Record a report without motion data."""
        self._trace.advance(now_ns)

    def can_turn(self, rate_rad_s: float) -> bool:
        """Whether the base can turn at this rate at the latest report, given its recent commands."""
        end_ns = self._trace.time_ns
        least, most = self._trace.between(end_ns - PERIOD_NS, end_ns, self._wheel_base_m)[2]
        bound = FRAME_RAD + FRAME_RAD_S * PERIOD_NS * 1e-9
        return least - bound <= rate_rad_s * PERIOD_NS * 1e-9 <= most + bound

    def step(
        self, now_ns: int, left_m: float, right_m: float, gyro_rad: float | None = None, alive: bool | None = None
    ) -> CheckedMotion:
        """Judge the motion since the last report. gyro_rad: turn by the gyro, None without one. alive: True or False
        when the gyro's own data prove that it measures or not; None when they prove neither."""
        self._trace.advance(now_ns)
        last = self._sums[-1]
        pause_ns = now_ns - last.time_ns
        whole = 0 <= pause_ns <= LONGEST_PAUSE_NS
        dt_s = (pause_ns if whole and pause_ns else PERIOD_NS) * 1e-9
        wheels_rad = turn_rad = (right_m - left_m) / self._wheel_base_m
        no_gyro = no_wheels = False
        if gyro_rad is not None:
            turn_rad, no_gyro, no_wheels = self._in_report(wheels_rad, gyro_rad, dt_s)
        refused = no_gyro or no_wheels
        if not whole:
            self._sums = deque([_Sums(now_ns)])
            self._stood = self._sums[-1]
            return self._verdict_of(wheels_rad, turn_rad, refused, "", no_gyro)
        counted = turn_rad if refused else wheels_rad
        step = _Sums(
            pause_ns, left_m, right_m, wheels_rad=counted, gyro_rad=turn_rad, no_gyro=no_gyro, no_wheels=no_wheels
        )
        now = last.after(step)
        self._sums.append(now)
        begin = self._window(now_ns)
        told = self._trace.between(begin.time_ns, now.time_ns, self._wheel_base_m)
        if left_m or right_m or any(map(any, told)):
            self._stood = now
        fault = self._fault(begin, now, *told[:2])
        if gyro_rad is not None:
            self._compare(begin, now, told[2], alive)
        verdict = self._verdict_of(wheels_rad, turn_rad, now.refused > begin.refused, fault, no_gyro)
        if not refused:
            self._rate_rad_s = verdict.turn_rad / dt_s
        return verdict

    def _verdict_of(
        self, wheels_rad: float, turn_rad: float, refused: bool, fault: str, no_gyro: bool
    ) -> CheckedMotion:
        doubt = fault or self._unproven or self._doubt or ("gyro and wheels differ in one report" if refused else "")
        return CheckedMotion(wheels_rad if self._gyro_out else turn_rad, doubt, fault, not (self._gyro_out or no_gyro))

    def _in_report(self, wheels_rad: float, gyro_rad: float, dt_s: float) -> tuple[float, bool, bool]:
        """(turn, whether the gyro was left out, whether the wheels were). The one farther from the last turn rate on
        which both agreed is left out."""
        difference = math.remainder(gyro_rad - wheels_rad, 2.0 * math.pi)
        if abs(difference) <= FRAME_RAD + FRAME_RAD_S * dt_s + self._step_rad:
            return wheels_rad + difference, False, False
        expected = self._rate_rad_s * dt_s
        if abs(gyro_rad - expected) < abs(wheels_rad - expected):
            return gyro_rad, False, True
        return wheels_rad, True, False

    def _window(self, now_ns: int) -> _Sums:
        """The sums a second ago. The difference of gyro and wheels is learned from older steps."""
        sums = self._sums
        while len(sums) > 2 and sums[1].time_ns <= now_ns - WINDOW_NS:
            a, b = sums.popleft(), sums[0]
            if not self._doubt and b.refused == a.refused and b.time_ns > a.time_ns:
                way_m = 0.5 * (b.left_m - a.left_m + b.right_m - a.right_m)
                turn_rad = b.wheels_rad - a.wheels_rad
                difference = b.gyro_rad - a.gyro_rad - turn_rad
                self._mismatch.learn(way_m, turn_rad, difference, (b.time_ns - a.time_ns) * 1e-9)
        return sums[0]

    def _fault(self, begin: _Sums, now: _Sums, left: Span, right: Span) -> str:
        """Which wheel does not follow its command, in words. The pose is uncertain until both follow again."""
        sides = {"left": (now.left_m - begin.left_m, left), "right": (now.right_m - begin.right_m, right)}
        verdicts = {side: wheel_verdict(way_m, told) for side, (way_m, told) in sides.items()}
        wrong = [f"the {side} wheel {verdict}; see to its encoder" for side, verdict in verdicts.items() if verdict]
        if all(verdict == HELD for verdict in verdicts.values()):
            wrong = ["wheels do not follow the command; free the robot"]
        if wrong:
            if not self._unproven or begin.time_ns > self._wrong_ns:  # keep the first message: its numbers change
                self._unproven = wrong[0]
            self._wrong_ns = now.time_ns
            return self._unproven
        if None not in verdicts.values() and begin.time_ns > self._wrong_ns:
            self._unproven = ""
        return ""

    def _compare(self, begin: _Sums, now: _Sums, told: Span, alive: bool | None) -> None:
        """Judge the last second: begin, keep or end a doubt."""
        way_m = 0.5 * (now.left_m - begin.left_m + now.right_m - begin.right_m)
        wheels_rad, gyro_rad = now.wheels_rad - begin.wheels_rad, now.gyro_rad - begin.gyro_rad
        expected, sigma = self._mismatch.expected(way_m, wheels_rad)
        rounded = self._step_rad * (1.0 if wheels_rad else 2.0)
        bound = BASE_RAD + rounded + SIGMAS * sigma + SLIP * max(abs(wheels_rad), abs(gyro_rad))
        if alive is False:
            self._distrust(True, "the gyro stands still to the bit: it is dead; the heading is that of the wheels")
        elif now.no_gyro - begin.no_gyro >= REFUSED_REPORTS:
            self._distrust(True, "the gyro jumps; the heading is that of the wheels")
        elif now.no_wheels - begin.no_wheels >= REFUSED_REPORTS:
            self._distrust(False, "the counters of the wheels jump; the heading is that of the gyro")
        elif self._drifts(now):
            self._distrust(True, "the gyro turns while the base stands; the heading is that of the wheels")
        elif abs(gyro_rad - wheels_rad - expected) > bound:
            slip = alive is True and self._slips(now)
            self._choose(wheels_rad, gyro_rad, slip, told)
        elif self._doubt:
            a, b = self._sums[-2], now
            self._agreed_rad += abs(b.wheels_rad - a.wheels_rad)
            self._agreed_m += 0.5 * abs(b.left_m - a.left_m + b.right_m - a.right_m)
            if self._agreed_rad > AGREED_RAD or (self._agreed_m > AGREED_M and not self._gyro_out):
                self._doubt, self._gyro_out = "", False

    def _drifts(self, now: _Sums) -> bool:
        """Whether the gyro turned since the base stands."""
        stood_s = (now.time_ns - self._stood.time_ns) * 1e-9
        turned_rad = abs(now.gyro_rad - self._stood.gyro_rad)
        return turned_rad > BASE_RAD + 2.0 * self._step_rad + ZERO_RAD_S * stood_s

    def _slips(self, now: _Sums) -> bool:
        """Whether the gyro now measures a turn in the direction of the wheels' turn, but a smaller one."""
        before = next(m for m in reversed(self._sums) if m is self._sums[0] or m.time_ns <= now.time_ns - SLIP_NS)
        wheels_rad, gyro_rad = now.wheels_rad - before.wheels_rad, now.gyro_rad - before.gyro_rad
        return 0.0 <= gyro_rad * math.copysign(1.0, wheels_rad) < abs(wheels_rad)

    def _choose(self, wheels_rad: float, gyro_rad: float, slip: bool, told: Span) -> None:
        """Leave out the one farther from the command. If both are equally far, leave out the same one as before, or the
        gyro. Slipping wheels follow the command, but a live gyro that turns less reveals the slip."""
        gyro_off, wheels_off = (max(told[0] - turn, turn - told[1], 0.0) for turn in (gyro_rad, wheels_rad))
        as_before = self._gyro_out or not self._doubt
        gyro_out = not slip and (gyro_off > wheels_off or (gyro_off == wheels_off and as_before))
        turns = (
            f"gyro and wheels turned {math.degrees(gyro_rad):.0f} and {math.degrees(wheels_rad):.0f} deg in a second"
        )
        self._distrust(gyro_out, f"{turns}; the heading is that of the {'wheels' if gyro_out else 'gyro'}")

    def _distrust(self, gyro_out: bool, doubt: str) -> None:
        self._agreed_rad = self._agreed_m = 0.0
        if not self._doubt or gyro_out != self._gyro_out:
            self._doubt, self._gyro_out = doubt, gyro_out
