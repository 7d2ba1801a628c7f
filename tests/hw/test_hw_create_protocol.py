"""Open Interface bytes: captured and documented frames, and streams that were damaged on the way."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_hw.create.protocol import (
    GROUPS,
    Mode,
    StreamParser,
    decode_packets,
    encode_drive_direct,
    encode_lamps,
    encode_packets,
    encode_song,
    encode_stream_frame,
    encode_stream_request,
    mode_of,
    packets_bytes,
)
from vsx_hw.errors import ProtocolError

CAPTURE = bytes.fromhex("13270d001500163da018141907621a081423032700002800002900002a00002b0afd2c09692d003a00ce")
CAPTURED = {
    13: 0, 21: 0, 22: 15776, 24: 20, 25: 1890, 26: 2068, 35: 3, 39: 0, 40: 0, 41: 0, 42: 0, 43: 2813, 44: 2409, 45: 0,
    58: 0,
}  # fmt: skip
WITH_HEADER = bytes((19, 5, 29, 2, 25, 13, 0, 163))
WITHOUT_HEADER = bytes((19, 5, 29, 2, 25, 13, 0, 182))


def test_capture_between_junk_and_the_next_frame():
    parser = StreamParser()
    (values,) = parser.feed(bytes((0, 58, 0, 207)) + CAPTURE + CAPTURE[:38])
    assert values == CAPTURED
    assert parser.feed(CAPTURE[38:]) == [CAPTURED]


def test_capture_in_random_chunks():
    for seed in range(200):
        rng = random.Random(seed)
        cuts = sorted(rng.sample(range(len(CAPTURE)), rng.randrange(12)))
        parser = StreamParser()
        frames = [f for a, b in zip([0, *cuts], [*cuts, None]) for f in parser.feed(CAPTURE[a:b])]
        assert frames == [CAPTURED]


@pytest.mark.parametrize(("mine", "other"), [(WITH_HEADER, WITHOUT_HEADER), (WITHOUT_HEADER, WITH_HEADER)])
def test_both_checksums_are_understood_then_one_is_kept(mine, other):
    assert StreamParser().feed(mine + other) == [{29: 537, 13: 0}] * 2
    parser = StreamParser()
    assert len(parser.feed(mine * 3)) == 3
    assert parser.feed(other) == []
    assert parser.refused >= 1
    assert parser.feed(mine) == [{29: 537, 13: 0}]


def test_a_header_byte_inside_the_data_costs_nothing():
    frame = encode_stream_frame({19: 0x1305, 22: 0x1313, 43: 19})
    parser = StreamParser()
    assert parser.feed(bytes((19, 19)) + frame * 2)[-1] == {19: 0x1305, 22: 0x1313, 43: 19}


def test_a_changed_byte_never_yields_values():
    for at in range(len(CAPTURE)):
        for change in (1, 19, 128, 237, 255):
            parser = StreamParser()
            parser.feed(CAPTURE * 3)
            frame = bytearray(CAPTURE)
            frame[at] = (frame[at] + change) % 256
            assert all(values == CAPTURED for values in parser.feed(bytes(frame) + CAPTURE))


def test_a_false_header_before_a_long_length_holds_back_no_requested_frame():
    parser = StreamParser(list(CAPTURED))
    assert parser.feed(CAPTURE + bytes((19, 255)) + CAPTURE[:-1]) == [CAPTURED]
    assert parser.feed(CAPTURE[-1:] + CAPTURE) == [CAPTURED] * 2
    assert parser.refused == 1


@settings(max_examples=60)
@given(st.binary(max_size=300))
def test_any_bytes_are_survived(junk):
    parser = StreamParser()
    parser.feed(CAPTURE * 3)
    parser.feed(junk)
    frames = parser.feed(CAPTURE * 9)
    assert frames[-1] == CAPTURED
    assert len(frames) >= 2


def test_group_sizes():
    sizes = {0: 26, 1: 10, 2: 6, 3: 10, 4: 14, 5: 12, 6: 52, 100: 80, 101: 28, 106: 12, 107: 9}
    assert {group: packets_bytes([group]) for group in GROUPS} == sizes
    with pytest.raises(ProtocolError, match="no packet 59"):
        packets_bytes([59])


def test_packets_without_framing():
    values = {7: 3, 19: -120, 20: 45, 22: 15000, 24: -5, 35: 2}
    assert decode_packets(encode_packets(values), list(values)) == values


def test_command_bytes():
    assert encode_drive_direct(500, -200) == bytes((145, 255, 56, 1, 244))
    assert encode_stream_request([29, 13], 57600) == bytes((148, 2, 29, 13))


def test_wheel_speeds_are_clipped_on_the_same_curve():
    assert encode_drive_direct(600, -600) == encode_drive_direct(500, -500)
    assert encode_drive_direct(1000, 500) == encode_drive_direct(500, 250)
    with pytest.raises(ProtocolError, match="not finite"):
        encode_drive_direct(math.nan, 0)


def test_a_stream_that_does_not_fit_is_refused():
    with pytest.raises(ProtocolError, match="86 bytes pass in 15 ms at 57600"):
        encode_stream_request([100, 43], 57600)
    assert encode_stream_request([100], 115200) == bytes((148, 1, 100))


def test_undocumented_modes_are_unknown():
    assert [mode_of(v) for v in (0, 3, 4, 32)] == [Mode.OFF, Mode.FULL, Mode.UNKNOWN, Mode.UNKNOWN]


def test_songs_are_sent_whole_or_not_at_all():
    assert encode_song(1, [(69, 0.5), (72, 1.0)]) == bytes((140, 1, 2, 69, 32, 72, 64))
    assert encode_lamps(8, 0, 255) == bytes((139, 8, 0, 255))
    for notes in ([(60, 0.1)] * 17, [(130, 0.5)], [(60, 5.0)], [(60, math.nan)], []):
        with pytest.raises(ProtocolError, match="notes"):
            encode_song(0, notes)
    with pytest.raises(ProtocolError, match="byte"):
        encode_lamps(0, 256, 0)
