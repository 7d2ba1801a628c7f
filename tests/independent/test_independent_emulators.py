"""The documented robots against the captures and examples of the documents: they must be right before they judge."""

import math
import struct

import pytest
from documented_body import Body
from documented_kobuki import FRAME_S, M_PER_TICK, Kobuki, frame, part, wheel_speeds_m_s, xor
from documented_oi import FULL, OFF, PASSIVE, SAFE, OpenInterface
from documented_oi_packets import GROUPS, Generation, members

CREATE_1, CREATE_2 = Generation.CREATE_1, Generation.CREATE_2
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


def _started(generation: Generation, mode_opcode: int = 131, **changes) -> OpenInterface:
    robot = OpenInterface(generation, **changes)
    robot.receive(b"\x80", 0.0)
    robot.receive(bytes([mode_opcode]), 0.03)
    robot.advance(0.06)
    return robot


def test_sizes_of_the_groups():
    for generation in Generation:
        robot = OpenInterface(generation)
        sizes = {group: len(robot.packet(group)) for group in GROUPS[generation]}
        expected = {0: 26, 1: 10, 2: 6, 3: 10, 4: 14, 5: 12, 6: 52}
        assert sizes == expected | ({100: 80, 101: 28, 106: 12, 107: 9} if generation is CREATE_2 else {})
    assert members(CREATE_1, 43) == []


@pytest.mark.parametrize(("generation", "header", "checksum"), [(CREATE_2, True, 163), (CREATE_1, False, 182)])
def test_stream_of_the_manuals_example(generation, header, checksum):
    robot = _started(generation, header_in_checksum=header, cliff_signals=(0, 537, 0, 0))
    robot.receive(bytes([148, 2, 29, 13]), 0.07)
    assert robot.advance(0.08) == bytes([19, 5, 29, 2, 25, 13, 0, checksum])
    robot.receive(bytes([150, 0]), 0.08)
    assert robot.advance(0.2) == b""
    robot.receive(bytes([150, 1]), 0.2)
    assert len(robot.advance(0.2 + 0.0151)) == 8
    assert robot.violations == []


def test_create_2_sends_the_captured_stream():
    robot = _started(
        CREATE_2, 132, left_ticks=2813, right_ticks=2409, voltage_mv=15776, charge_mah=1890, capacity_mah=2068
    )
    robot.receive(bytes([148, 13, 13, 21, 22, 24, 25, 26, 35, 39, 40, 41, 42, 43, 44]), 0.07)
    capture = bytes(
        [19, 39, 13, 0, 21, 0, 22, 61, 160, 24, 20, 25, 7, 98, 26, 8, 20, 35, 3, 39, 0, 0, 40, 0, 0, 41, 0, 0, 42, 0, 0]
    )
    capture += bytes([43, 10, 253, 44, 9, 105, 45, 0, 58, 0, 206])
    robot._stream += [45, 58]
    assert robot.advance(0.08) == capture


@pytest.mark.parametrize(
    ("command", "left_m_s", "right_m_s"),
    [
        ([145, 255, 56, 1, 244], 0.5, -0.2),
        ([137, 0, 200, 128, 0], 0.2, 0.2),
        ([137, 0, 200, 255, 255], 0.2, -0.2),
        ([137, 0, 200, 0, 1], -0.2, 0.2),
        ([137, 255, 56, 1, 244], -0.2 * (500 - 117.5) / 500, -0.2 * (500 + 117.5) / 500),
    ],
)
def test_drive_commands_of_the_manual(command, left_m_s, right_m_s):
    robot = _started(CREATE_2)
    robot.receive(bytes(command), 0.07)
    assert (robot.body.left_m_s, robot.body.right_m_s) == pytest.approx((left_m_s, right_m_s))
    assert robot.violations == []


@pytest.mark.parametrize(
    "wrong",
    [
        [255],
        [137, 2, 88, 128, 0],
        [137, 0, 200, 0, 0],
        [145, 2, 88, 0, 0],
        [142, 99],
        [141, 3],
        [140, 5, 1, 60, 32],
        [140, 0, 0],
        [148, 3, 100, 100, 100],
        [131, 142],
        [129, 11, 142],
        [129, 12],
        [147],
        [142, 7] * 40,
        [173, 142],
    ],
)
def test_create_2_counts_what_the_manual_forbids(wrong):
    robot = _started(CREATE_2)
    robot.receive(bytes(wrong), 0.07)
    assert len(robot.violations) == 1, robot.violations


@pytest.mark.parametrize("wrong", [[133], [173], [146, 0, 0, 0, 0], [142, 43], [147, 8]])
def test_create_1_counts_what_its_manual_forbids(wrong):
    robot = _started(CREATE_1)
    robot.receive(bytes(wrong), 0.07)
    assert robot.violations


def test_bytes_before_start_and_drive_in_passive():
    robot = OpenInterface(CREATE_2, now_s=5.0)
    robot._fell_s = 0.0
    assert robot.receive(bytes([142, 35]), 5.0) == b""
    assert len(robot.violations) == 2
    robot.receive(b"\x80", 5.1)
    robot.receive(bytes([145, 0, 100, 0, 100]), 5.2)
    assert (robot.mode, len(robot.violations), robot.body.left_m_s) == (PASSIVE, 3, 0.0)
    robot.receive(bytes([145, 0, 0, 0, 0]), 5.3)  # a stop is never wrong
    assert len(robot.violations) == 3


@pytest.mark.parametrize(
    ("sensor", "velocity", "mode_after"),
    [
        ({"cliffs": (0, 1, 0, 0)}, 200, PASSIVE),
        ({"cliffs": (0, 1, 0, 0)}, -200, SAFE),
        ({"bumps_and_drops": 0b00100}, 0, PASSIVE),
        ({"bumps_and_drops": 0b01000}, 0, PASSIVE),
        ({"bumps_and_drops": 0b10000}, 0, PASSIVE),
        ({"bumps_and_drops": 0b00011}, 200, SAFE),
        ({"charging_sources": 1}, 0, PASSIVE),
    ],
)
def test_falls_from_safe_to_passive_and_full_does_not(sensor, velocity, mode_after):
    for opcode, expected in ((131, mode_after), (132, FULL)):
        robot = _started(CREATE_1, opcode)
        robot.receive(bytes([147, 1]) + bytes([145]) + struct.pack(">hh", velocity, velocity), 0.07)
        for name, value in sensor.items():
            setattr(robot, name, value)
        robot.advance(0.1)
        assert robot.mode == expected
        assert robot.digital_outputs == (0 if expected == PASSIVE else 1)
        assert robot.body.left_m_s == (0.0 if expected == PASSIVE else velocity / 1000)


def test_encoders_distance_and_angle_with_their_defects():
    robot = _started(CREATE_2, 132, left_ticks=65530, firmware=(3, 4, 0))
    robot.receive(bytes([145]) + struct.pack(">hh", 200, 100), 0.06)
    robot.advance(1.06)
    assert struct.unpack(">HH", robot.packet(43) + robot.packet(44)) == ((65530 + 224) & 0xFFFF, 449)
    turned_deg = math.degrees(0.1 / 0.235)
    assert struct.unpack(">hh", robot.packet(19) + robot.packet(20)) == (150, int(turned_deg * 0.324056))
    assert robot.packet(19) == b"\x00\x00"
    robot.push(-0.1, -0.1)  # by hand, while the command says forward: counted up
    assert struct.unpack(">H", robot.packet(44))[0] == math.floor(0.3 / (math.pi * 0.072 / 508.8))


@pytest.mark.parametrize(("carries", "total_deg"), [(False, 0), (True, 28)])
def test_create_1_loses_a_slow_turn_that_is_asked_too_often(carries, total_deg):
    robot = _started(CREATE_1, 132, carries_residue=carries)
    robot.receive(bytes([145]) + struct.pack(">hh", 64, -64), 0.06)  # 28.6 deg/s
    total = 0
    for step in range(50):
        robot.advance(0.06 + 0.02 * (step + 1))
        total += struct.unpack(">h", robot.packet(20))[0]
    assert total == total_deg


def test_create_sleeps_in_passive_and_reset_prints_a_banner():
    robot = OpenInterface(CREATE_2)
    robot.receive(b"\x80", 0.0)
    robot.advance(301.0)
    assert robot.receive(bytes([142, 7]), 301.0) == b""
    robot.wake()
    assert robot.receive(bytes([142, 35]), 301.5) == b"\x01"
    assert b"release-3.5.1" in robot.receive(b"\x07", 302.0)
    assert robot.mode == OFF


def test_body_follows_exact_arcs_and_its_limit_of_acceleration():
    body = Body(0.23)
    body.want(0.1, 0.3)
    body.advance(math.pi / (0.2 / 0.23))
    assert (body.x_m, body.y_m, body.yaw_rad) == pytest.approx((0.0, 0.46, math.pi))
    slow = Body(0.23, acceleration_m_s2=0.5)
    slow.want(0.5, 0.5)
    slow.advance(1.0)
    assert slow.x_m == pytest.approx(0.25, abs=1e-3)
