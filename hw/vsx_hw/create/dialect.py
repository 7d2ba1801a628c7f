"""What the Create 1 and the Create 2 share: modes, hazards, battery, how to stop."""

from collections.abc import Iterable, Mapping
from functools import reduce
from operator import or_

from vsx_hw.base_driver import Dialect
from vsx_hw.create import protocol
from vsx_hw.create.protocol import CREATE_1, CREATE_2, Mode, Model, Opcode
from vsx_hw.readings import (
    BaseReading,
    BatteryReading,
    DockBeam,
    DockSignals,
    GyroReading,
    Hazard,
    OdometryReading,
    Signal,
)
from vsx_hw.wheel_commands import TurnErrorFeedback, within_limit

SAFETY_PACKETS = [7, 9, 10, 11, 12, 14, 18, 35]  # bumps and drops, cliffs, overcurrents, buttons, mode (Open Interface)
BATTERY_PACKETS = [21, 22, 23, 25, 26, 34]  # charging state, voltage, current, charge, capacity, chargers
QUESTION = [1, 18, 3, 34, 35]
"""Both of them within groups: a Create at twice the baud rate hears the id 9 or 25 as the command to clean."""

CYCLES_TO_RETRY_MODE = 25  # half a second at 20 ms each
DISOBEYS_NS = 1_000_000_000  # so long it may need for a change of its mode: two tries
CYCLES_TO_STAY_AWAKE = 3000  # a minute: in Passive a robot without commands falls asleep after five

MODE_PAUSE_S = 0.05  # Commands within 20 ms of a change of mode are lost

CHARGING = (1, 2, 3)  # reconditioning, full, trickle
_KNOWN = {21: ("charging state", range(6)), 34: ("chargers", range(4))}
"""Known values of a packet; any other value causes a warning and counts as 0."""
_SLOW = {18: 0, 21: 0, 22: 500, 25: 100, 26: 0, 34: 0}
"""Largest change of packets from one report to the next, mV and mAh; a change that people make counts when repeated."""

_HAZARDS = (
    (7, 1, Hazard.BUMPER_RIGHT), (7, 2, Hazard.BUMPER_LEFT),
    (7, 4, Hazard.WHEEL_DROP_RIGHT), (7, 8, Hazard.WHEEL_DROP_LEFT), (7, 16, Hazard.WHEEL_DROP),
    (9, 1, Hazard.CLIFF_LEFT), (10, 1, Hazard.CLIFF_CENTER), (11, 1, Hazard.CLIFF_CENTER), (12, 1, Hazard.CLIFF_RIGHT),
    (14, 8, Hazard.OVERCURRENT_RIGHT), (14, 16, Hazard.OVERCURRENT_LEFT),
)  # fmt: skip
"""Packet, bit, and what it means."""

_COLORS = {Signal.READY: 0, Signal.HELD: 128, Signal.ALARM: 255}  # of the power lamp: green 0 to red 255
ALARM_SONG, ALARM_NOTES = 0, [(79, 0.125), (67, 0.25)]
"""Its number; MIDI notes and seconds, whose bytes drive no Create that listens at half the baud rate."""


class CreateDialect(Dialect):
    """Both robots are driven in Safe mode: at a cliff or a raised wheel they stop by themselves and fall to Passive.
    A command to move puts them back to Safe when the cause is gone, or to reverse from a cliff. From an unknown mode
    they are put back at once, unless they charge. On the dock they stand in Passive, as they charge in no other mode,
    and obey only reversing straight: in Full, because a robot with a charger falls from Safe to Passive."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._forget()

    def _forget(self) -> None:
        """Forget what the robot reported in another connection."""
        self._mode = Mode.OFF
        self._hazards = Hazard.NONE
        self._charges = self._docked = self._doubted = self.driving = self.deaf = False
        self._last: Mapping[int, int] = {}
        self._cycles_in_wrong_mode = 0
        self._wanted, self._obeyed, self._obeyed_ns = (0.0, 0.0), False, 0
        self._rounding = TurnErrorFeedback()

    @property
    def obeys(self) -> bool:
        """Whether drive commands are sent. In Passive the robot would ignore them, in an unknown mode it might obey."""
        return self._mode in (Mode.SAFE, Mode.FULL)

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """See Dialect. Changes the mode first, if it is not the one to drive, or to charge, in."""
        self._wanted = v_m_s, omega_rad_s
        if self._must_stay():
            v_m_s = omega_rad_s = 0.0
        limit_m_s = 0.001 * protocol.SPEED_LIMIT_MM_S
        v_m_s, omega_rad_s = within_limit(v_m_s, omega_rad_s, self._model.wheel_base_m, limit_m_s)
        self.odometry.command(*((v_m_s, omega_rad_s) if self.obeys else (0.0, 0.0)))
        wanted = v_m_s != 0.0 or omega_rad_s != 0.0
        self.deaf = False
        self.driving = wanted and self.obeys
        still = self.halt() if self._mode in (Mode.UNKNOWN, Mode.FULL) else b""
        if change := self._change_of_mode(wanted, v_m_s):
            self.deaf = True
            return still + change
        return self._rounding.command(v_m_s, omega_rad_s, self._encoded) if self.obeys else still

    def _must_stay(self) -> bool:
        """Whether it is on its dock, and wanted to move otherwise than straight back."""
        v_m_s, omega_rad_s = self._wanted
        return self._docked and (v_m_s >= 0.0 or omega_rad_s != 0.0)

    def _change_of_mode(self, wanted: bool, v_m_s: float) -> bytes:
        """The command that changes to the mode for this motion; empty if the mode is right, or not now. An ignored one
        is repeated. A robot that stays in Passive is kept awake."""
        charges = self._docked and not wanted
        needed = Mode.PASSIVE if charges else Mode.FULL if self._docked else Mode.SAFE
        if self._mode is needed and not charges:
            self._cycles_in_wrong_mode = 0
            return b""
        self._cycles_in_wrong_mode += 1
        cause = self._hazards & (Hazard.WHEEL_DROP if v_m_s < 0.0 else Hazard.WHEEL_DROP | Hazard.CLIFF)
        asks = wanted or self._mode is Mode.FULL or (self._mode is Mode.UNKNOWN and not self._charges)
        asks = charges or (asks and not cause)
        if self._mode is Mode.PASSIVE and not asks:
            needed = Mode.PASSIVE
        period = CYCLES_TO_STAY_AWAKE if self._mode is needed else CYCLES_TO_RETRY_MODE
        if not (asks or self._mode is needed) or self._cycles_in_wrong_mode % period != 1:
            return b""
        return bytes(({Mode.PASSIVE: Opcode.START, Mode.FULL: Opcode.FULL, Mode.SAFE: Opcode.SAFE}[needed],))

    def _encoded(self, v_m_s: float, omega_rad_s: float) -> tuple[bytes, float]:
        base, v = 1000.0 * self._model.wheel_base_m, 1000.0 * v_m_s
        left, right = protocol.wheel_speeds(v - 0.5 * base * omega_rad_s, v + 0.5 * base * omega_rad_s)
        return protocol.encode_drive_direct(left, right), (right - left) / base

    def show(self, signal: Signal) -> bytes:
        """See Dialect. The power lamp, and in an alarm the song of ``hello``: only in Safe and Full."""
        if not self.obeys or self.deaf:
            return b""
        sound = bytes((Opcode.PLAY, ALARM_SONG)) if signal is Signal.ALARM else b""
        return protocol.encode_lamps(0, _COLORS[signal], 255) + sound

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """See Dialect. To Passive, to Safe, with the pauses that the robots need; stores the song of an alarm."""
        self._forget()
        self.deaf = True
        yield bytes((Opcode.START,)), MODE_PAUSE_S
        yield bytes((Opcode.SAFE,)), MODE_PAUSE_S
        self.deaf = False
        yield protocol.encode_song(ALARM_SONG, ALARM_NOTES), 0.0

    def halt(self) -> bytes:
        """See Dialect. Empty right after a change of mode: the robot would not hear it, and stands until then."""
        return b"" if self.deaf else protocol.encode_drive_direct(0.0, 0.0)

    def farewell(self) -> bytes:
        """Wheels still, then Passive: in Safe a robot does not charge and drains its battery. Stop switches a Create 2
        off, if it hears so soon after Start; Passive, where it falls asleep, is safe too."""
        end = bytes((Opcode.STOP,)) if self._model is CREATE_2 else b""
        return protocol.encode_drive_direct(0.0, 0.0) + bytes((Opcode.START,)) + end

    def base_reading(
        self, values: Mapping[int, int], odometry: OdometryReading, gyro: GyroReading | None = None
    ) -> BaseReading:
        """The reading of SAFETY_PACKETS, BATTERY_PACKETS and the infrared packets of the model."""
        self._mode, self._charges = protocol.mode_of(values[35]), values[21] in CHARGING
        battery = battery_of(values)
        self._docked = battery.docked
        hazards = hazards_of(values)  # a contact ends with the second report without it: one may be damaged
        held, self._hazards = hazards | self._hazards, hazards
        mode, refusal = self._mode.name.lower(), ""
        if self._mode is Mode.UNKNOWN:
            mode = f"unknown {values[35]}"
            refusal = (
                f"mode {values[35]} is none that is known to obey; Safe is asked for, if it does not come switch the "
                "robot off and on"
            )
        return BaseReading(
            odometry.stamp_ns, odometry, held, battery, buttons=values[18], mode=mode, gyro=gyro, refusal=refusal,
            disobeys=self._disobeys(bool(values[34] & 1), odometry.stamp_ns), warnings=warnings_of(values),
            dock=dock_of(values, self._model),
        )  # fmt: skip

    def _disobeys(self, plugged_in: bool, now_ns: int) -> str:
        """Why motion has been wanted in vain for DISOBEYS_NS; empty if it has not, or a sensor of the robot tells why.
        One report in Safe is no obedience: with a charger the robot falls from there at once. plugged_in: the plug of a
        charger, in the robot."""
        stopped = self._hazards & (Hazard.WHEEL_DROP | Hazard.CLIFF)
        before, self._obeyed = self._obeyed, self.obeys and not self._must_stay()
        if (before and self._obeyed) or stopped or not any(self._wanted) or now_ns < self._obeyed_ns:
            self._obeyed_ns = now_ns
        if now_ns - self._obeyed_ns < DISOBEYS_NS:
            return ""
        if plugged_in:
            return "charger plugged in; unplug it"
        if self._must_stay():
            return "on its dock; undock first"
        return f"stays in {self._mode.name.lower()} mode; switch it off and on"

    def believes(self, values: Mapping[int, int], follows: bool = True) -> bool:
        """Whether these values can follow those of the last report. If not, they are refused once: the next plausible
        report is accepted. follows: result of other checks."""
        if not is_plausible(values):
            return False
        steady = all(abs(values[p] - self._last.get(p, values[p])) <= most for p, most in _SLOW.items())
        self._doubted = not (self._doubted or (follows and steady))
        if not self._doubted:
            self._last = values
        return not self._doubted

    def silence(self) -> str:
        """See Dialect."""
        return (
            f"switch the robot on and check ~robot_type: {CREATE_1.name} speaks at {CREATE_1.baud} baud, "
            f"{CREATE_2.name} and kobuki at {CREATE_2.baud}; this driver listens at {self._model.baud}; "
            "'auto' finds out"
        )


def is_plausible(values: Mapping[int, int]) -> bool:
    """Whether a robot can have sent SAFETY_PACKETS and BATTERY_PACKETS like these. An answer to a query has neither
    frame nor checksum, so this is the only check against shifted bytes."""
    flags = max(values[7], values[14]) <= 31 and max(values[p] for p in (9, 10, 11, 12)) <= 1
    return flags and 5_000 <= values[22] <= 25_000 and values[26] <= 10_000


def warnings_of(values: Mapping[int, int]) -> tuple[str, ...]:
    """Reported values that the Open Interface does not define."""
    return tuple(
        f"{name} {values[packet]} (packet {packet}) is unknown, taken for 0; look at the charger"
        for packet, (name, known) in _KNOWN.items()
        if values[packet] not in known
    )


def hazards_of(values: Mapping[int, int]) -> Hazard:
    """All hazards in these packets; a caster drop counts as both wheels."""
    return reduce(or_, (hazard for packet, bit, hazard in _HAZARDS if values[packet] & bit), Hazard.NONE)


def dock_of(values: Mapping[int, int], model: Model) -> DockSignals:
    """The beams in packets 53 (right), 17 (all directions) and 52 (left); the Create 1 has only packet 17."""

    def beams(packet: int) -> DockBeam:
        red, green, field = protocol.dock_character(values.get(packet, 0))
        left, right, halo = DockBeam.LEFT * red, DockBeam.RIGHT * green, DockBeam.HALO * field
        return DockBeam(left | right | halo)

    return DockSignals(model.name, beams(53), beams(17), beams(52))


def battery_of(values: Mapping[int, int]) -> BatteryReading:
    """Packets 21 (charging state), 22 (mV), 23 (mA), 25 and 26 (charge and capacity), 34 (chargers: 2 is the dock)."""
    fraction = min(1.0, values[25] / values[26]) if values[26] else 0.0
    charging = values[21] in CHARGING
    state = "charging" if charging else "critical" if fraction < 0.1 else "low" if fraction < 0.2 else "healthy"
    volt, ampere = values[22] / 1000.0, values[23] / 1000.0
    return BatteryReading(volt, fraction, charging, state, docked=values[34] in (2, 3), current_a=ampere)
