"""Ten million hostile bytes through each parser of a device.

python benchmarks/fuzz_parsers.py [--bytes 10000000] [--seed 0]

Streams mix noise, real frames, frames with changed, lost and doubled bytes, repeated headers and cut-off frames, in
chunks of every size. A parser must never raise, keep its memory bounded, and find the good frames that follow.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Callable

import numpy as np

from vsx_hw.create.protocol import StreamParser as CreateParser
from vsx_hw.create.protocol import encode_stream_frame
from vsx_hw.kinect.assembler import FrameAssembler
from vsx_hw.kinect.packets import packetize
from vsx_hw.kobuki.framing import encode_frame
from vsx_hw.kobuki.stream import StreamParser as KobukiParser

CHUNK = 4096
LONGEST_BUFFER = 600


def kobuki_frame(rng: random.Random) -> bytes:
    parts = [bytes((1, 15)) + rng.randbytes(2) + bytes(3) + rng.randbytes(4) + bytes(4) + bytes((160, 0))]
    parts += [bytes((4, 7)) + rng.randbytes(7)] * rng.randrange(2)
    parts += [bytes((rng.randrange(256), 3, 1, 2, 3))] * rng.randrange(2)
    return encode_frame(*parts)


def create_frame(rng: random.Random) -> bytes:
    return encode_stream_frame({7: rng.randrange(32), 35: 2, 43: rng.randrange(65536), 44: rng.randrange(65536)})


def hostile(rng: random.Random, frame: Callable[[random.Random], bytes], size: int) -> bytes:
    """About size bytes of everything that can go wrong on a line."""
    data = bytearray()
    while len(data) < size:
        kind, piece = rng.randrange(8), bytearray(frame(rng))
        if kind == 0:
            piece = bytearray(rng.randbytes(rng.randrange(1, 200)))
        elif kind == 1:
            piece[rng.randrange(len(piece))] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del piece[rng.randrange(len(piece))]
        elif kind == 3:
            piece.insert(rng.randrange(len(piece)), rng.randrange(256))
        elif kind == 4:
            piece = piece[: rng.randrange(len(piece))]
        elif kind == 5:
            piece = bytearray(piece[: rng.randrange(1, 4)] * rng.randrange(1, 60))
        data += piece
    return bytes(data)


def fuzz_serial(name: str, size: int, seed: int) -> str:
    rng = random.Random(seed)
    frame, parser = {"kobuki": (kobuki_frame, KobukiParser()), "create": (create_frame, CreateParser())}[name]
    fed = found = 0
    while fed < size:
        data = hostile(rng, frame, CHUNK)
        at = 0
        while at < len(data):
            step = rng.choice((1, 2, 7, 64, 255, 1024))
            found += len(parser.feed(data[at : at + step]))
            at += step
        fed += len(data)
        buffer = parser._scanner._buffer if name == "kobuki" else parser._buffer
        assert len(buffer) < LONGEST_BUFFER, f"{name}: {len(buffer)} bytes are held back"
    good = frame(rng)
    tail = sum(len(parser.feed(good)) for _ in range(40))
    assert tail >= 30, f"{name}: only {tail} of 40 good frames after the noise"
    return f"{name}: {fed} bytes, {found} frames, {parser.refused} refused"


def fuzz_kinect(size: int, seed: int) -> str:
    rng = np.random.default_rng(seed)
    assembler = FrameAssembler()
    fed = sequence = frames = 0
    pictures = {}
    while fed < size:
        picture = rng.integers(0, 256, (480, 640), np.uint8)
        pictures[frames % 4] = picture
        packets, lengths = packetize(picture, 2_000_000 * frames, sequence)
        sequence, frames = (sequence + len(lengths)) % 256, frames + 1
        for _ in range(int(rng.integers(0, 3))):
            damage(rng, packets, lengths)
        order = np.arange(len(lengths))
        if rng.random() < 0.2:
            order = np.delete(order, rng.integers(0, len(order), 3))
        if rng.random() < 0.1:
            order = np.insert(order, int(rng.integers(0, len(order))), order[: int(rng.integers(1, 9))])
        for rows in np.array_split(order, int(rng.integers(1, 12))):
            for whole in assembler.feed(0, packets[rows], lengths[rows]):
                assert whole.image.shape == (480, 640)
        fed += int(lengths.sum())
    for k in range(3):
        packets, lengths = packetize(pictures[0], k, sequence)
        sequence = (sequence + len(lengths)) % 256
        last = assembler.feed(0, packets, lengths)
    assert len(last) == 1
    assert np.array_equal(last[0].image, pictures[0])
    return f"kinect: {fed} bytes, {dict(assembler.counters)}"


def damage(rng: np.random.Generator, packets: np.ndarray, lengths: np.ndarray) -> None:
    row = int(rng.integers(0, len(lengths)))
    kind = int(rng.integers(0, 4))
    if kind == 0:
        packets[row, : int(rng.integers(1, 12))] = rng.integers(0, 256)
    elif kind == 1:
        lengths[row] = rng.integers(0, 1921)
    elif kind == 2:
        packets[row, 3] = rng.choice((0x81, 0x82, 0x85))
    else:
        packets[row] = rng.integers(0, 256, packets.shape[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for fuzz in (
        lambda: fuzz_serial("kobuki", args.bytes, args.seed),
        lambda: fuzz_serial("create", args.bytes, args.seed),
        lambda: fuzz_kinect(args.bytes, args.seed),
    ):
        begin_s = time.process_time()
        print(f"{fuzz()} ({time.process_time() - begin_s:.0f} s of processor time)", flush=True)


if __name__ == "__main__":
    main()
