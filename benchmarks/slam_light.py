"""Changing light and bursts of blur: how many frames are lost, and how much the accuracy suffers.

    PYTHONPATH=src:hw python benchmarks/slam_light.py [gain blur highlights] [--seeds 100-109] [--keep FOLDER]

The drives are the loops of slam.py, with and without odometry; the disturbance is added to every recorded image.
ATE without odometry is after alignment with scale.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from seeds import seed_range
from slam import table
from slam_accuracy import Row, loop_courses, note, run
from slam_drives import RATE_HZ, Drive, lab_drive

from vsx_ros.evaluation.trajectory import trajectory_error

SWING, PERIOD_S = 0.25, 1.0  # of the gain, like an oscillating exposure control
BLUR_PX, BURST_S, CALM_S = 6, 0.4, 1.6
BLOBS = ((90, 70, 14), (250, 40, 9), (420, 110, 20), (560, 60, 11), (330, 300, 8), (150, 390, 12))  # x, y, radius [px]


def gain(image: np.ndarray, time_s: float) -> np.ndarray:
    factor = 1.0 + SWING * math.sin(2.0 * math.pi * time_s / PERIOD_S)
    return np.clip(np.rint(image * np.float32(factor)), 0, 255).astype(np.uint8)


def blur(image: np.ndarray, time_s: float) -> np.ndarray:
    return cv2.blur(image, (BLUR_PX, 1)) if time_s % (BURST_S + CALM_S) < BURST_S else image


def highlights(image: np.ndarray, time_s: float) -> np.ndarray:
    """Saturated reflections of lamps in a cover of the lens; they do not move with the scene."""
    light = np.zeros_like(image)
    for x, y, radius in BLOBS:
        cv2.circle(light, (x, y), radius, 255, -1)
    return cv2.add(image, cv2.GaussianBlur(light, (0, 0), 2.0))


DISTURBANCES: dict[str, Callable[[np.ndarray, float], np.ndarray]] = {
    "gain": gain,
    "blur": blur,
    "highlights": highlights,
}


def disturbed(drive: Drive, change: Callable[[np.ndarray, float], np.ndarray]) -> Drive:
    images = np.stack([change(image, k / RATE_HZ) for k, image in enumerate(drive.images)])
    return Drive(drive.camera, drive.T_base_cam, drive.stamps_ns, images, drive.odometry, drive.truth)


def judged(drive: Drive, wheels: bool) -> tuple[float, float]:
    """(share of the frames lost [%], ATE [cm])."""
    done = run(drive, lambda k: wheels)
    if len(done.pairs) < 3:
        return 100.0, math.inf
    error = trajectory_error(done.pairs, "yaw" if wheels else "sim3")
    return 100.0 * done.lost() / len(drive), 100.0 * error.ate_rmse_m


def rows(names: list[str], seeds: range, keep: Path | None) -> list[Row]:
    lost: dict[str, list[float]] = {}
    worse: dict[str, list[float]] = {}
    for seed in seeds:
        drive = lab_drive("loop", seed, loop_courses(), keep)
        if drive is None:
            continue
        for wheels in (True, False):
            _, plain_cm = judged(drive, wheels)
            for name in names:
                case = f"{name}, {'odometry' if wheels else 'no odometry'}"
                share, ate_cm = judged(disturbed(drive, DISTURBANCES[name]), wheels)
                lost.setdefault(case, []).append(share)
                worse.setdefault(case, []).append(ate_cm / plain_cm)
                note(f"{case}, seed {seed}: {share:.1f} % lost, ATE {ate_cm:.2f} cm, undisturbed {plain_cm:.2f}")
    return [
        row
        for case in lost
        for row in (
            Row(f"{case}: frames lost", "%", 1.0, 0.0, lost[case]),
            Row(f"{case}: ATE / undisturbed", "", 1.5, 1.1, worse[case]),
        )
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(DISTURBANCES))
    parser.add_argument("--seeds", type=seed_range, default=range(100, 110), metavar="A-B", help="labs")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep rendered drives there and use them again")
    args = parser.parse_args()
    if unknown := set(args.names) - set(DISTURBANCES):
        parser.error(f"there is no {', '.join(sorted(unknown))}")
    cv2.setNumThreads(1)
    print(table(rows(args.names or list(DISTURBANCES), args.seeds, args.keep)))


if __name__ == "__main__":
    main()
