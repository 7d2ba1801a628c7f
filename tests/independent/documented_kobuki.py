"""A Kobuki written from its protocol document alone: bytes in, bytes out, time as an argument.

Source: the "Protocol Specification", "Kobuki Parameters" and firmware change log of kobuki_driver. It shares no code
with the drivers. Everything that the document forbids or leaves undefined is added to `violations`.
"""

import math
import struct
from collections import deque
from dataclasses import dataclass, field

from documented_body import Body

FRAME_S = 0.02  # feedback at 50 Hz from power-on
M_PER_TICK = 0.000085292090497737556558
HALF_BASE_MM = 115.0
COMMAND_LENGTHS = {1: 4, 3: 3, 4: 1, 9: 2, 12: 2, 13: 13, 14: 1}
GYRO_DEG_S = 0.00875
_OLD_VERSIONS = {(1, 0, 0): 123, (1, 1, 0): 10100, (1, 1, 1): 10101, (1, 0, 4): 104}
_MOVING_PER_S, _ALL_PER_S = 65, 100  # one for each feedback frame, some more for a late writer; a stop at any moment


def xor(data: bytes) -> int:
    """Return the exclusive or of all bytes."""
    result = 0
    for byte in data:
        result ^= byte
    return result


def frame(payload: bytes) -> bytes:
    """Return header, length, payload and checksum."""
    body = bytes([len(payload)]) + payload
    return b"\xaa\x55" + body + bytes([xor(body)])


def part(identifier: int, data: bytes) -> bytes:
    """Return one sub-payload."""
    return bytes([identifier, len(data)]) + data


@dataclass
class Kobuki:
    """The robot. `left_ticks`, `stamp_ms`, `angle_offset_cdeg` are what its counters hold at power-on."""

    firmware: tuple[int, int, int] = (1, 2, 0)
    hardware: tuple[int, int, int] = (1, 0, 4)
    udid: tuple[int, int, int] = (736034612, 892621875, 1125147971)
    left_ticks: int = 0
    right_ticks: int = 0
    stamp_ms: int = 0
    angle_offset_cdeg: int = 0
    gyro_drift_deg_s: float = 0.0
    dead_time_s: float = 0.0
    command_time_out_s: float = math.inf  # not documented: a base that keeps its last command is the harder one
    body: Body = field(default_factory=lambda: Body(0.230))
    bumper: int = 0
    wheel_drop: int = 0
    cliff: int = 0
    buttons: int = 0
    charger: int = 0
    battery_dv: int = 157
    overcurrent: int = 0
    dock_ir: tuple[int, int, int] = (0, 0, 0)
    cliff_adc: tuple[int, int, int] = (1673, 1965, 1609)  # right, centre, left
    current_10ma: tuple[int, int] = (0, 0)
    pwm: tuple[int, int] = (0, 0)
    gpio: tuple[int, int, int, int, int] = (0, 4095, 4095, 4095, 4095)
    gains: tuple[int, int, int, int] = (0, 100000, 100, 2000)
    gyro_samples: tuple[tuple[int, int, int], ...] | None = None
    violations: list[str] = field(default_factory=list)
    base_commands: list[tuple[float, int, int]] = field(default_factory=list)  # (time, speed mm/s, radius mm)
    requests: list[tuple[float, int]] = field(default_factory=list)
    sounds: list[tuple[int, ...]] = field(default_factory=list)
    outputs: list[int] = field(default_factory=list)
    baud: int = 115200
    now_s: float = 0.0

    def __post_init__(self) -> None:
        self._buffer = bytearray()
        self._answers = bytearray()
        self._next_frame_s = self.now_s + FRAME_S
        self._frames = self._gyro_id = 0
        self._zero = (self.body.left_m, self.body.right_m, self.body.yaw_rad)
        self._powered_s = self.now_s
        self._pending: deque[tuple[float, int, int]] = deque()
        self._since_s, self._earliest = self.now_s, deque[tuple[float, bool]](maxlen=_ALL_PER_S)

    # -- time ------------------------------------------------------------------------------------------------------

    def advance(self, now_s: float) -> bytes:
        """Let time pass; return what the robot sent meanwhile."""
        sent = b""
        while self._next_frame_s <= now_s:
            self._move(self._next_frame_s)
            sent += self.feedback()
            self._next_frame_s = self._powered_s + (self._frames + 1) * FRAME_S
        self._move(now_s)
        return sent

    def _move(self, until_s: float) -> None:
        while self._pending and self._pending[0][0] <= until_s:
            due_s, speed, radius = self._pending.popleft()
            self._roll(max(due_s, self.now_s))
            self.body.want(*wheel_speeds_m_s(speed, radius))
        if self.base_commands and until_s - self.base_commands[-1][0] > self.command_time_out_s:
            self.body.want(0.0, 0.0)
        self._roll(until_s)

    def _roll(self, until_s: float) -> None:
        if until_s > self.now_s:
            self.body.advance(until_s - self.now_s)
            self.now_s = until_s

    def power_cycle(self, left_ticks: int, right_ticks: int, stamp_ms: int) -> None:
        """Switch off and on: counters start again, the motors stand, outputs and half a command are gone."""
        self.left_ticks, self.right_ticks, self.stamp_ms = left_ticks, right_ticks, stamp_ms
        self.body.want(0.0, 0.0)
        self._pending.clear()
        self.outputs.append(0)
        self.__post_init__()

    # -- robot to host ---------------------------------------------------------------------------------------------

    def feedback(self) -> bytes:
        """Return the regular frame, with what was requested behind it."""
        stamp = (self.stamp_ms + round((self.now_s - self._powered_s) * 1000)) & 0xFFFF
        left = (self.left_ticks + math.floor((self.body.left_m - self._zero[0]) / M_PER_TICK)) & 0xFFFF
        right = (self.right_ticks + math.floor((self.body.right_m - self._zero[1]) / M_PER_TICK)) & 0xFFFF
        bits = (self.bumper, self.wheel_drop, self.cliff)
        power = (self.charger, self.battery_dv, self.overcurrent)
        core = struct.pack("<H3B2H2b4B", stamp, *bits, left, right, *self.pwm, self.buttons, *power)
        payload = part(1, core) + part(3, bytes(self.dock_ir)) + part(4, self._inertial())
        payload += (
            part(5, struct.pack("<3H", *self.cliff_adc)) + part(6, bytes(self.current_10ma)) + part(13, self._gyro())
        )
        payload += part(16, struct.pack("<8H", *self.gpio, 0, 0, 0)) + bytes(self._answers)
        self._answers.clear()
        self._frames += 1
        return frame(payload)

    def _inertial(self) -> bytes:
        drift_deg = self.gyro_drift_deg_s * (self.now_s - self._powered_s)
        turned = round((math.degrees(self.body.yaw_rad - self._zero[2]) + drift_deg) * 100) + self.angle_offset_cdeg
        rate = round((math.degrees(self.body.rate_rad_s) + self.gyro_drift_deg_s) * 100)
        return struct.pack("<hh3x", (turned + 18000) % 36000 - 18000, max(-32768, min(32767, rate)))

    def _gyro(self) -> bytes:
        samples = self.gyro_samples
        if samples is None:  # two samples a frame, now and then three
            z = round((math.degrees(self.body.rate_rad_s) + self.gyro_drift_deg_s) / GYRO_DEG_S)
            samples = ((0, 0, max(-32768, min(32767, z))),) * (3 if self._frames % 8 == 7 else 2)
        first = self._gyro_id
        self._gyro_id = (self._gyro_id + len(samples)) & 0xFF
        return bytes([first, 3 * len(samples)]) + b"".join(struct.pack("<3h", *sample) for sample in samples)

    def _version(self, version: tuple[int, int, int]) -> bytes:
        if self.firmware < (1, 1, 2):  # "new firmware version structure" came with 1.1.2
            return struct.pack("<H", _OLD_VERSIONS[version])
        return bytes([version[2], version[1], version[0], 0])

    # -- host to robot ---------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float, since_s: float | None = None) -> bytes:
        """Take bytes of the host; they came between `since_s` and `now_s`. Return what was sent until `now_s`.

        The robot answers in its next frame only.
        """
        sent = self.advance(now_s)
        self._since_s = now_s if since_s is None else since_s
        self._buffer += data
        while self._take_frame():
            pass
        return sent

    def _take_frame(self) -> bool:
        buffer = self._buffer
        start = buffer.find(b"\xaa\x55")
        stray = start if start >= 0 else len(buffer) - (buffer[-1:] == b"\xaa")
        if stray:
            self.violations.append(f"bytes outside of a frame: {bytes(buffer[:stray]).hex(' ')}")
            del buffer[:stray]
        if len(buffer) < 3 or len(buffer) < buffer[2] + 4:
            return False
        whole = bytes(buffer[: buffer[2] + 4])
        del buffer[: len(whole)]
        if xor(whole[2:]) != 0:
            self.violations.append(f"wrong checksum: {whole.hex(' ')}")
        elif whole[2] < 3:
            self.violations.append(f"payload shorter than 3: {whole.hex(' ')}")
        else:
            self._payload(whole[3:-1])
        return True

    def _payload(self, payload: bytes) -> None:
        at = 0
        while at < len(payload):
            identifier, length = payload[at], payload[at + 1] if at + 1 < len(payload) else -1
            data = payload[at + 2 : at + 2 + length]
            if COMMAND_LENGTHS.get(identifier) != length or len(data) != length:
                self.violations.append(f"command {identifier} of length {length}: {payload.hex(' ')}")
                return
            self._command(identifier, data)
            at += 2 + length

    def _command(self, identifier: int, data: bytes) -> None:
        if identifier == 1:
            self._base_control(*struct.unpack("<hh", data))
        elif identifier in (3, 4):
            values = struct.unpack("<HB", data) if identifier == 3 else (data[0],)
            self._check(values[0] <= 6 if identifier == 4 else min(values) > 0, f"sound {values}")
            self.sounds.append(values)
        elif identifier == 9:
            self._request(struct.unpack("<H", data)[0])
        elif identifier == 12:
            (bits,) = struct.unpack("<H", data)
            self._check(bits <= 0x0FFF, f"output bits {bits:#06x}")
            self.outputs.append(bits)
        else:
            self._check(self.firmware >= (1, 2, 0), f"gain command {identifier} for firmware {self.firmware}")
            if identifier == 13:
                self._check(data[0] <= 1, f"gain type {data[0]}")
                self.gains = struct.unpack("<B3I", data)
            else:
                self._answers += part(21, struct.pack("<B3I", *self.gains))

    def _base_control(self, speed: int, radius: int) -> None:
        self._check(radius != -1, f"radius {radius} is not defined")
        left, right = wheel_speeds_m_s(speed, radius)
        linear, angular = (left + right) / 2, (right - left) / 0.230
        self._check(
            abs(linear) <= 0.702 and abs(angular) <= math.pi + 0.01,
            f"faster than the base: {linear} m/s, {angular} rad/s",
        )
        self._earliest.append((self._since_s, speed != 0))
        lately = [moving for since_s, moving in self._earliest if self.now_s - since_s < 1.0]
        self._check(
            sum(lately) <= _MOVING_PER_S and len(lately) < _ALL_PER_S, f"{len(lately)} base controls in a second"
        )
        self.base_commands.append((self.now_s, speed, radius))
        self._pending.append((self.now_s + self.dead_time_s, speed, radius))
        self._move(self.now_s)

    def _request(self, flags: int) -> None:
        self._check(flags != 0 and flags & ~0x0B == 0, f"request flags {flags:#x}")
        self.requests.append((self.now_s, flags))
        if flags & 1:
            self._answers += part(10, self._version(self.hardware))
        if flags & 2:
            self._answers += part(11, self._version(self.firmware))
        if flags & 8:
            self._answers += part(19, struct.pack("<3I", *self.udid))

    def _check(self, allowed: bool, what: str) -> None:
        if not allowed:
            self.violations.append(what)


def wheel_speeds_m_s(speed_mm_s: int, radius_mm: int) -> tuple[float, float]:
    """Return the speeds (left, right) that a base control means: on an arc, `speed_mm_s` is that of the outer wheel."""
    speed = speed_mm_s / 1000.0
    if radius_mm == 0:
        return speed, speed
    if radius_mm == 1:
        return -speed, speed
    inner = (abs(radius_mm) - HALF_BASE_MM) / (abs(radius_mm) + HALF_BASE_MM)
    return (speed * inner, speed) if radius_mm > 0 else (speed, speed * inner)
