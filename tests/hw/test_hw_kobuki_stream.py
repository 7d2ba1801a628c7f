"""Which frames of a Kobuki are believed: whole ones, documented ones, and those that can follow the one before."""

import random
import struct

import pytest
from test_hw_kobuki_protocol import CAPTURE

from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.feedback import (
    FIRMWARE_NUMBERS,
    HARDWARE_NUMBERS,
    KNOWN_FIRMWARE,
    Version,
    decode_version,
    objection,
)
from vsx_hw.kobuki.protocol import encode_frame, sub_payloads
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.readings import Hazard


def frames_of(k: int, **changes: int) -> bytes:
    """A frame of a Kobuki that drives, k frames after the start, with changed fields of its core."""
    core = {
        "time": 20 * k % 65536, "bumper": 0, "drop": 0, "cliff": 0, "left": 47 * k % 65536, "right": 47 * k % 65536,
        "left_pwm": 0, "right_pwm": 0, "buttons": 0, "charger": 0, "battery": 157, "overcurrent": 0,
    }  # fmt: skip
    core |= {name: value for name, value in changes.items() if name in core}
    parts = dict(sub_payloads(CAPTURE[3:-1])) | {1: struct.pack("<HBBBHHbbBBBB", *core.values())}
    parts[4] = struct.pack("<hh3x", changes.get("angle", 0), 0)
    noise = random.Random(k)
    parts[13] = struct.pack("<BB6h", k % 256, 6, *(noise.randrange(-20, 21) for _ in range(6)))
    return encode_frame(*(bytes((kind, len(data))) + data for kind, data in parts.items()))


@pytest.mark.parametrize(
    "change",
    [{"time": 200 + 64}, {"time": 200 - 64}, {"left": 470 + 512}, {"right": 470 - 512 + 65536}, {"left": 470 + 32768}]
    + [{"angle": 512}, {"angle": -16384}, {"buttons": 1}, {"charger": 2}, {"battery": 157 - 16}],
)  # fmt: skip
def test_a_frame_that_cannot_follow_the_one_before_is_refused_once(change):
    parser = StreamParser()
    assert len(parser.feed(b"".join(frames_of(k) for k in range(10)))) == 10
    assert parser.feed(frames_of(10, **change)) == []
    assert len(parser.feed(frames_of(11))) == 1, "what was right before is right again"
    for k in (12, 13, 14):
        lasting = {name: value + 20 * (k - 10) * (name == "time") for name, value in change.items()}
        found = parser.feed(frames_of(k, **lasting))
        assert len(found) == (k > 12), "what is said again is believed"


def test_frames_that_say_something_else_each_time_are_never_believed():
    parser = StreamParser()
    parser.feed(b"".join(frames_of(k) for k in range(10)))
    assert [parser.feed(frames_of(k, left=3000 * k % 65536)) for k in range(10, 20)] == [[]] * 10
    assert parser.doubts
    assert len(parser.feed(frames_of(20) + frames_of(21))) == 2
    assert not parser.doubts


def test_a_part_that_is_missing_for_one_frame_is_damage():
    parser = StreamParser()
    parser.feed(b"".join(frames_of(k) for k in range(10)))
    parts = [bytes((kind, len(data))) + data for kind, data in sub_payloads(frames_of(10)[3:-1])]
    parts[2] = bytes((0x84,)) + parts[2][1:]
    assert parser.feed(encode_frame(*parts)) == []
    assert len(parser.feed(frames_of(11))) == 1


@pytest.mark.parametrize("kind", [3, 4, 5, 6, 10, 11, 15, 16, 19, 21])
def test_a_documented_part_of_another_length_is_refused(kind):
    parts = dict(sub_payloads(CAPTURE[3:-1])) | {kind: bytes(9)}
    parser = StreamParser()
    assert parser.feed(encode_frame(*(bytes((k, len(data))) + data for k, data in parts.items()))) == []
    assert parser.refused == 1


def test_answers_between_the_regular_parts_are_no_damage():
    parser = StreamParser()
    for k in range(8):
        extra = bytes((10, 4, 4, 0, 1, 0, 11, 4, 0, 2, 1, 0)) if k % 2 else b""
        assert len(parser.feed(encode_frame(frames_of(k)[3:-1] + extra))) == 1


def test_the_versions_of_old_firmware():
    numbers = {123: (1, 0, 0), 110: (1, 1, 0), 10100: (1, 1, 0), 111: (1, 1, 1), 10101: (1, 1, 1)}
    told = {number: decode_version(struct.pack("<H", number), FIRMWARE_NUMBERS) for number in range(1 << 16)}
    assert {number: version for number, version in told.items() if isinstance(version, Version)} == numbers
    assert told[120] == struct.pack("<H", 120)
    assert decode_version(struct.pack("<H", 104), HARDWARE_NUMBERS) == (1, 0, 4)
    assert decode_version(bytes((0, 2, 1, 0)), FIRMWARE_NUMBERS) == (1, 2, 0)
    assert decode_version(None, FIRMWARE_NUMBERS) is None
    assert decode_version(bytes(3), FIRMWARE_NUMBERS) == bytes(3)
    for firmware in KNOWN_FIRMWARE:
        assert objection(firmware, Version(1, 0, 4)) == ""
    for unknown in (Version(2, 0, 0), Version(1, 2, 1), Version(0, 0, 1), Version(1, 3, 0), bytes((0, 2, 1, 9)), None):
        assert "flash 1.2.0" in objection(unknown, None)
    assert "not told its hardware version; " in objection(Version(1, 2, 0), None)
    assert "hardware 2.0.0 is unknown" in objection(Version(1, 2, 0), Version(2, 0, 0))


def test_two_bits_of_one_column_are_no_step_and_free_no_contact():
    """The checksum is right in spite of them. The base stands with its bumper pressed."""
    rng, dialect = random.Random(3), KobukiDialect()
    poses, passed = [], 0
    for k in range(20_000):
        data = bytearray(frames_of(k, left=40_000, right=40_000, bumper=4))
        if k % 5 == 4:
            at, bit = rng.sample(range(2, len(data)), 2), 1 << rng.randrange(8)
            for place in at:
                data[place] ^= bit
        for reading in dialect.receive(bytes(data), 1 + k * 20_000_000):
            assert reading.hazards & Hazard.BUMPER_LEFT
            poses.append(reading.odometry[1:4])
            passed += k % 5 == 4
    assert passed < 2000, "of 4000"
    for (x, y, heading), (x_then, y_then, heading_then) in zip(poses[1:], poses):
        assert abs(x - x_then) + abs(y - y_then) < 0.02, "faster than the base"
        assert abs(heading - heading_then) < 0.045, "the least jump that is refused"


@pytest.mark.parametrize("part", [3, 5, 16])
def test_values_that_a_sensor_cannot_have_are_refused(part):
    for at in (1, 3) if part != 3 else (0, 2):
        parts = dict(sub_payloads(CAPTURE[3:-1]))
        offset = at + 2 * (part == 16)
        parts[part] = parts[part][:offset] + bytes((0x50,)) + parts[part][offset + 1 :]
        assert StreamParser().feed(encode_frame(*(bytes((k, len(data))) + data for k, data in parts.items()))) == []
