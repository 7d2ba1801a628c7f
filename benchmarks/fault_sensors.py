"""Each sensor of each base broken during each motion, and drives without faults: what is reported and done.

python benchmarks/fault_sensors.py [--minutes 5]

The real driver and mux over the emulated board, in simulated time (tests/hw/hw_sensor_faults.py). Each case writes a
row; benchmarks/tables.py makes the tables of docs/reliability.md from them.
"""

import argparse
import sys
from collections import namedtuple
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from tables import campaign

sys.path.extend(str(Path(__file__).parents[1] / "tests" / room) for room in ("", "hw"))
import hw_sensor_faults

Broken = namedtuple("Broken", "base sensor fault motion")
Sound = namedtuple("Sound", "wheels base minutes")
BASES = ("kobuki", "create", "create2")
SENSORS = dict.fromkeys(("left", "right", "both"), hw_sensor_faults.ENCODER_FAULTS)
SENSORS |= {"gyro": hw_sensor_faults.GYRO_FAULTS}
WHEELS = {
    "as built": {},
    "both count 10 % too much": {"scales": (1.1, 1.1)},
    "both 10 % too little": {"scales": (0.9, 0.9)},
    "the left one 10 % too much": {"scales": (1.1, 1.0)},
    "5 % each way": {"scales": (0.95, 1.05)},
    "as built, up to 10 % slip": {"slip": 0.1},
}


def told(case: Broken) -> dict[str, float | None]:
    """One row. refused: frames that the driver refused; without a fault it refuses none."""
    drives: list[Any] = []

    class KeptDrive(hw_sensor_faults.Drive):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            drives.append(self)

    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(hw_sensor_faults, "Drive", KeptDrive)
        done = hw_sensor_faults.drive_and_break(case.base, case.motion, case.sensor, case.fault, monkeypatch)
    return {
        "told_s": done.told_s, "stood_s": done.stood_s, "jump_m": done.jump_m, "jump_rad": done.jump_rad,
        "wrong_rad": done.wrong_rad, "as_slip": done.words.endswith("that of the gyro"),
        "refused": drives[0].wire.driver.status().counters["refused_frames"],
    }  # fmt: skip


def alarms(drive: Sound) -> dict[str, int]:
    with pytest.MonkeyPatch.context() as monkeypatch:
        found = hw_sensor_faults.alarms(drive.base, drive.minutes, monkeypatch, seed=1, **WHEELS[drive.wheels])
    return {"alarms": len(found)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="of each drive on which nothing is broken")
    args = parser.parse_args()
    broken = [
        Broken(base, sensor, fault, motion)
        for base, sensor in product(BASES, SENSORS)
        if (base, sensor) != ("create2", "gyro")
        for fault, motion in product(SENSORS[sensor], hw_sensor_faults.MOTIONS)
    ]
    campaign("fault_sensors", broken, told)
    campaign("fault_alarms", [Sound(wheels, base, args.minutes) for wheels, base in product(WHEELS, BASES)], alarms)


if __name__ == "__main__":
    main()
