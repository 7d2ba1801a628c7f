"""A Kobuki made of bytes: the board that the emulator puts behind a pseudo-terminal."""

import math
import random
import struct

from vsx_hw.battery_emulator import KOBUKI_CELLS, EmulatedBattery
from vsx_hw.dock_emulator import KOBUKI_DOCK, KOBUKI_RECEIVERS, is_seated, light
from vsx_hw.kobuki.feedback import METRES_PER_TICK
from vsx_hw.kobuki.odometry import RAW_STEP_RAD_S
from vsx_hw.kobuki.protocol import BAUD, WHEEL_BASE_M, BaseControl, FrameScanner, encode_frame, sub_payloads, twist_of
from vsx_hw.readings import Hazard
from vsx_hw.serial_emulator import Plant, PlantState

FRAME_NS = 20_000_000  # 50 reports a second
TOP_WHEEL_SPEED_M_S = 0.7  # of the data sheet
RAW_NOISE = 20.0  # Standard deviation in steps: 0.03 deg/s/sqrt(Hz) (ST L3G4200D data sheet) at 35 Hz
EXTERNAL_POWER = 0x00F0  # bits of the four supplies, on at power-on
FACTORY_GAINS = struct.pack("<B3I", 0, 100_000, 100, 2_000)  # P, I and D of the wheels, times 1000
VERSIONS = {1: bytes((10, 4, 4, 0, 1, 0)), 2: bytes((11, 4, 0, 2, 1, 0)), 8: struct.pack("<BB3I", 19, 12, 1, 2, 3)}
"""Answers with the versions of hardware and firmware and the board's id, by the flag that requests them."""


class KobukiBoard:
    """Streams a frame every 20 ms from power-on and obeys base control.

    It keeps its last command until a new one: what the firmware does without commands is not documented, and the driver
    must be safe in the worst case. May be changed while it runs: the battery; charger, the byte of an adapter; engages,
    whether the dock's contacts conduct; gyro_stands (the gyro repeats its last values exactly). ``outputs`` is the
    register of lamps and supplies as the driver last wrote it."""

    baud = BAUD

    def __init__(self, plant: Plant, seed: int = 0) -> None:
        self.battery, self.charger = EmulatedBattery(KOBUKI_CELLS), 0
        self.battery.voltage_v = 16.2
        self.gyro_stands, self.engages = False, True
        self._rolled = (0, 0.0, 0.0)
        self._gyro: tuple[int, int, bytes] | None = None
        self.outputs = EXTERNAL_POWER
        self._plant = plant
        self._rng = random.Random(seed)
        self._gains = FACTORY_GAINS
        self._answers: list[bytes] = []
        self._next_frame_ns = 0
        self._scanner = FrameScanner()
        self._restart_counters()

    def _restart_counters(self) -> None:
        """Counters start at arbitrary values, so that every run meets their roll-over."""
        self._counter_origins = (self._rng.randrange(65536), self._rng.randrange(65536), self._rng.randrange(65536))

    def power_cycle(self) -> None:
        """See Board."""
        self._restart_counters()
        self.outputs = EXTERNAL_POWER
        self._plant.set_wheel_speeds(0.0, 0.0)

    def receive(self, data: bytes, time_ns: int) -> None:
        """See Board."""
        for payload in self._scanner.feed(data):
            for kind, content in sub_payloads(payload) or ():
                self._obey(kind, content)

    def _obey(self, kind: int, content: bytes) -> None:
        if kind == 1 and len(content) == 4:
            v, omega = twist_of(BaseControl(*struct.unpack("<hh", content)))
            left, right = v - 0.5 * WHEEL_BASE_M * omega, v + 0.5 * WHEEL_BASE_M * omega
            excess = max(1.0, abs(left) / TOP_WHEEL_SPEED_M_S, abs(right) / TOP_WHEEL_SPEED_M_S)
            self._plant.set_wheel_speeds(left / excess, right / excess)
        elif kind == 12 and len(content) == 2:
            self.outputs = int.from_bytes(content, "little")
        elif kind == 9 and len(content) == 2:
            self._answers += [part for flag, part in VERSIONS.items() if content[0] & flag]
        elif kind == 13 and len(content) == 13:
            self._gains = content
        elif kind == 14 and len(content) == 1:
            self._answers.append(bytes((21, 13)) + self._gains)

    def emit(self, time_ns: int) -> bytes:
        """See Board."""
        if time_ns < self._next_frame_ns:
            return b""
        late = time_ns - self._next_frame_ns >= FRAME_NS
        self._next_frame_ns = (time_ns if late else self._next_frame_ns) + FRAME_NS
        parts = self._feedback(self._plant.read(), time_ns) + list(dict.fromkeys(self._answers))  # LEN has a limit
        self._answers = []
        return encode_frame(*parts)

    def _feedback(self, state: PlantState, time_ns: int) -> list[bytes]:
        left0, right0, time0 = self._counter_origins
        left = (left0 + math.floor(state.left_m / METRES_PER_TICK)) % 65536
        right = (right0 + math.floor(state.right_m / METRES_PER_TICK)) % 65536
        bumper, cliff = state.hazards & Hazard.BUMPER, (state.hazards & Hazard.CLIFF) >> 3
        wheel_drop, overcurrent = (state.hazards & Hazard.WHEEL_DROP) >> 6, (state.hazards & Hazard.OVERCURRENT) >> 8
        clock = (time0 + time_ns // 1_000_000) % 65536
        angle = (round(math.degrees(state.gyro_rad) * 100) + 18000) % 36000 - 18000
        rate = max(-32768, min(32767, round(math.degrees(state.gyro_rate_rad_s) * 100)))
        if self._gyro is None or not self.gyro_stands:
            self._gyro = angle, rate, self._samples(state.gyro_rate_rad_s)
        charger = self._charger(state, time_ns)
        right_ir, center_ir, left_ir = light(KOBUKI_DOCK, KOBUKI_RECEIVERS, state.dock, self._rng)
        return [
            struct.pack(
                "<BBHBBBHHbbBBBB",
                *(1, 15, clock, bumper, wheel_drop, cliff, left, right, 0, 0, state.buttons, charger),
                *(round(10.0 * self.battery.voltage_v), overcurrent),
            ),
            bytes((3, 3, right_ir, center_ir, left_ir)),
            struct.pack("<BBhh3x", 4, 7, *self._gyro[:2]),
            struct.pack("<BB3H", 5, 6, 1600, 1900, 1600),
            bytes((6, 2, 0, 0)),
            struct.pack("<BBBB", 13, 14, clock // 20 % 256, 6) + self._gyro[2],
            struct.pack("<BB5H6x", 16, 16, 0, 4095, 4095, 4095, 4095),
        ]

    def _charger(self, state: PlantState, time_ns: int) -> int:
        """The charger byte; also lets the battery drain or charge until now."""
        then_ns, left_m, right_m = self._rolled
        self._rolled = (time_ns, state.left_m, state.right_m)
        rolled_m = max(abs(state.left_m - left_m), abs(state.right_m - right_m))
        charges = self.engages and not self.charger and is_seated(KOBUKI_DOCK, state.dock)
        self.battery.advance(
            time_ns, rolled_m / max(1e-9 * (time_ns - then_ns), 1e-3), charges or self.charger in (6, 22)
        )
        return (2 if self.battery.fraction >= 1.0 else 6) if charges else self.charger

    def _samples(self, rate_rad_s: float) -> bytes:
        """Two samples of three axes, each with independent noise, as a working sensor has."""
        raw = rate_rad_s / RAW_STEP_RAD_S
        steps = [round(self._rng.gauss(mean, RAW_NOISE)) for mean in (0.0, 0.0, raw, 0.0, 0.0, raw)]
        return struct.pack("<6h", *(max(-32768, min(32767, step)) for step in steps))
