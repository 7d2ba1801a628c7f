"""Whether the SLAM's covariances are correct.

    PYTHONPATH=src:hw python benchmarks/consistency.py [--seeds 100-159] [--keep FOLDER]

NEES (Bar-Shalom 2001, 5.4) of the live pose on the floor (x, y, heading; 3 degrees of freedom) against the truth, in
the frame of the first keyframe. One value per drive at each of three moments: a third of the way, two thirds, the end.
In 95 of 100 drives it should lie in the band of the chi-square distribution. ``--keep`` as in slam.py.
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from seeds import seed_range
from slam_accuracy import SLAM, loop_courses
from slam_drives import Drive, lab_drive

from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.uncertainty import carried

BAND = (0.2158, 9.3484)  # chi-square with 3 degrees of freedom: 2.5 and 97.5 %
MOMENTS = (1 / 3, 2 / 3, 1.0)
ON_FLOOR = np.array([0, 1, 5])  # x, y, heading of the base's tangent


def errors(drive: Drive) -> list[tuple[np.ndarray, np.ndarray]]:
    """(error (3,), covariance (3, 3)) of the base on the floor, in its own axes, at each moment."""
    slam, first, told = SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1), None, []
    due = [round(share * (len(drive) - 1)) for share in MOMENTS]
    for k in range(len(drive)):
        result = slam.track(drive.frame(k), drive.odometry_at(k))
        if result.T_world_cam is None or result.covariance is None:
            continue
        if first is None:
            keyframe = slam.snapshot()
            at = drive.stamps_ns.index(int(keyframe.keyframe_stamps_ns[0]))
            first = keyframe.T_world_cams[0], drive.true_pose(at)
        if k >= due[0]:
            due.pop(0)
            T_base_cam = drive.T_base_cam
            estimated = (first[0] @ T_base_cam.inverse()).inverse() @ result.T_world_cam @ T_base_cam.inverse()
            true = (first[1] @ T_base_cam.inverse()).inverse() @ drive.true_pose(k) @ T_base_cam.inverse()
            error = (estimated.inverse() @ true).log()
            covariance = carried(result.covariance, T_base_cam.inverse())
            told.append((error[ON_FLOOR], covariance[np.ix_(ON_FLOOR, ON_FLOOR)]))
            if not due:
                break
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(100, 160), metavar="A-B")
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    values: list[list[float]] = []
    for seed in args.seeds:
        drive = lab_drive("loop", seed, loop_courses(), args.keep)
        if drive is None:
            continue
        told = errors(drive)
        nees = [float(e @ np.linalg.solve(P, e)) for e, P in told]
        values.append(nees)
        for (e, P), n in zip(told, nees):
            sigma = np.sqrt(np.diag(P))
            print(f"lab {seed}: off {100 * e[0]:6.2f} {100 * e[1]:6.2f} cm {np.degrees(e[2]):6.2f} deg, sigma "
                  f"{100 * sigma[0]:.2f} {100 * sigma[1]:.2f} cm {np.degrees(sigma[2]):.2f} deg, NEES {n:.2f}",
                  file=sys.stderr)  # fmt: skip
    for share, column in zip(MOMENTS, zip(*values)):
        inside = sum(BAND[0] <= n <= BAND[1] for n in column)
        of = f"{inside} of {len(column)} in the band"
        print(f"after {share:.0%} of the way: NEES {np.mean(column):.2f} (3 is right), {of}")


if __name__ == "__main__":
    main()
