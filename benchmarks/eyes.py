"""The same drive seen by both eyes: our own renderer, and Mitsuba's path tracer.

    PYTHONPATH=src:hw python benchmarks/eyes.py --keep FOLDER [--seeds 100] [--length 8] [--samples 16]

The robot drives once round a course in a lab, with an image every 4 cm, 5 a second. The drive does not depend on what
it sees, so both eyes look from the same places at the same moments. Each picture of Mitsuba's takes seconds: it is kept
in the folder as it is done, before the sensor, and an interrupted drive goes on with the next one. Corners are FAST
corners of the four levels at the thresholds with which the detector begins. ATE without odometry is after alignment
with scale.
"""

import argparse
import os
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace
from seeds import seed_range
from slam_accuracy import loop_courses, note, run
from slam_drives import CLEAR_M, EMULATION, RATE_HZ, Drive, clearest_start, record

from vsx_ros.arrays import Float32Array
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.sim.camera import PosesAt
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.renderer import Picture
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig, simulation_of
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.pyramid import build_pyramid

EYES = ("raster", "mitsuba")
STEP_M = 0.04  # between images
WITHIN = 1.5  # times the other eye's figure
NOTHING = np.zeros((0, 0), np.float32), np.zeros((0, 0), np.int32)


class KeptPictures:
    """Draws each picture once: the next time it is read from the folder, with half precision."""

    def __init__(self, robot: EmulatedRobot, folder: Path) -> None:
        self._draw, self._folder = robot.camera.picture, folder
        folder.mkdir(parents=True, exist_ok=True)

    def __call__(self, stamp_ns: int, poses_at: PosesAt, bayer: bool = False, want_depth: bool = False) -> Picture:
        file = self._folder / f"{stamp_ns:013d}.npy"
        if not file.exists():
            radiance = self._draw(stamp_ns, poses_at, bayer).radiance
            part = file.with_suffix(".part")
            with part.open("wb") as out:
                np.save(out, radiance.astype(np.float16))
            os.replace(part, file)
            note(f"{file} drawn")
        kept: Float32Array = np.load(file).astype(np.float32)
        return Picture(kept, *NOTHING)


def eye_config(eye: str, samples: int) -> SimulationConfig:
    """As in the other drives, at the rate of a path tracer."""
    rate_hz = simulation_of("mitsuba").frame_rate_hz
    camera = replace(EMULATION.camera, eye=eye, mitsuba_samples=samples)
    return replace(EMULATION, frame_rate_hz=rate_hz, camera=camera)


def seen_drive(seed: int, length_m: float, eye: str, samples: int, keep: Path) -> Drive | None:
    """The roundest course that fits into the lab, seen by an eye; None if none fits."""
    world, config = generate_world("lab", seed), eye_config(eye, samples)
    for legs in loop_courses(length_m, STEP_M * config.frame_rate_hz / RATE_HZ):
        clearance, start = clearest_start(world, legs)
        if clearance >= CLEAR_M:
            folder = keep / f"{eye}{samples if eye == 'mitsuba' else ''}_lab{seed}_{length_m:g}m"

            def prepare(robot: EmulatedRobot, folder: Path = folder) -> None:
                robot.camera.picture = KeptPictures(robot, folder)  # type: ignore[method-assign]  # keeps what it draws

            return record(replace(world, start=start), seed, legs, config, prepare)
    note(f"lab {seed}: no room for the course, left out")
    return None


def figures(drive: Drive) -> dict[str, float]:
    """By name: what the SLAM makes of a drive."""
    detector = CornerDetector()
    corners = [sum(detector.detect(build_pyramid(image), steer=False).counts) for image in drive.images]
    told = {"images": float(len(drive)), "corners an image": float(np.mean(corners))}
    for name, wheels, kind in (("with odometry", True, "se3"), ("without", False, "sim3")):
        done = run(drive, lambda k: wheels)  # noqa: B023 (called at once)
        tracked = [result for result in done.results if result.state.tracked]
        searched = sum(result.searched for result in tracked)
        told[f"points tracked an image, {name}"] = float(np.mean([result.found for result in tracked] or [0]))
        told[f"share found, {name} [%]"] = 100.0 * sum(result.found for result in tracked) / max(searched, 1)
        told[f"images lost, {name}"] = float(done.lost())
        error = trajectory_error(done.pairs, kind) if len(done.pairs) >= 3 else None
        told[f"ATE, {name} [cm]"] = float("inf") if error is None else 100.0 * error.ate_rmse_m
    return told


def table(name: str, by_eye: list[dict[str, float]]) -> str:
    """Both eyes side by side, and the second in relation to the first."""
    lines = [f"{name:44}{EYES[0]:>10}{EYES[1]:>10}{'ratio':>8}"]
    for key, ours in by_eye[0].items():
        theirs = by_eye[1][key]
        ratio = theirs / ours if ours else float("nan")
        mark = "" if not ours or 1.0 / WITHIN <= ratio <= WITHIN else f"  beyond {WITHIN:g} x"
        lines.append(f"{key:44}{ours:10.2f}{theirs:10.2f}{ratio:8.2f}{mark}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, metavar="FOLDER", help="where the pictures are kept")
    parser.add_argument("--seeds", type=seed_range, default=range(100, 101), metavar="A-B", help="labs (default 100)")
    parser.add_argument("--length", type=float, default=8.0, metavar="M", help="of the course (default 8)")
    parser.add_argument("--samples", type=int, default=16, metavar="N", help="paths a pixel (default 16)")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    warm_up()
    for seed in args.seeds:
        drives = [seen_drive(seed, args.length, eye, args.samples, args.keep) for eye in EYES]
        if all(drives):
            print(table(f"lab {seed}, {args.samples} paths a pixel", [figures(drive) for drive in drives if drive]))


if __name__ == "__main__":
    main()
