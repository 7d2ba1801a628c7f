"""The documented Kobuki against captures and examples of the documents: it must be right before it judges."""

import math
import struct

import pytest
from documented_body import Body
from documented_kobuki import FRAME_S, M_PER_TICK, Kobuki, frame, part, wheel_speeds_m_s, xor

_CAPTURE = bytes.fromhex(
    "AA554D010FA80B000000FCFFEFF3000000009D0003030000000407 9BE70000000000 050689 06AD074906 06020000"
    "0D0EEE062A0092FFBCFF230098FFB9FF 10100000FF0FFF0FFF0FFF0FF00F0000000062".replace(" ", "")
)


def _kobuki_of_the_capture() -> Kobuki:
    kobuki = Kobuki(left_ticks=65532, right_ticks=62447, stamp_ms=2984 - 20, angle_offset_cdeg=-6245)
    kobuki.gyro_samples = ((42, -110, -68), (35, -104, -71))
    kobuki._gyro_id = 0xEE
    return kobuki


def test_kobuki_sends_the_captured_frame_byte_for_byte():
    sent = bytearray(_kobuki_of_the_capture().advance(FRAME_S))
    # The capture carries 4080 in a field that the document calls unused.
    unused = slice(74, 76)
    assert _CAPTURE[unused] == b"\xf0\x0f"
    sent[unused] = b"\xf0\x0f"
    sent[-1] ^= xor(b"\xf0\x0f")
    assert bytes(sent) == _CAPTURE


def test_kobuki_core_with_every_flag_set():
    kobuki = Kobuki(
        left_ticks=65535, right_ticks=0, stamp_ms=65515, bumper=7, wheel_drop=3, cliff=7, buttons=1, charger=22
    )
    kobuki.battery_dv, kobuki.overcurrent, kobuki.pwm = 165, 3, (-5, 5)
    core = kobuki.advance(FRAME_S)[3:20]
    assert b"\xaa\x55\x11" + core + bytes([xor(b"\x11" + core)]) == bytes.fromhex(
        "AA5511010FFFFF070307FFFF0000FB05011 6A50353".replace(" ", "")
    )


@pytest.mark.parametrize(
    ("command", "holds"),
    [
        ("AA 55 06 01 04 00 00 00 00 03", lambda robot: robot.base_commands[-1][1:] == (0, 0)),
        ("AA 55 06 01 04 64 00 9C FF 04", lambda robot: robot.base_commands[-1][1:] == (100, -100)),
        ("AA 55 06 01 04 8D FF 01 00 70", lambda robot: robot.base_commands[-1][1:] == (-115, 1)),
        ("AA 55 04 09 02 0B 00 04", lambda robot: robot.requests == [(0.0, 11)]),
        ("AA 55 03 0E 01 00 0C", lambda robot: True),
        (
            "AA 55 0F 0D 0D 00 A0 86 01 00 64 00 00 00 D0 07 00 00 9B",
            lambda robot: robot.gains == (0, 100000, 100, 2000),
        ),
        ("AA 55 04 0C 02 F0 02 F8", lambda robot: robot.outputs == [0x02F0]),
        ("AA 55 03 04 01 04 02", lambda robot: robot.sounds == [(4,)]),
        ("AA 55 05 03 03 3A 03 C8 F4", lambda robot: robot.sounds == [(826, 200)]),
    ],
)
def test_kobuki_takes_the_documented_commands(command, holds):
    kobuki = Kobuki()
    kobuki.receive(bytes.fromhex(command), 0.0)
    assert holds(kobuki)
    assert kobuki.violations == []


def _base(speed: int, radius: int) -> bytes:
    return frame(part(1, struct.pack("<hh", speed, radius)))


@pytest.mark.parametrize(
    "wrong",
    [
        b"\x00",
        _base(100, 0)[:-1] + b"\xff",
        frame(part(2, b"\x00")),
        frame(part(1, b"\x00\x00")),
        frame(part(1, bytes(4)) + b"\x03"),
        _base(100, -1),
        _base(800, 0),
        _base(400, 1),
        frame(part(9, b"\x04\x00")),
        frame(part(9, b"\x00\x00")),
        frame(part(12, b"\x00\x10")),
        frame(part(4, b"\x07")),
        frame(part(3, b"\x00\x00\x10")),
    ],
)
def test_kobuki_counts_what_the_document_forbids(wrong):
    kobuki = Kobuki()
    kobuki.receive(wrong, 0.0)
    assert len(kobuki.violations) == 1


def test_kobuki_counts_too_many_commands():
    kobuki = Kobuki()
    for step in range(80):
        kobuki.receive(_base(100, 0), step * 0.01)
    assert kobuki.violations


@pytest.mark.parametrize(
    ("speed", "radius", "linear_m_s", "angular_rad_s"),
    [(100, 0, 0.1, 0.0), (115, 1, 0.0, 1.0), (-115, 1, 0.0, -1.0), (315, 200, 0.2, 1.0), (315, -200, 0.2, -1.0)]
    + [(-315, -200, -0.2, 1.0), (-315, 200, -0.2, -1.0)],
)
def test_kobuki_base_control_is_the_speed_of_the_outer_wheel(speed, radius, linear_m_s, angular_rad_s):
    left, right = wheel_speeds_m_s(speed, radius)
    assert (left + right) / 2 == pytest.approx(linear_m_s, abs=1e-9)
    assert (right - left) / 0.230 == pytest.approx(angular_rad_s, abs=1e-9)


def test_kobuki_drives_counts_and_answers():
    kobuki = Kobuki(left_ticks=65500, stamp_ms=65500, angle_offset_cdeg=17990, dead_time_s=0.2)
    kobuki.receive(_base(115, 1) + frame(part(9, b"\x0b\x00")), 0.0)
    sent = kobuki.advance(0.2)
    assert (
        part(10, b"\x04\x00\x01\x00") + part(11, b"\x00\x02\x01\x00") + part(19, struct.pack("<3I", *kobuki.udid))
        in sent
    )
    assert kobuki.body.yaw_rad == 0.0  # dead time
    last = kobuki.advance(1.2)[-81:]
    assert kobuki.body.yaw_rad == pytest.approx(1.0)
    stamp, left, right = struct.unpack("<H3x2H", last[5:14])
    assert stamp == (65500 + 1200) & 0xFFFF
    ticks = math.floor(0.115 / M_PER_TICK)
    assert (65500 - left) & 0xFFFF in (ticks, ticks + 1)
    assert right in (ticks - 1, ticks)
    assert struct.unpack("<hh", last[27:31]) == (17990 + 5730 - 36000, 5730)


@pytest.mark.parametrize(("version", "value"), [((1, 0, 0), 123), ((1, 1, 0), 10100), ((1, 1, 1), 10101)])
def test_old_kobuki_firmware_tells_its_version_in_two_bytes(version, value):
    kobuki = Kobuki(firmware=version)
    kobuki.receive(frame(part(9, b"\x03\x00")), 0.0)
    assert part(10, struct.pack("<H", 104)) + part(11, struct.pack("<H", value)) in kobuki.advance(FRAME_S)
    kobuki.receive(bytes.fromhex("AA 55 03 0E 01 00 0C"), 0.1)
    assert len(kobuki.violations) == 1  # gains came with 1.2.0


def test_body_follows_exact_arcs_and_its_limit_of_acceleration():
    body = Body(0.23)
    body.want(0.1, 0.3)
    body.advance(math.pi / (0.2 / 0.23))
    assert (body.x_m, body.y_m, body.yaw_rad) == pytest.approx((0.0, 0.46, math.pi))
    slow = Body(0.23, acceleration_m_s2=0.5)
    slow.want(0.5, 0.5)
    slow.advance(1.0)
    assert slow.x_m == pytest.approx(0.25, abs=1e-3)
