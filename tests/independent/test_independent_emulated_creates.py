"""The documented Creates against captures and examples of the manuals: they must be right before they judge."""

import math
import struct

import pytest
from documented_oi import FULL, OFF, PASSIVE, SAFE, OpenInterface
from documented_oi_packets import GROUPS, Generation, members

CREATE_1, CREATE_2 = Generation.CREATE_1, Generation.CREATE_2


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
    assert (robot.mode, len(robot.ignored), robot.body.left_m_s) == (PASSIVE, 1, 0.0)
    robot.receive(bytes([145, 0, 0, 0, 0]), 5.3)  # a stop is never wrong
    assert (len(robot.ignored), len(robot.violations)) == (1, 2)


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
