"""What a Create or Create 2 feels and tells, written from the manuals alone; see `documented_oi`."""

import math
import struct
from dataclasses import dataclass

from documented_body import Body
from documented_oi_packets import FORMATS, Generation, members

M_PER_TICK = math.pi * 0.072 / 508.8
WHEEL_BASE_M = {Generation.CREATE_1: 0.258, Generation.CREATE_2: 0.235}
OFF, PASSIVE = 0, 1


@dataclass
class Sensors:
    """Sensor values as plain attributes, named as in the manuals."""

    generation: Generation
    firmware: tuple[int, int, int] = (3, 5, 1)  # of a Create 2: the angle is wrong up to 3.4.0
    header_in_checksum: bool = True  # the manual of Create 1 says no, that of Create 2 yes
    carries_residue: bool = False  # whether the parts of a millimetre and of a degree outlive a reading
    left_ticks: int = 0
    right_ticks: int = 0
    body: Body = None  # type: ignore[assignment]  # by default made in __post_init__
    bumps_and_drops: int = 0
    wall: int = 0
    cliffs: tuple[int, int, int, int] = (0, 0, 0, 0)  # left, front left, front right, right
    virtual_wall: int = 0
    overcurrents: int = 0
    buttons: int = 0
    charging_sources: int = 0  # 1 internal charger, 2 home base
    voltage_mv: int = 16000
    current_ma: int = -200
    temperature_c: int = 20
    charge_mah: int = 2000
    capacity_mah: int = 2700
    cliff_signals: tuple[int, int, int, int] = (1500, 1500, 1500, 1500)
    analog: int = 0
    board_gyro_zero: int = 0  # counts at rest of the ADXRS613 on the TurtleBot's power board; 0: there is no board
    light_bumper: int = 0
    light_signals: tuple[int, int, int, int, int, int] = (0, 0, 0, 0, 0, 0)
    motor_currents_ma: tuple[int, int, int, int] = (0, 0, 0, 0)  # left wheel, right wheel, main, side brush
    stasis: int = 0

    def __post_init__(self) -> None:
        self.body = self.body or Body(WHEEL_BASE_M[self.generation])
        self._read_m = self._read_rad = 0.0  # what distance and angle are counted from
        self._zero = [self.body.left_m, self.body.right_m]
        self._ticks = [0.0, 0.0]

    def told(self) -> dict[int, int]:
        """Return packets 35-42: what the robot says of itself."""
        raise NotImplementedError  # the robot does, which has these sensors

    def push(self, left_m: float, right_m: float) -> None:
        """Let somebody move the robot by hand: the encoders know no direction but that of the command."""
        self.body.roll(left_m, right_m)
        self.count(left_m, right_m)

    def count(self, left_m: float, right_m: float) -> None:
        """Count what the wheels have rolled."""
        for side, (moved_m, wanted) in enumerate(
            ((left_m, self.body.wanted_left_m_s), (right_m, self.body.wanted_right_m_s))
        ):
            self._ticks[side] += abs(moved_m) / M_PER_TICK * (-1 if wanted < 0 else 1)

    def packet(self, identifier: int) -> bytes:
        """Return the data of one packet or group; distance and angle are counted again from this reading."""
        singles = members(self.generation, identifier)
        return b"".join(struct.pack(">" + FORMATS[self.generation][one], self._value(one)) for one in singles)

    def _value(self, identifier: int) -> int:
        if identifier == 19:
            return self._distance_mm()
        if identifier == 20:
            return self._angle_deg()
        first = self.generation is Generation.CREATE_1
        charging = 0
        if self.charging_sources and self.told()[35] in (OFF, PASSIVE):
            charging = 2 if self.charge_mah < self.capacity_mah else 3
        values = self.told() | {7: self.bumps_and_drops, 8: self.wall, 13: self.virtual_wall, 14: self.overcurrents}
        values |= dict(zip(range(9, 13), self.cliffs)) | {17: 255 if first else 0, 18: self.buttons, 21: charging}
        values |= {22: self.voltage_mv, 23: self.current_ma, 24: self.temperature_c, 25: self.charge_mah}
        values |= {26: self.capacity_mah, 33: self._analog() if first else 0, 34: self.charging_sources}
        values |= dict(zip(range(28, 32), self.cliff_signals))
        counts = (self.left_ticks + math.floor(self._ticks[0]), self.right_ticks + math.floor(self._ticks[1]))
        values |= {43: counts[0] & 0xFFFF, 44: counts[1] & 0xFFFF, 45: self.light_bumper, 58: self.stasis}
        values |= dict(zip(range(46, 52), self.light_signals)) | dict(zip(range(54, 58), self.motor_currents_ma))
        return values.get(identifier, 0)

    def _analog(self) -> int:
        """Gyro of the power board: falls with a counter-clockwise rate, -(counts - zero) / zero * 150 * 1.35 deg/s."""
        rate_deg_s = math.degrees(self.body.rate_rad_s)
        counts = round(self.board_gyro_zero * (1.0 - rate_deg_s / (150.0 * 1.35)))
        return max(0, min(1023, counts)) if self.board_gyro_zero else self.analog

    def _distance_mm(self) -> int:
        travelled = (self.body.left_m - self._zero[0] + self.body.right_m - self._zero[1]) / 2.0
        value = math.trunc((travelled - self._read_m) * 1000.0 + 1e-9)
        self._read_m = self._read_m + value / 1000.0 if self.carries_residue else travelled
        return max(-32768, min(32767, value))

    def _angle_deg(self) -> int:
        turned = (self.body.right_m - self._zero[1] - self.body.left_m + self._zero[0]) / self.body.wheel_base_m
        wrong = 0.324056 if self.generation is Generation.CREATE_2 and self.firmware <= (3, 4, 0) else 1.0
        value = math.trunc(math.degrees(turned - self._read_rad) * wrong + 1e-9)
        self._read_rad = self._read_rad + math.radians(value / wrong) if self.carries_residue else turned
        return max(-32768, min(32767, value))
