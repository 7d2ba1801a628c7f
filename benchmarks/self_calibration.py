"""Uncalibrated wheels and gyro: ``PYTHONPATH=src:hw python benchmarks/self_calibration.py [--seeds A-B]``.

The wheels' radius and distance are each 10 % wrong in the driver, the gyro's scale is 5 % and its zero 1 deg/s wrong;
the seed gives the signs. The robot drives ovals in a lab, 4 cm per frame. It prints the errors of the calibration after
20 m against the truth, and the error of the live track (se3, cm) before and after, each with and without correction.
"""

import argparse
import math
import sys
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from msgspec.structs import replace
from seeds import seed_range
from slam_building import RATE_HZ, laps_legs
from slam_drives import CLEAR_M, Drive, clearest_start, kept, record

from vsx_ros.config import Config, SelfCalibrationConfig
from vsx_ros.evaluation.trajectory import Pairs, trajectory_error
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.session import SlamSession
from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import SimulationConfig
from vsx_ros.slam.slam import SequentialSlam

FOUND_AFTER_M, LAPS = 20.0, 3
LEGS_PER_LAP, PIECE = 6, 8  # frames, for the true factors
USUAL = SimulationConfig(frame_rate_hz=RATE_HZ)


class Told(NamedTuple):
    """Errors of the calibration: shares in percent, zero in deg/s; NaN if refused. ate: cm before, after 20 m."""

    way: float
    turn: float
    zero: float
    track: float
    ate: tuple[float, float]
    events: list[str]


def wrong(seed: int) -> SimulationConfig:
    way, track, gyro, zero = ((1.0 if seed >> bit & 1 else -1.0) for bit in range(4))
    body = BodySettings(
        true_way=1.0 + 0.1 * way, true_track=1.0 + 0.1 * track, gyro_scale=1.0 + 0.05 * gyro,
        gyro_zero_rad_s=math.radians(zero),
    )  # fmt: skip
    return SimulationConfig(frame_rate_hz=RATE_HZ, body=body)


def ovals(seed: int, usual: bool, keep: Path | None) -> Drive | None:
    """LAPS ovals in lab ``seed`` from its clearest place; None if there is none. usual: with correct wheels."""

    def make() -> Drive | None:
        world, legs = generate_world("lab", seed), laps_legs()[: LAPS * LEGS_PER_LAP]
        clearance, start = clearest_start(world, legs)
        if clearance < CLEAR_M:
            return None
        return record(replace(world, start=start), seed, legs, USUAL if usual else wrong(seed))

    return kept(f"{'usual' if usual else 'wrong'}_wheels_{seed}", keep, make)


def true_factors(drive: Drive) -> tuple[float, float, float, float]:
    """True factors of path and turn, zero [rad/s], factor of the wheels' turn."""
    bases = [(drive.true_pose(k) @ drive.T_base_cam.inverse()).to_se2() for k in range(0, len(drive), PIECE)]
    seen = np.array([(a.distance_to(b), a.angle_to(b)) for a, b in zip(bases, bases[1:])])
    x, y, theta, _, _, wheels = np.diff(drive.odometry[::PIECE], axis=0).T
    seconds, way = np.diff(drive.stamps_ns[::PIECE]) * 1e-9, np.hypot(x, y)
    turn = np.linalg.lstsq(np.column_stack([theta, -seconds]), seen[:, 1], rcond=None)[0]
    return (
        float(way @ seen[:, 0] / (way @ way)), float(turn[0]), float(turn[1] / turn[0]),
        float(np.linalg.lstsq(np.column_stack([wheels, way]), seen[:, 1], rcond=None)[0][0]),
    )  # fmt: skip


def told(drive: Drive, enabled: bool) -> Told:
    config = replace(Config(), self_calibration=SelfCalibrationConfig(enabled=enabled))
    session = SlamSession(drive.T_base_cam, config)
    slam = session.begin(SequentialSlam, drive.camera, 1)
    way, found = 0.0, None
    parts: tuple[Pairs, Pairs] = ([], [])
    for k in range(len(drive)):
        way += float(np.linalg.norm(drive.truth[k][:3, 3] - drive.truth[max(0, k - 1)][:3, 3]))
        result = session.track(drive.frame(k), drive.odometry_at(k))
        if result.T_world_cam is not None:
            parts[way >= FOUND_AFTER_M].append((result.T_world_cam, drive.true_pose(k)))
        if found is None and way >= FOUND_AFTER_M and session.calibration is not None:
            found = session.calibration.found
            print(found, file=sys.stderr)
    ate = tuple(100.0 * trajectory_error(pairs).ate_rmse_m if len(pairs) > 3 else math.nan for pairs in parts)
    events = [f"{e.stamp_ns * 1e-9:.1f} s {e.kind}: {e.reason}" for e in slam.drain_events()]
    errors = [math.nan] * 4
    if found is not None:
        true, factors = true_factors(drive), (found.linear, found.angular, found.zero, found.track)
        errors = [math.nan if f is None else f.value - t for f, t in zip(factors, true)]
    way_off, turn_off, zero_off, track_off = errors
    return Told(100 * way_off, 100 * turn_off, math.degrees(zero_off), 100 * track_off, (ate[0], ate[1]), events)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--seeds", type=seed_range, default=range(100, 105), metavar="A-B", help="labs (default 100-104)"
    )
    parser.add_argument("--usual", action="store_true", help="wheels and gyro as the emulator has them: 0.5 %% wrong")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep rendered drives there and use them again")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    warm_up()
    print(
        "seed   way %  turn %  zero deg/s  track %   mount mm   ATE cm: to 20 m   after | uncorrected: to 20 m   after"
    )
    for seed in args.seeds:
        drive = ovals(seed, args.usual, args.keep)
        if drive is None:
            print(f"{seed:4}   no room for the course")
            continue
        on, off = told(drive, True), told(drive, False)
        print("\n".join(on.events), file=sys.stderr)
        print(
            f"{seed:4}  {on.way:+6.2f}  {on.turn:+6.2f}  {on.zero:+10.3f}  {on.track:+7.2f}"
            f"   {1000 * (drive.truth[0][2, 3] - drive.T_base_cam.translation[2]):+8.1f}"
            f"   {on.ate[0]:15.1f} {on.ate[1]:7.1f} | {off.ate[0]:21.1f} {off.ate[1]:7.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
