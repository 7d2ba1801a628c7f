"""Images from isochronous packets: complete ones byte for byte, torn ones never."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vsx_hw.kinect.protocol import FrameAssembler, packetize

PER_TRANSFER = 32


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (480, 640), np.uint8)


def stream(count: int, first_sequence: int = 0) -> list[bytes]:
    """All packets of ``count`` frames, one after the other."""
    frames = (packetize(image(k), 1000 + 2_000_000 * k, first_sequence + 162 * k) for k in range(count))
    return [packet for packets in frames for packet in packets]


def changed(packet: bytes, column: int, value: int) -> bytes:
    return packet[:column] + bytes((value,)) + packet[column + 1 :]


def run(packets: list[bytes], per_transfer: int = PER_TRANSFER) -> tuple[list, dict]:
    assembler = FrameAssembler()
    frames = []
    for k in range(0, len(packets), per_transfer):
        frames += assembler.feed(7_000 + k, packets[k : k + per_transfer])
    return frames, assembler.counters


def test_a_vga_frame_is_162_packets_of_which_the_last_carries_12_bytes():
    packets = packetize(image(0), 5, 250)
    assert [len(packet) for packet in packets] == [1920] * 161 + [24]
    assert [packet[3] for packet in packets] == [0x81] + [0x82] * 160 + [0x85]
    assert [packet[5] for packet in packets[5:8]] == [255, 0, 1]


@pytest.mark.parametrize("per_transfer", [1, 7, 32, 128, 500])
def test_frames_come_through_byte_for_byte_between_idle_slots(per_transfer):
    packets = stream(4)
    spread = [b""] * (len(packets) + 400)
    for slot, packet in zip(np.sort(np.random.default_rng(1).permutation(len(spread))[: len(packets)]), packets):
        spread[slot] = packet
    frames, counters = run(spread, per_transfer)
    assert [f.clock_ticks for f in frames] == [1000 + 2_000_000 * k for k in range(4)]
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.image, image(k))
    assert counters == {"frames": 4, "torn_frames": 0, "bad_packets": 0}


@pytest.mark.parametrize("first_sequence", [0, 100, 255])
def test_sequence_roll_over_is_no_loss(first_sequence):
    frames, counters = run(stream(3, first_sequence))
    assert len(frames) == 3
    assert counters["torn_frames"] == 0


def test_arrival_is_that_of_the_first_packet():
    frames, _ = run(stream(2))
    assert frames[0].first_arrival_ns == 7_000
    assert frames[1].first_arrival_ns == 7_000 + 160


@pytest.mark.parametrize("lost", [0, 1, 80, 161, 162, 300])
def test_one_lost_packet_costs_its_frame_and_no_other(lost):
    packets = stream(4)
    del packets[lost]
    frames, counters = run(packets)
    survivors = [k for k in range(4) if k != lost // 162]
    assert [f.clock_ticks for f in frames] == [1000 + 2_000_000 * k for k in survivors]
    for k, frame in zip(survivors, frames):
        np.testing.assert_array_equal(frame.image, image(k))
    assert counters["frames"] == 3
    assert counters["torn_frames"] == (0 if lost == 0 else 1)


@pytest.mark.parametrize(
    ("column", "value"), [(0, 0x53), (1, 0x43), (3, 0x99)], ids=["magic", "magic 2", "unknown flag"]
)
def test_foreign_packets_are_ignored_and_counted(column, value):
    packets = stream(2)
    packets.insert(60, changed(packets[50], column, value))
    frames, counters = run(packets)
    assert len(frames) == 2
    np.testing.assert_array_equal(frames[0].image, image(0))
    assert counters["bad_packets"] == 1


@pytest.mark.parametrize("length", [8, 12, 1921])
def test_impossible_lengths_are_ignored_and_counted(length):
    packets = stream(2)
    packets[20] = packets[20].ljust(length)[:length]
    frames, counters = run(packets)
    assert [f.clock_ticks for f in frames] == [2_001_000]
    assert (counters["bad_packets"], counters["torn_frames"]) == (1, 1)


def test_a_frame_of_wrong_size_is_torn():
    packets = stream(2)
    packets[30] = packets[30][:1000]
    frames, counters = run(packets)
    assert len(frames) == 1
    assert counters["torn_frames"] == 1


def test_beginning_in_the_middle_of_a_frame():
    frames, counters = run(stream(2)[77:])
    assert len(frames) == 1
    assert counters["torn_frames"] == 0


@settings(max_examples=40)
@given(st.sets(st.integers(0, 3 * 162 - 1), max_size=8), st.integers(1, 200), st.randoms(use_true_random=False))
def test_whatever_is_lost_what_comes_out_is_whole(lost, per_transfer, rng):
    packets = [packet for k, packet in enumerate(stream(3)) if k not in lost]
    if rng.random() < 0.5:
        row, column = rng.randrange(len(packets)), rng.choice([0, 1, 3, 5])
        packets[row] = changed(packets[row], column, packets[row][column] ^ (1 + rng.randrange(255)))
    frames, _ = run(packets, per_transfer)
    for frame in frames:
        k = (frame.clock_ticks - 1000) // 2_000_000
        np.testing.assert_array_equal(frame.image, image(k))


def test_the_pixel_order_is_grbg():
    red, green, blue = 200, 100, 50
    mosaic = np.empty((480, 640), np.uint8)
    mosaic[0::2, 0::2], mosaic[0::2, 1::2] = green, red
    mosaic[1::2, 0::2], mosaic[1::2, 1::2] = blue, green
    frames, _ = run(packetize(mosaic, 0, 0))
    color = cv2.cvtColor(frames[0].image, cv2.COLOR_BayerGRBG2BGR)[2:-2, 2:-2]
    assert np.abs(color.astype(int) - [blue, green, red]).max() <= 1
    gray = cv2.cvtColor(frames[0].image, cv2.COLOR_BayerGRBG2GRAY)[2:-2, 2:-2]
    assert np.abs(gray.astype(int) - 124).max() <= 1
