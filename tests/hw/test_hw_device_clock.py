"""The device clock: the least delay wins, wraps and restarts are survived."""

import random

import pytest

from vsx_hw.readings import DeviceClock

MS = 1_000_000


def test_jittered_arrivals_give_even_stamps():
    rng = random.Random(3)
    clock = DeviceClock(60_000_000, 32)
    start = 1_700_000_000_000_000_000
    stamps = []
    for k in range(3000):
        ticks = (4_290_000_000 + k * 2_000_000) % 2**32
        delay_ns = rng.randrange(0, 30 * MS) if k % 50 else 0
        stamps.append(clock.host_ns(ticks, start + k * 2_000_000 * 50 // 3 + delay_ns))
    steps = [b - a for a, b in zip(stamps, stamps[1:])]
    assert max(abs(step - 33_333_333) for step in steps[60:]) <= 1
    assert abs(stamps[100] - (start + 100 * 33_333_333)) < 1000


def test_drift_of_the_crystal_is_followed():
    clock = DeviceClock(1000, 16)
    worst = 0
    for k in range(20_000):
        true_ns = k * 20 * MS
        device_ms = round(k * 20 * (1 - 50e-6)) % 65536
        stamp = clock.host_ns(device_ms, 10**18 + true_ns)
        if k > 2000:
            worst = max(worst, abs(stamp - 10**18 - true_ns))
    assert 0.1 * MS < worst < 2.5 * MS


def test_restart_of_the_device_and_long_silence_start_anew():
    clock = DeviceClock(1000, 16)
    start = 10**18
    for k in range(100):
        clock.host_ns(50_000 + k * 20, start + k * 20 * MS)
    after = start + 5000 * MS
    assert clock.host_ns(17, after) == after
    much_later = after + 66_000 * MS
    assert clock.host_ns(40, much_later) == much_later
    assert clock.host_ns(60, much_later + 20 * MS) == much_later + 20 * MS


def test_a_host_clock_set_back_is_followed():
    clock = DeviceClock(1000, 16)
    clock.host_ns(100, 10**18)
    assert clock.host_ns(120, 10**18 - 3_600_000 * MS) == 10**18 - 3_600_000 * MS


class SteppedHost:
    """Two devices that report to a host whose clock is stepped at 20 s; the second one starts 7 s later, and its
    arrivals are stamped up to 30 ms before they are converted."""

    def __init__(self, step_ms: int, told: bool = True) -> None:
        self.step_ns, self.told, self.time_ns = step_ms * MS, told, 0
        self.base, self.camera = (DeviceClock(hz, bits, self.ahead_ns) for hz, bits in ((1000, 16), (60_000_000, 32)))

    def ahead_ns(self) -> int:
        return 10**18 + self.step_ns * (self.told and self.time_ns >= 20_000 * MS)

    def wall_ns(self, time_ns: int) -> int:
        return time_ns + 10**18 + self.step_ns * (time_ns >= 20_000 * MS)

    def stamps(self) -> list[tuple[int, int, int]]:
        """(true time, error of the base's stamp, error of the camera's) against the host's clock."""
        errors, camera = [], 0
        for k in range(3000):
            base_ns = k * 20 * MS
            self.time_ns = base_ns
            base = self.base.host_ns(k * 20 % 65536, self.wall_ns(base_ns))
            if base_ns >= 7000 * MS:
                self.time_ns = base_ns + 15 * MS
                seen_ns = base_ns - 15 * MS
                stamp = self.camera.host_ns(seen_ns * 60 // 1000 % 2**32, self.wall_ns(seen_ns))
                camera = stamp - seen_ns - self.ahead_ns()
            errors.append((base_ns, base - self.wall_ns(base_ns), camera))
        return errors


@pytest.mark.parametrize("step_ms", [300, -300, 900, -50])
def test_a_step_of_the_host_s_clock_is_followed_at_once_by_all_devices(step_ms):
    errors = SteppedHost(step_ms).stamps()
    assert max(abs(base) for _, base, _ in errors) < 20 * MS
    assert max(abs(base - camera) for _, base, camera in errors) < 5 * MS


def test_messages_that_come_late_from_now_on_are_not_a_step():
    errors = SteppedHost(300, told=False).stamps()
    assert {base for time_ns, base, _ in errors if 20_000 * MS <= time_ns < 28_000 * MS} == {-300 * MS}
