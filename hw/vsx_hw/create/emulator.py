"""A Create made of bytes: the board that the emulator puts behind a pseudo-terminal."""

import math
import random
import struct

from vsx_hw.battery_emulator import CREATE_CELLS, EmulatedBattery
from vsx_hw.create.odometry import counts_of
from vsx_hw.create.protocol import (
    CREATE_1,
    GROUPS,
    LAYOUT,
    METRES_PER_TICK,
    STREAM_PERIOD_NS,
    Mode,
    Model,
    Opcode,
    encode_dock_character,
    encode_packets,
    encode_stream_frame,
    single_packets,
)
from vsx_hw.dock_emulator import CREATE_1_RECEIVERS, CREATE_2_RECEIVERS, HOME_BASE, is_seated, light
from vsx_hw.readings import DockBeam, Hazard
from vsx_hw.serial_emulator import Plant, PlantState

DEAF_NS = 20_000_000  # after a change of mode (Open Interface)
BANNER = b"bl-start\r\nSTR730\r\nbootloader id: #x47186549\r\nr3_robot/tags/release-3.3.0:5058\r\n"
_ARGUMENTS: dict[int, int] = {
    Opcode.DRIVE: 4, Opcode.DRIVE_DIRECT: 4, Opcode.DIGITAL_OUTPUTS: 1, Opcode.LAMPS: 3, Opcode.PLAY: 1,
    Opcode.PAUSE_STREAM: 1,
}  # fmt: skip


class CreateBoard:
    """Obeys modes as the robot does: deaf for 20 ms after a change; Safe falls to Passive at cliffs and raised wheels;
    and with a charger; in Safe it drives on for ever when the driver falls silent. It charges in Off and Passive.
    ``mode``, ``outputs`` and ``log`` (all bytes received) may be read. May be changed while it runs: the battery, and
    engages, whether the dock's contacts conduct."""

    def __init__(self, model: Model, plant: Plant, seed: int = 0) -> None:
        self.baud = model.baud
        self.mode = Mode.OFF
        self.outputs = 0
        self.log = bytearray()
        self._forward = False
        self._model = model
        self._plant = plant
        self._rng = random.Random(seed)
        self._incoming = bytearray()
        self._reply = bytearray(BANNER)
        self._stream: list[int] = []
        self._next_frame_ns = 0
        self._deaf_until_ns = 0
        self._read_mark = (0.0, 0.0)
        self.battery, self.engages = EmulatedBattery(CREATE_CELLS, 2400 / 2700), True
        self._speed_m_s = 0.0
        self._ticks_at_start = (self._rng.randrange(65536), self._rng.randrange(65536))

    def power_cycle(self) -> None:
        """See Board."""
        self._set_mode(Mode.OFF, 0)
        self._stream = []
        self._reply = bytearray(BANNER)
        self._ticks_at_start = (self._rng.randrange(65536), self._rng.randrange(65536))

    def receive(self, data: bytes, time_ns: int) -> None:
        """See Board."""
        self.log += data
        self._incoming += data
        while self._incoming:
            opcode = self._incoming[0]
            needed = 1 + self._argument_bytes(opcode)
            if len(self._incoming) < needed:
                return
            arguments = bytes(self._incoming[1:needed])
            del self._incoming[:needed]
            if time_ns >= self._deaf_until_ns:
                self._obey(opcode, arguments, time_ns)

    def _argument_bytes(self, opcode: int) -> int:
        if opcode in (Opcode.STREAM, Opcode.QUERY_LIST):
            return 1 + self._incoming[1] if len(self._incoming) > 1 else 1
        if opcode == Opcode.SONG:
            return 2 + 2 * self._incoming[2] if len(self._incoming) > 2 else 2
        return _ARGUMENTS.get(opcode, 0)

    def _obey(self, opcode: int, arguments: bytes, time_ns: int) -> None:
        active = self.mode in (Mode.SAFE, Mode.FULL)
        if opcode == Opcode.START:
            self._set_mode(Mode.PASSIVE, time_ns)
        elif opcode == Opcode.SAFE and self.mode is not Mode.OFF:
            self._set_mode(Mode.SAFE, time_ns)
        elif opcode == Opcode.FULL and self.mode is not Mode.OFF:
            self._set_mode(Mode.FULL, time_ns)
        elif opcode == Opcode.STOP:
            self._set_mode(Mode.OFF, time_ns)
            self._stream = []
        elif opcode == Opcode.DRIVE_DIRECT and active:
            right, left = struct.unpack(">hh", arguments)
            self._forward, self._speed_m_s = left + right > 0, 0.001 * max(abs(left), abs(right))
            self._plant.set_wheel_speeds(left / 1000.0, right / 1000.0)
        elif opcode == Opcode.DIGITAL_OUTPUTS and active:
            self.outputs = arguments[0]
        elif opcode == Opcode.STREAM and self.mode is not Mode.OFF:
            self._stream = [p for p in arguments[1:] if p in LAYOUT]
        elif opcode == Opcode.PAUSE_STREAM and arguments == b"\0":
            self._stream = []
        elif opcode == Opcode.QUERY_LIST and self.mode is not Mode.OFF:
            values = self._values(self._plant.read())
            asked = single_packets(p for p in arguments[1:] if p in LAYOUT or p in GROUPS)
            self._reply += encode_packets({p: values.get(p, 0) for p in asked})
            if 19 in asked:
                self._read_mark = self._travelled(self._plant.read())

    def _set_mode(self, mode: Mode, time_ns: int) -> None:
        if mode is not self.mode:
            self._deaf_until_ns = time_ns + DEAF_NS
        self.mode = mode
        if mode not in (Mode.SAFE, Mode.FULL):
            self.outputs = 0
            self._forward, self._speed_m_s = False, 0.0
            self._plant.set_wheel_speeds(0.0, 0.0)

    def emit(self, time_ns: int) -> bytes:
        """See Board."""
        state = self._plant.read()
        stops = Hazard.WHEEL_DROP | Hazard.CLIFF if self._forward else Hazard.WHEEL_DROP
        powered = self.engages and is_seated(HOME_BASE, state.dock)
        if self.mode is Mode.SAFE and (state.hazards & stops or powered):
            self._set_mode(Mode.PASSIVE, time_ns)
        self.battery.advance(time_ns, self._speed_m_s, powered and self.mode in (Mode.OFF, Mode.PASSIVE))
        out = bytes(self._reply)
        self._reply.clear()
        if self._stream and time_ns >= self._next_frame_ns:
            self._next_frame_ns = max(self._next_frame_ns + STREAM_PERIOD_NS, time_ns)
            values = self._values(state)
            out += encode_stream_frame({p: values.get(p, 0) for p in self._stream})
        return out

    def _values(self, state: PlantState) -> dict[int, int]:
        h = state.hazards
        bumps = bool(h & Hazard.BUMPER_RIGHT) + 2 * bool(h & Hazard.BUMPER_LEFT)
        bumps |= 3 * bool(h & Hazard.BUMPER_CENTER)
        bumps += 4 * bool(h & Hazard.WHEEL_DROP_RIGHT) + 8 * bool(h & Hazard.WHEEL_DROP_LEFT)
        cliffs = {9: Hazard.CLIFF_LEFT, 10: Hazard.CLIFF_CENTER, 11: Hazard.CLIFF_CENTER, 12: Hazard.CLIFF_RIGHT}
        values = {7: bumps, 18: state.buttons, 35: int(self.mode), **self._power(state), **self._infrared(state)}
        values |= {packet: int(bool(h & hazard)) for packet, hazard in cliffs.items()}
        values[14] = 8 * bool(h & Hazard.OVERCURRENT_RIGHT) + 16 * bool(h & Hazard.OVERCURRENT_LEFT)
        if self._model is CREATE_1:
            values[33] = counts_of(state.gyro_rate_rad_s)
            distance, angle = self._travelled(state)
            values[19] = max(-32767, min(32767, math.trunc(1000.0 * (distance - self._read_mark[0]))))
            values[20] = max(-32767, min(32767, math.trunc(math.degrees(angle - self._read_mark[1]))))
        else:
            left0, right0 = self._ticks_at_start
            values[43] = (left0 + math.floor(state.left_m / METRES_PER_TICK)) % 65536
            values[44] = (right0 + math.floor(state.right_m / METRES_PER_TICK)) % 65536
        return values

    def _power(self, state: PlantState) -> dict[int, int]:
        """Packets of battery and charger."""
        battery = self.battery
        charges, full = battery.current_a > 0.0, battery.fraction >= 1.0
        values = {21: (3 if full else 2) if charges else 0, 22: round(1000.0 * battery.voltage_v)}
        values |= {23: round(1000.0 * battery.current_a), 25: battery.charge_mah, 26: battery.capacity_mah}
        return values | {34: 2 if self.engages and is_seated(HOME_BASE, state.dock) else 0}

    def _infrared(self, state: PlantState) -> dict[int, int]:
        """Packets of the infrared receivers."""
        first = self._model is CREATE_1
        receivers = CREATE_1_RECEIVERS if first else CREATE_2_RECEIVERS
        seen = light(HOME_BASE, receivers, state.dock, self._rng)
        told = []
        for beams in seen:
            red, green, field = (bool(beams & bit) for bit in (DockBeam.LEFT, DockBeam.RIGHT, DockBeam.HALO))
            told.append(encode_dock_character(red, green, field, first=first))
        return dict(zip((17,) if first else (53, 17, 52), told))

    def _travelled(self, state: PlantState) -> tuple[float, float]:
        """(distance [m], angle [rad]) since the start. A reading loses what it cuts off, as on the robot."""
        turn = (state.right_m - state.left_m) / self._model.wheel_base_m
        return 0.5 * (state.left_m + state.right_m), turn
