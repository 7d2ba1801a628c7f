"""The emulated base lives in the time of the host: what is stamped on arrival and what by its clock belong together."""

import time

from hw_plant import FreeWheels
from waiting import wait_for

from vsx_hw.bases import base_emulator


class TimedWheels(FreeWheels):
    """Remembers how far its time was behind the host's at the end of each step."""

    def __init__(self, start_ns: int) -> None:
        super().__init__(0.23)
        self.start_ns, self.elapsed_ns = start_ns, 0
        self.behind_ns: list[int] = []

    def advance(self, dt_ns: int) -> None:
        super().advance(dt_ns)
        self.elapsed_ns += dt_ns
        self.behind_ns.append(time.monotonic_ns() - self.start_ns - self.elapsed_ns)


def test_what_passed_before_the_start_is_caught_up_with_and_nothing_is_told_before_it_happened(tmp_path):
    start_ns = time.monotonic_ns() - 500_000_000
    plant = TimedWheels(start_ns)
    emulator = base_emulator("kobuki", plant, str(tmp_path / "base"), seed=1)
    emulator.start(start_ns)
    try:
        wait_for(lambda: plant.elapsed_ns > 800_000_000)
    finally:
        emulator.close()
    assert plant.behind_ns[0] > 450_000_000
    assert min(plant.behind_ns) >= 0
    assert min(plant.behind_ns) < 100_000_000
