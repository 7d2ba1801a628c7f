"""Kobuki serial protocol: the frames of both directions, and the commands. No I/O; ``feedback`` decodes the reports.

Source: Yujin Robot, Kobuki "Serial Protocol" appendix. A frame is ``AA 55 LEN payload XOR``; the payload is a list of
sub-payloads ``ID LEN data``, little endian. The XOR of everything from LEN to the checksum is 0. 115200 baud, 8N1."""

import enum
import math
import struct
from functools import reduce
from operator import xor
from typing import NamedTuple

from vsx_hw.errors import ProtocolError

BAUD = 115200  # fixed
HEADER = b"\xaa\x55"
LONGEST_PAYLOAD = 128
"""The longest legal payload is 124 bytes; a larger LEN is a false header and would swallow good frames."""
WHEEL_BASE_M = 0.230  # as the maker gives it
SPEED_LIMIT_M_S = 0.7  # of a wheel (Kobuki user guide)
RADIUS_LIMIT_MM = 32767  # 16 bits
ERROR_MELODY = 4  # of the base's seven sounds


def encode_frame(*payloads: bytes) -> bytes:
    """One frame around sub-payloads."""
    body = b"".join(payloads)
    body = bytes((len(body),)) + body
    return HEADER + body + bytes((reduce(xor, body),))


def sub_payloads(payload: bytes) -> list[tuple[int, bytes]] | None:
    """(id, data) of each part, or None unless the parts fill the payload exactly."""
    parts = []
    at = 0
    while at + 2 <= len(payload):
        length = payload[at + 1]
        parts.append((payload[at], payload[at + 2 : at + 2 + length]))
        at += 2 + length
    return parts if at == len(payload) and parts else None


class FrameScanner:
    """Finds frames in a byte stream. After a bad frame it searches again from the second byte of its header, so that a
    good frame inside is not lost."""

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Payloads with a correct checksum completed by these bytes."""
        self._buffer += data
        return list(iter(self._next, None))

    def clear(self) -> None:
        """Drop an incomplete frame."""
        self._buffer.clear()

    def _next(self) -> bytes | None:
        buffer = self._buffer
        while True:
            at = buffer.find(HEADER)
            self._skip(at if at >= 0 else len(buffer) - (buffer[-1:] == HEADER[:1]))
            if len(buffer) < 3:
                return None
            length = buffer[2]
            if 0 < length <= LONGEST_PAYLOAD:
                if len(buffer) < length + 4:
                    return None
                if not reduce(xor, buffer[2 : length + 4]):
                    payload = bytes(buffer[3 : length + 3])
                    del buffer[: length + 4]
                    return payload
            self._skip(1)

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        del self._buffer[:count]


class BaseControl(NamedTuple):
    """A twist on the wire: speed of the outer wheel [mm/s], turning radius [mm], 0 straight, 1 on the spot."""

    speed_mm_s: int
    radius_mm: int


def base_control(v_m_s: float, omega_rad_s: float) -> BaseControl:
    """The pair of integers whose motion is nearest to the twist.

    Arcs wider than the wire's 32.767 m become the straight line or the widest arc, whichever curvature is nearer.
    Raises ProtocolError for values that are not finite or that the wire cannot carry."""
    if not (math.isfinite(v_m_s) and math.isfinite(omega_rad_s)):
        raise ProtocolError(f"base control: v={v_m_s}, omega={omega_rad_s} is not finite; send numbers")
    v, half = 1000.0 * v_m_s, 500.0 * WHEEL_BASE_M
    if abs(v) + half * abs(omega_rad_s) > RADIUS_LIMIT_MM - half:
        raise ProtocolError(f"base control: v={v_m_s} m/s, omega={omega_rad_s} rad/s do not fit 16 bits")
    if abs(omega_rad_s) < 1e-4 or abs(omega_rad_s) * RADIUS_LIMIT_MM < 0.5 * abs(v):
        return BaseControl(round(v), 0)
    radius = v / omega_rad_s
    on_the_spot = BaseControl(round(half * omega_rad_s), 1)
    if abs(v_m_s) < 1e-4 or abs(radius) <= 1.0:
        return on_the_spot
    if abs(radius) >= RADIUS_LIMIT_MM:
        radius = math.copysign(RADIUS_LIMIT_MM, radius)
        omega_rad_s = v / radius
    candidates = [on_the_spot]
    for r in {math.floor(radius), math.ceil(radius)} - {-1, 0, 1}:
        speed = round((radius + math.copysign(half, radius)) * omega_rad_s)
        candidates += [BaseControl(speed + change, r) for change in (-1, 0, 1)]
    return min(candidates, key=lambda c: _mismatch(c, v_m_s, omega_rad_s))


def _mismatch(command: BaseControl, v_m_s: float, omega_rad_s: float) -> float:
    """Distance to the twist; 1 mm/s counts like 0.01 rad/s."""
    v, omega = twist_of(command)
    return max(abs(v - v_m_s) / 0.001, abs(omega - omega_rad_s) / 0.01)


def twist_of(command: BaseControl) -> tuple[float, float]:
    """(v [m/s], omega [rad/s]) that the base drives for a base control command."""
    speed, radius = command.speed_mm_s / 1000.0, command.radius_mm / 1000.0
    if command.radius_mm == 0:
        return speed, 0.0
    if command.radius_mm == 1:
        return 0.0, 2.0 * speed / WHEEL_BASE_M
    omega = speed / (radius + math.copysign(0.5 * WHEEL_BASE_M, radius))
    return omega * radius, omega


class Led(enum.IntEnum):
    """Colour of a lamp."""

    OFF = 0
    RED = 1
    GREEN = 2
    ORANGE = 3


def drive_payload(command: BaseControl) -> bytes:
    """Sub-payload 1."""
    return struct.pack("<BBhh", 1, 4, *command)


def sound_payload(frequency_hz: float, duration_ms: int) -> bytes:
    """Sub-payload 3: one note, of 6 Hz to 360 kHz and at most 255 ms."""
    return struct.pack("<BBHB", 3, 3, round(1.0 / (frequency_hz * 0.00000275)), duration_ms)


def melody_payload(number: int) -> bytes:
    """Sub-payload 4: 0 on, 1 off, 2 recharge, 3 button, 4 error, 5 cleaning starts, 6 cleaning ends."""
    return bytes((4, 1, number))


def outputs_payload(led1: Led = Led.OFF) -> bytes:
    """Sub-payload 12. Lamps, digital outputs and the external supplies share one register, so the supplies' bits 0x00F0
    are always set: clearing them with a lamp command would cut the camera's 12 V."""
    return struct.pack("<BBH", 12, 2, 0x00F0 | led1 << 8)


def request_versions_payload() -> bytes:
    """Sub-payload 9: hardware version, firmware version and UDID, once."""
    return bytes((9, 2, 0x0B, 0))


def get_gains_payload() -> bytes:
    """Sub-payload 14."""
    return bytes((14, 1, 0))


def factory_gains_payload() -> bytes:
    """Sub-payload 13 with the documented defaults P 100, I 0.1, D 2."""
    return struct.pack("<BBBIII", 13, 13, 0, 100_000, 100, 2_000)
