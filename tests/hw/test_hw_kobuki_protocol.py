"""Kobuki bytes: a captured frame, documented command bytes, and streams that were damaged on the way."""

import math
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_hw.errors import ProtocolError
from vsx_hw.kobuki.feedback import battery_of
from vsx_hw.kobuki.protocol import (
    ERROR_MELODY,
    BaseControl,
    Led,
    base_control,
    drive_payload,
    encode_frame,
    factory_gains_payload,
    get_gains_payload,
    melody_payload,
    outputs_payload,
    request_versions_payload,
    sound_payload,
    sub_payloads,
    twist_of,
)
from vsx_hw.kobuki.stream import StreamParser

CAPTURE = bytes.fromhex(
    "AA554D010FA80B000000FCFFEFF3000000009D0003030000000407" + "9BE70000000000050689" + "06AD074906060200000D0EEE"
    "062A0092FFBCFF230098FFB9FF10100000FF0FFF0FFF0FFF0FF00F0000000062"
)
ALL_FLAGS = bytes.fromhex("AA5511010FFFFF070307FFFF0000FB050116A50353")


def chunks(data: bytes, rng: random.Random) -> list[bytes]:
    cuts = sorted(rng.sample(range(len(data)), rng.randrange(0, 12)))
    return [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)])]


def later(k: int) -> bytes:
    """The captured frame k frames later."""
    parts = dict(sub_payloads(CAPTURE[3:-1]))
    parts[1] = struct.pack("<H", (2984 + 20 * k) % 65536) + parts[1][2:]
    return encode_frame(*(bytes((kind, len(data))) + data for kind, data in parts.items()))


def check_capture(feedback, k: int = 0) -> None:
    core = feedback.core
    assert (core.time_ms, core.left_ticks, core.right_ticks) == (2984 + 20 * k, 65532, 62447)
    assert (core.bumper, core.wheel_drop, core.cliff, core.charger, core.battery_decivolt) == (0, 0, 0, 0, 157)
    assert feedback.inertia == (-6245, 0)
    assert feedback.cliff_adc == (1673, 1965, 1609)
    assert feedback.gyro == (0xEE, ((42, -110, -68), (35, -104, -71)))
    assert feedback.analog == (4095,) * 4


def test_capture_in_single_bytes_and_random_chunks():
    assert len(CAPTURE) == 81
    for seed in range(1000):
        rng = random.Random(seed)
        parser = StreamParser()
        pieces = [bytes((b,)) for b in CAPTURE] if seed == 0 else chunks(CAPTURE, rng)
        frames = [f for piece in pieces for f in parser.feed(piece)]
        assert len(frames) == 1
        check_capture(frames[0])
        assert parser.skipped_bytes == 0


def test_all_flags_frame():
    (feedback,) = StreamParser().feed(ALL_FLAGS)
    assert feedback.core == (65535, 7, 3, 7, 65535, 0, -5, 5, 1, 22, 165, 3)
    assert feedback.inertia is None


def test_tail_of_a_frame_and_a_false_header_do_not_cost_the_next_frame():
    parser = StreamParser()
    assert parser.feed(bytes.fromhex("E1") + CAPTURE[:5]) == []
    (feedback,) = parser.feed(CAPTURE[5:])
    check_capture(feedback)
    parser = StreamParser()
    frames = parser.feed(bytes.fromhex("AA55AA553FAA554D010FC0E8000000") + CAPTURE + later(1))
    assert len(frames) == 2


def test_header_split_over_two_reads_after_junk():
    parser = StreamParser()
    assert parser.feed(b"\x00\xaa") == []
    assert len(parser.feed(CAPTURE[1:])) == 1


def test_unknown_parts_and_three_gyro_samples_are_no_obstacle():
    parts = [bytes((kind, len(data))) + data for kind, data in sub_payloads(CAPTURE[3:-1])]
    parts.insert(2, bytes((0x2A, 3, 1, 2, 3)))
    parts = [bytes((13, 20, 0xEE, 9)) + bytes(18) if p[0] == 13 else p for p in parts]
    (feedback,) = StreamParser().feed(encode_frame(*parts))
    assert feedback.gyro.samples == ((0, 0, 0),) * 3
    assert feedback.inertia == (-6245, 0)
    assert feedback.core.left_ticks == 65532


def test_one_lost_byte_costs_one_frame():
    rng = random.Random(5)
    parser = StreamParser()
    damaged = 0
    frames = 0
    for k in range(2000):
        frame = later(k)
        if rng.random() < 0.1:
            at = rng.randrange(len(frame))
            frame = frame[:at] + frame[at + 1 :]
            damaged += 1
        frames += len(parser.feed(frame))
    assert damaged > 100
    assert 2000 - damaged <= frames <= 2000 - damaged + 2


def test_a_changed_byte_never_yields_another_frame():
    for at in range(len(CAPTURE)):
        for flip in (0x01, 0x80, 0xFF):
            frame = bytearray(CAPTURE)
            frame[at] ^= flip
            assert StreamParser().feed(bytes(frame)) == []


def test_right_checksum_but_impossible_content_is_refused():
    parser = StreamParser()
    parts = dict(sub_payloads(CAPTURE[3:-1]))
    core = bytearray(parts[1])
    core[2] = 0x40
    assert parser.feed(encode_frame(b"\x01\x0f" + bytes(core))) == []
    assert parser.feed(encode_frame(b"\x01\x0e" + bytes(parts[1]))) == []
    assert parser.feed(encode_frame(b"\x04\x07" + parts[4])) == []
    assert parser.refused == 3


@settings(max_examples=60)
@given(st.binary(max_size=400))
def test_any_bytes_are_survived_and_the_next_frames_are_found(junk):
    parser = StreamParser()
    parser.feed(junk)
    frames = parser.feed(CAPTURE + later(1) + later(2))
    assert len(frames) >= 2
    check_capture(frames[-1], 2)


@pytest.mark.parametrize(
    ("payload", "wire"),
    [
        (drive_payload(BaseControl(0, 0)), "AA5506010400000000 03"),
        (drive_payload(BaseControl(100, -100)), "AA5506010464009CFF04"),
        (drive_payload(BaseControl(115, 1)), "AA550601047300010071"),
        (drive_payload(BaseControl(-115, 1)), "AA550601048DFF010070"),
        (request_versions_payload(), "AA550409020B0004"),
        (get_gains_payload(), "AA55030E01000C"),
        (factory_gains_payload(), "AA550F0D0D00A086010064000000D00700009B"),
        (outputs_payload(), "AA55040C02F000FA"),
        (outputs_payload(led1=Led.GREEN), "AA55040C02F002F8"),
        (melody_payload(0), "AA550304010006"),
        (melody_payload(ERROR_MELODY), "AA550304010402"),
        (sound_payload(440.0, 200), "AA550503033A03C8F4"),
    ],
)
def test_command_bytes(payload, wire):
    assert encode_frame(payload) == bytes.fromhex(wire)


@pytest.mark.parametrize(
    ("twist", "command"),
    [
        ((0.1, 0.0), (100, 0)),
        ((-0.1, 0.0), (-100, 0)),
        ((0.0, 1.0), (115, 1)),
        ((0.0, -1.0), (-115, 1)),
        ((0.2, 1.0), (315, 200)),
        ((0.2, -1.0), (315, -200)),
        ((-0.2, 1.0), (-315, -200)),
        ((-0.2, -1.0), (-315, 200)),
        ((0.0005, 1.0), (115, 1)),
        ((0.1, 0.00005), (100, 0)),
        ((0.3, 0.001), (300, 0)),
        ((0.3, 0.006), (301, 32767)),
    ],
)
def test_base_control_table(twist, command):
    assert base_control(*twist) == command


def test_base_control_is_what_was_asked_for():
    rng = random.Random(1)
    for _ in range(10_000):
        v, omega = rng.uniform(-0.6, 0.6), rng.uniform(-1.0, 1.0)
        v_driven, omega_driven = twist_of(base_control(v, omega))
        assert abs(v_driven - v) <= 0.001 + 1e-9
        assert abs(omega_driven - omega) < 0.01


@pytest.mark.parametrize("twist", [(math.nan, 0.0), (0.0, math.inf), (1e9, 0.0), (0.0, 1e9)])
def test_impossible_twists_are_refused(twist):
    with pytest.raises(ProtocolError):
        base_control(*twist)


@pytest.mark.parametrize(
    ("decivolt", "charger", "state", "fraction", "charging"),
    [
        (157, 0, "healthy", 0.7697, False),
        (140, 0, "low", 0.2803, False),
        (132, 0, "critical", 0.05, False),
        (165, 18, "charged", 1.0, False),
        (150, 22, "charging", 0.5682, True),
    ],
)
def test_battery(decivolt, charger, state, fraction, charging):
    got = battery_of(decivolt, charger)
    assert (got.voltage_v, got.state, got.charging) == (decivolt / 10, state, charging)
    assert got.fraction == pytest.approx(fraction, abs=0.01)


def test_twenty_thousand_frames_over_a_bad_line():
    """Byte faults of 1e-3 (lost, changed, doubled): what was not hit arrives, what was hit never does."""
    rng = random.Random(20)
    parts = dict(sub_payloads(CAPTURE[3:-1]))
    parser, sent, received, line, damaged = StreamParser(), set(), [], bytearray(), 0
    for k in range(20_000):
        core = struct.pack("<HBBBHH", 20 * k % 65536, 0, 0, 0, 7 * k % 65536, 9 * k % 65536) + parts[1][9:]
        body = {**parts, 1: core, 4: struct.pack("<hh3x", k % 18000, 0)}
        frame = encode_frame(*(bytes((kind, len(data))) + data for kind, data in body.items()))
        sent.add((core[:9], k % 18000))
        faulty = bytearray()
        for byte in frame:
            fault = rng.random() / 1e-3
            faulty += bytes((byte,)) if fault >= 2 / 3 else bytes((rng.randrange(256),)) if fault < 1 / 3 else b""
            faulty += bytes((byte,)) if 2 / 3 <= fault < 1 else b""
        damaged += faulty != frame
        line += faulty
    for at in range(0, len(line), 64):
        received += parser.feed(bytes(line[at : at + 64]))
    told = [(struct.pack("<HBBBHH", *f.core[:6]), f.inertia.angle_centideg) for f in received]
    assert 1200 < damaged < 1900
    assert 20_000 - len(told) <= damaged + 100
    assert set(told) <= sent
    assert all(f.cliff_adc == (1673, 1965, 1609) and f.core[6:] == received[0].core[6:] for f in received)


def test_drives_and_lamps_never_cut_the_cameras_supply():
    assert all(outputs_payload(led)[2] & 0xF0 == 0xF0 for led in Led)
