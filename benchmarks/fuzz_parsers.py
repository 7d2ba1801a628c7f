"""Ten million random and damaged bytes through each device parser, and changed frames with correct checksums.

python benchmarks/fuzz_parsers.py [--bytes 10000000] [--frames 20000] [--seed 0]

Streams mix noise, real frames, frames with changed, lost and doubled bytes, repeated headers and cut-off frames, in
chunks of every size. A parser must never raise, keep its memory bounded, and find the good frames that follow.
Changed frames: of a base that drives and turns, every tenth frame has two bits changed so that the checksum is right
(two of one column of the XOR; one set and one cleared of a sum). It counts how many still pass, how many of them are
used (another contact, battery, mode, or a pose 1 mm or 1 mrad off), how many end a contact, and the heading error.
"""

import argparse
import math
import random
import struct
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from vsx_hw.bases import BASES
from vsx_hw.create.driver import STREAM_PACKETS
from vsx_hw.create.protocol import METRES_PER_TICK as CREATE_METRES_PER_TICK
from vsx_hw.create.protocol import StreamParser as CreateParser
from vsx_hw.create.protocol import encode_stream_frame
from vsx_hw.kinect.protocol import PACKET_BYTES, FrameAssembler, packetize
from vsx_hw.kobuki.feedback import METRES_PER_TICK
from vsx_hw.kobuki.protocol import encode_frame
from vsx_hw.kobuki.stream import StreamParser as KobukiParser

CHUNK = 4096
LONGEST_BUFFER = 600
TICK_NS = {"kobuki": 20_000_000, "create2": 15_000_000}
SPEED_M_S, TURN_RAD_S = 0.2, 0.3
_clock_ms = [0]


def kobuki_frame(rng: random.Random) -> bytes:
    _clock_ms[0] = (_clock_ms[0] + 20) % 65536
    parts = [
        bytes((1, 15)) + struct.pack("<H", _clock_ms[0]) + bytes(3) + rng.randbytes(4) + bytes(4) + bytes((160, 0))
    ]
    parts += [bytes((4, 7)) + rng.randbytes(7)] * rng.randrange(2)
    parts += [bytes((rng.randrange(32, 256), 3, 1, 2, 3))] * rng.randrange(2)
    return encode_frame(*parts)


def create_frame(rng: random.Random) -> bytes:
    return encode_stream_frame({7: rng.randrange(32), 35: 2, 43: rng.randrange(65536), 44: rng.randrange(65536)})


def hostile(rng: random.Random, frame: Callable[[random.Random], bytes], size: int) -> bytes:
    """About size bytes with every kind of line error."""
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
    good = random.Random(seed)
    tail = 0
    for _ in range(40):
        good.seed(seed)  # the same except for its time
        tail += len(parser.feed(frame(good)))
    assert tail >= 30, f"{name}: only {tail} of 40 good frames after the noise"
    return f"{name}: {fed} bytes, {found} frames, {parser.refused} refused"


def touches(k: int) -> int:
    """Whether the bumper is pressed."""
    return k // 50 % 2


def driving_kobuki(k: int) -> bytes:
    """The k-th frame of a Kobuki that drives in a circle, with all its regular parts."""
    t = k * TICK_NS["kobuki"] * 1e-9
    left, right = (int((SPEED_M_S + side * 0.115 * TURN_RAD_S) * t / METRES_PER_TICK) % 65536 for side in (-1, 1))
    angle = (round(math.degrees(TURN_RAD_S * t) * 100) + 18000) % 36000 - 18000
    core = struct.pack("<HBBBHHbbBBBB", 20 * k % 65536, 4 * touches(k), 0, 0, left, right, 30, 30, 0, 0, 157, 0)
    parts = {1: core, 3: bytes(3), 4: struct.pack("<hh3x", angle, round(math.degrees(TURN_RAD_S) * 100))}
    parts |= {5: struct.pack("<3H", 1673, 1965, 1609), 6: bytes((4, 4))}
    parts |= {13: bytes((2 * k % 256, 6)) + struct.pack("<6h", 42, -110, 1964, 35, -104, 1961)}
    parts |= {16: struct.pack("<8H", 0, 4095, 4095, 4095, 4095, 0, 0, 0)}
    answer = b"" if k else bytes((10, 4, 4, 0, 1, 0, 11, 4, 0, 2, 1, 0))
    return encode_frame(*(bytes((kind, len(data))) + data for kind, data in parts.items()), answer)


def driving_create(k: int) -> bytes:
    """The k-th stream frame of a Create 2 that drives in a circle."""
    t = k * TICK_NS["create2"] * 1e-9
    half = 0.5 * BASES["create2"].wheel_base_m * TURN_RAD_S
    values = dict.fromkeys(STREAM_PACKETS, 0) | {7: 2 * touches(k), 22: 15776, 25: 1890, 26: 2068, 35: 2}
    values[43] = int((SPEED_M_S - half) * t / CREATE_METRES_PER_TICK) % 65536
    values[44] = int((SPEED_M_S + half) * t / CREATE_METRES_PER_TICK) % 65536
    return encode_stream_frame(values)


def changed(name: str, frame: bytes, rng: random.Random) -> bytes:
    """Change two bits behind the header and keep the checksum correct."""
    while True:
        data, bit = bytearray(frame), 1 << rng.randrange(8)
        a, b = rng.sample(range(2 if name == "kobuki" else 1, len(data)), 2)
        if name == "kobuki" or (data[a] ^ data[b]) & bit:
            data[a] ^= bit
            data[b] ^= bit
            return bytes(data)


def fuzz_frames(name: str, count: int, seed: int) -> str:
    """count changed frames, every tenth of a drive, through a base's dialect, compared with the undamaged drive."""
    rng, frame = random.Random(seed), {"kobuki": driving_kobuki, "create2": driving_create}[name]
    line, true = (BASES[name].dialect(1.0, 1.0) for _ in range(2))
    seen, steps, before = Counter(passed=0, used=0, contact_ended=0, good_refused=0), [0.0], (0.0, 0.0)
    for k in range(10 * count):
        now_ns, data = k * TICK_NS[name] + 1, frame(k)
        line.drive(SPEED_M_S, TURN_RAD_S)
        true.drive(SPEED_M_S, TURN_RAD_S)
        (want,) = true.receive(data, now_ns)
        hit = k % 10 == 9
        got = line.receive(changed(name, data, rng) if hit else data, now_ns)
        seen["good_refused"] += not hit and not got
        for reading in got:
            o, w = reading.odometry, want.odometry
            off = (math.hypot(o.x_m - w.x_m, o.y_m - w.y_m), o.heading_rad - w.heading_rad)
            seen["contact_ended"] += bool(want.hazards & ~reading.hazards)
            if hit:
                seen["passed"] += 1
                same = reading.hazards == want.hazards and reading.battery == want.battery and reading.mode == want.mode
                seen["used"] += not same or max(abs(a - b) for a, b in zip(off, before)) > 1e-3
            steps.append(abs(off[1] - before[1]))
            before = off
    shares = ", ".join(f"{what} {number} ({100 * number / count:.2f} %)" for what, number in seen.items())
    return (
        f"{name}: {count} changed frames with a right checksum: {shares}; heading off by {max(steps):.3f} rad at most"
    )


def fuzz_kinect(size: int, seed: int) -> str:
    rng = np.random.default_rng(seed)
    assembler = FrameAssembler()
    fed = sequence = frames = 0
    pictures = {}
    while fed < size:
        picture = rng.integers(0, 256, (480, 640), np.uint8)
        pictures[frames % 4] = picture
        packets = packetize(picture, 2_000_000 * frames, sequence)
        sequence, frames = (sequence + len(packets)) % 256, frames + 1
        for _ in range(int(rng.integers(0, 3))):
            damage(rng, packets)
        order = np.arange(len(packets))
        if rng.random() < 0.2:
            order = np.delete(order, rng.integers(0, len(order), 3))
        if rng.random() < 0.1:
            order = np.insert(order, int(rng.integers(0, len(order))), order[: int(rng.integers(1, 9))])
        for rows in np.array_split(order, int(rng.integers(1, 12))):
            for whole in assembler.feed(0, [packets[row] for row in rows]):
                assert whole.image.shape == (480, 640)
        fed += sum(map(len, packets))
    for k in range(3):
        packets = packetize(pictures[0], k, sequence)
        sequence = (sequence + len(packets)) % 256
        last = assembler.feed(0, packets)
    assert len(last) == 1
    assert np.array_equal(last[0].image, pictures[0])
    return f"kinect: {fed} bytes, {dict(assembler.counters)}"


def damage(rng: np.random.Generator, packets: list[bytes]) -> None:
    row = int(rng.integers(0, len(packets)))
    packet = packets[row].ljust(PACKET_BYTES, b"\0")
    kind = int(rng.integers(0, 4))
    if kind == 0:
        count = int(rng.integers(1, 12))
        packet = bytes((int(rng.integers(0, 256)),)) * count + packet[count : len(packets[row])]
    elif kind == 1:
        packet = packet[: int(rng.integers(0, PACKET_BYTES + 1))]
    elif kind == 2:
        packet = packet[:3] + rng.choice((b"\x81", b"\x82", b"\x85")) + packet[4 : len(packets[row])]
    else:
        packet = rng.bytes(len(packets[row]))
    packets[row] = packet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bytes", type=int, default=10_000_000)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for fuzz in (
        lambda: fuzz_serial("kobuki", args.bytes, args.seed),
        lambda: fuzz_serial("create", args.bytes, args.seed),
        lambda: fuzz_kinect(args.bytes, args.seed),
        lambda: fuzz_frames("kobuki", args.frames, args.seed),
        lambda: fuzz_frames("create2", args.frames, args.seed),
    ):
        begin_s = time.process_time()
        print(f"{fuzz()} ({time.process_time() - begin_s:.0f} s of processor time)", flush=True)


if __name__ == "__main__":
    main()
