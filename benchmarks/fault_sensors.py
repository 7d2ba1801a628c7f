"""Each sensor of each base broken during each motion, and drives without faults: what is reported and done.

python benchmarks/fault_sensors.py [--minutes 5]

The real driver and mux over the emulated board, in simulated time (tests/hw/hw_sensor_faults.py). Each case writes a
row; benchmarks/tables.py makes the tables of docs/reliability.md from them.
"""

import argparse
import sys
from pathlib import Path

import pytest
from tables import RESULTS, rooms_of

from vsx_ros.experiments.rows import Store

sys.path.extend(str(Path(__file__).parents[1] / "tests" / room) for room in ("", "hw"))
import hw_sensor_faults

BASES = ("kobuki", "create", "create2")
WHEELS = {
    "as built": {},
    "both count 10 % too much": {"scales": (1.1, 1.1)},
    "both 10 % too little": {"scales": (0.9, 0.9)},
    "the left one 10 % too much": {"scales": (1.1, 1.0)},
    "5 % each way": {"scales": (0.95, 1.05)},
    "as built, up to 10 % slip": {"slip": 0.1},
}


def measure_faults(store: Store) -> None:
    for base in BASES:
        sensors = ("left", "right", "both")
        encoders = [(sensor, fault) for sensor in sensors for fault in hw_sensor_faults.ENCODER_FAULTS]
        gyro = [("gyro", fault) for fault in hw_sensor_faults.GYRO_FAULTS if base != "create2"]
        for sensor, fault in encoders + gyro:
            for motion in hw_sensor_faults.MOTIONS:
                asked = {"base": base, "sensor": sensor, "fault": fault, "motion": motion}
                if asked not in store:
                    store.add(asked, case(base, sensor, fault, motion))
                    print(*asked.values(), store[asked], flush=True)


def case(base: str, sensor: str, fault: str, motion: str) -> dict[str, float | None]:
    with pytest.MonkeyPatch.context() as monkeypatch:
        done = hw_sensor_faults.drive_and_break(base, motion, sensor, fault, monkeypatch)
    return {
        "told_s": done.told_s, "stood_s": done.stood_s, "jump_m": done.jump_m, "jump_rad": done.jump_rad,
        "wrong_rad": done.wrong_rad, "as_slip": done.words.endswith("that of the gyro"),
    }  # fmt: skip


def measure_alarms(store: Store, minutes: float) -> None:
    for wheels, wrong in WHEELS.items():
        for base in BASES:
            asked = {"wheels": wheels, "base": base, "minutes": minutes}
            if asked not in store:
                with pytest.MonkeyPatch.context() as monkeypatch:
                    found = hw_sensor_faults.alarms(base, minutes, monkeypatch, seed=1, **wrong)
                store.add(asked, {"alarms": len(found)})
                print(wheels, base, len(found), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="of each drive on which nothing is broken")
    args = parser.parse_args()
    measure_faults(Store(RESULTS / "fault_sensors.jsonl", rooms=rooms_of("fault_sensors")))
    measure_alarms(Store(RESULTS / "fault_alarms.jsonl", rooms=rooms_of("fault_alarms")), args.minutes)


if __name__ == "__main__":
    main()
