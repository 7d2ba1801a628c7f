"""The last decision before the wheels: who commands, whether it is allowed, how fast. Pure; time is an argument.

It knows nothing of cameras, maps and plans, so it stays correct when all of those are wrong."""

import math
import threading
from typing import NamedTuple

from vsx_hw.readings import BaseReading, Hazard, Signal

ABSURD_V_M_S = 5.0  # several times the speed of any base here: an error
ABSURD_OMEGA_RAD_S = 20.0  # the same
OVERCURRENT_NS = 500_000_000  # a sill or a start draws as much for a moment
LONGEST_STEP_NS = 100_000_000  # a longer time between decisions counts as this


class Source(NamedTuple):
    """A source of commands; the highest priority that has sent one within its timeout wins."""

    name: str
    priority: int
    timeout_s: float


# Names and priorities of TurtleBot's cmd_vel_mux; the last value is the lifetime of a command [s].
SOURCES = (Source("safety_controller", 10, 0.2), Source("teleop", 7, 0.5), Source("navi", 5, 0.25))


class SpeedLimits(NamedTuple):
    """The wheels never exceed these speeds."""

    v_m_s: float = 0.5
    omega_rad_s: float = 1.5


class Decision(NamedTuple):
    """The command for the wheels, its source, and why it differs from what the source sent, or why the base ignores it
    (empty if neither). until_ns: when the command expires, on the clock of ``decide``."""

    v_m_s: float
    omega_rad_s: float
    source: str
    reason: str
    until_ns: int = 0


class Supervisor:
    """Mux, timeouts, hazards, limits and emergency stop of one base. Thread-safe.

    - A bumper forbids driving forward; turning and reversing stay possible.
    - A cliff leaves only reversing straight.
    - A raised wheel, wheels that do not follow their command, or a motor with overcurrent for half a second forbid
      everything until the cause is gone and the commander has asked for standstill (or was silent). A robot that was
      carried away must not drive off when it is put down.
    - The emergency stop forbids everything until it is cleared; then a new command is needed.
    - ``hold``, a reason that its owner sets and clears, forbids everything while it is set.
    - A command that is not finite or is absurd counts as a command to stand still."""

    def __init__(self, limits: SpeedLimits, sources: tuple[Source, ...] = SOURCES) -> None:
        self._limits = limits
        self._sources = {s.name: s for s in sorted(sources, key=lambda s: -s.priority)}
        self._said: dict[str, Decision] = {}
        self._latched = ""
        self._estop = False
        self._decided_ns = self._overcurrent_ns = 0
        self.lock = threading.RLock()
        self.refused = 0
        self.hold = ""

    @property
    def estopped(self) -> bool:
        """Whether the emergency stop is set."""
        return self._estop

    @property
    def locked(self) -> bool:
        """Whether someone must act: the emergency stop is set, or a wheel was raised, draws too much current or does
        not follow its command."""
        return self._estop or bool(self._latched)

    def command(self, source: str, v_m_s: float, omega_rad_s: float, now_ns: int) -> bool:
        """Take a command of a source. Returns False when it was refused and replaced by standstill. Raises KeyError for
        a source that is not in the mux."""
        speaker = self._sources[source]
        accepted = abs(v_m_s) <= ABSURD_V_M_S and abs(omega_rad_s) <= ABSURD_OMEGA_RAD_S
        with self.lock:
            if not accepted:
                self.refused += 1
                v_m_s = omega_rad_s = 0.0
            until_ns = now_ns + round(speaker.timeout_s * 1e9)
            self._said[source] = Decision(v_m_s, omega_rad_s, source, "", until_ns=until_ns)
        return accepted

    def forget_commands(self) -> None:
        """Drop all commands so far (the base was reconnected or the emergency stop cleared)."""
        with self.lock:
            self._said.clear()

    def emergency_stop(self, stop: bool) -> None:
        """Set the emergency stop, or clear it."""
        with self.lock:
            if self._estop and not stop:
                self.forget_commands()
            self._estop = stop

    def observe(self, fault: str) -> None:
        """Take the base's own reason to stand, in words (``OdometryReading.fault``); empty when it has none."""
        if fault:
            self._latched = fault

    def answer(self, now_ns: int, reading: BaseReading, hold: str) -> tuple[Decision, Signal]:
        """The command for the wheels, given the base's report, and the signal for lamp and sound."""
        with self.lock:
            self.hold = hold or reading.refusal
            decision = self.decide(now_ns, reading.hazards)
            decision = decision._replace(reason=decision.reason or reading.disobeys)
            self.observe(reading.odometry.fault)
            held = Signal.HELD if decision.reason and decision.source else Signal.READY
            return decision, Signal.ALARM if self.locked else held

    def decide(self, now_ns: int, hazards: Hazard) -> Decision:
        """The command for the wheels now."""
        with self.lock:
            said = self._selected(now_ns)
            overcurrent = self._overcurrent(now_ns, hazards)
            if hazards & Hazard.WHEEL_DROP:
                self._latched = "wheel raised; put the robot on the floor"
            elif overcurrent:
                self._latched = overcurrent
            elif said.v_m_s == said.omega_rad_s == 0.0:
                self._latched = ""
            estop = "emergency stop; clear it to drive" if self._estop else ""
            if reason := estop or self.hold or self._latched:
                return Decision(0.0, 0.0, said.source, reason)
            v, omega = _limited(said.v_m_s, said.omega_rad_s, self._limits)
            if hazards & Hazard.CLIFF and (v > 0.0 or omega != 0.0):
                v, omega, reason = min(v, 0.0), 0.0, "cliff; only reversing straight is allowed"
            elif hazards & Hazard.BUMPER and v > 0.0:
                v, reason = 0.0, "bumper; driving forward is not allowed"
            return said._replace(v_m_s=v, omega_rad_s=omega, reason=reason or said.reason)

    def _overcurrent(self, now_ns: int, hazards: Hazard) -> str:
        """Why to stand when a wheel's motor has drawn too much current for long; short periods add up."""
        step_ns = min(now_ns - self._decided_ns, LONGEST_STEP_NS) if self._decided_ns else 0
        self._decided_ns = now_ns
        on = hazards & Hazard.OVERCURRENT
        self._overcurrent_ns = max(0, min(OVERCURRENT_NS, self._overcurrent_ns + (step_ns if on else -step_ns)))
        if not on or self._overcurrent_ns < OVERCURRENT_NS:
            return ""
        sides = {Hazard.OVERCURRENT_LEFT: "left", Hazard.OVERCURRENT_RIGHT: "right"}
        wheels = " and ".join(side for bit, side in sides.items() if on & bit)
        return f"overcurrent of the {wheels} wheel; free it"

    def _selected(self, now_ns: int) -> Decision:
        """The command of the most important source that is not silent."""
        for source in self._sources:
            said = self._said.get(source)
            if said is not None and now_ns <= said.until_ns:
                return said
        return Decision(0.0, 0.0, "", "no commands", until_ns=now_ns)


def _limited(v: float, omega: float, limits: SpeedLimits) -> tuple[float, float]:
    """Both scaled by the same factor, so that the robot stays on its curve."""
    scale = max(1.0, abs(v) / limits.v_m_s, abs(omega) / limits.omega_rad_s)
    return (v / scale, omega / scale) if math.isfinite(scale) else (0.0, 0.0)
