"""The Kobuki's gyro from its bytes: axes, units, stamps, and whether it is alive."""

import math
import random
import struct

import pytest

from vsx_hw.kobuki.driver import KobukiDialect
from vsx_hw.kobuki.feedback import Core, Feedback, Inertia, RawGyro
from vsx_hw.kobuki.odometry import FRAMES, Pulse
from vsx_hw.kobuki.protocol import encode_frame

NOW_NS = 10**18
CORE = bytes((1, 15)) + struct.pack("<HBBBHHbbBBBB", 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 160, 0)
INERTIA = bytes((4, 7)) + struct.pack("<hh3x", 0, 0)


def reading(*samples: tuple[int, int, int]):
    raw = bytes((13, 2 + 6 * len(samples), 0, 3 * len(samples))) + b"".join(struct.pack("<3h", *s) for s in samples)
    (told,) = KobukiDialect().receive(encode_frame(CORE, INERTIA, raw), NOW_NS)
    return told


def test_raw_samples_are_turned_into_the_axes_of_the_base():
    told = reading((0, 0, 0), (100, 200, 300))
    degrees = [math.degrees(rate) for rate in told.gyro.raw[1][1:]]
    assert degrees == pytest.approx([-1.75, 0.875, 2.625])


@pytest.mark.parametrize("count", [2, 3])
def test_raw_samples_are_ten_milliseconds_apart_the_newest_last(count):
    told = reading(*((k, 0, 0) for k in range(count)))
    assert [s.stamp_ns - told.stamp_ns for s in told.gyro.raw] == [10_000_000 * (k - count + 1) for k in range(count)]
    assert [round(s.y / math.radians(0.00875)) for s in told.gyro.raw] == list(range(count))


def pulse(samples, turn_rad: float = 0.0):
    core = Core(*[0] * 12)
    watch = Pulse()
    frames = [Feedback(core, Inertia(0, 0), gyro=RawGyro(0, samples(k))) for k in range(2 * FRAMES)]
    return [watch.alive(frame, turn_rad, 0.02) for frame in frames][-1]


def test_a_gyro_with_noise_is_alive_and_one_that_repeats_itself_is_dead():
    rng = random.Random(1)
    assert pulse(lambda k: tuple((rng.randrange(-20, 21), 0, 0) for _ in range(2))) is True
    assert pulse(lambda k: ((3, -5, 7), (2, -4, 9))) is False
    assert pulse(lambda k: ()) is None


def test_samples_that_contradict_the_angle_prove_nothing():
    steps = round(0.4 / math.radians(0.00875))
    assert pulse(lambda k: ((k, 0, steps), (k, 1, steps)), turn_rad=0.4 * 0.02) is True
    assert pulse(lambda k: ((k, 0, steps), (k, 1, steps)), turn_rad=0.0) is None
