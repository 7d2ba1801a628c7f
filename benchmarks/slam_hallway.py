"""A real corridor with odometry, from many first frames: ``PYTHONPATH=src:hw python benchmarks/slam_hallway.py``.

The recording is part of the tests (tests/data/mononav_hallway): white walls, five noisy images a second, odometry
without tilt. For each first frame, it prints how many frames were tracked after the map's start.
"""

import sys
from pathlib import Path

import msgspec
import numpy as np

from vsx_ros.config import Config
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.slam.slam import SequentialSlam

HALLWAY = Path(__file__).resolve().parents[1] / "tests/data/mononav_hallway"
FIRST = (0, 1, 2, 3, 5, 8, 12, 16, 20)


def main() -> None:
    config, recording = Config(), open_recording(HALLWAY / "hallway.bag")
    camera, frames = read_calibration(HALLWAY / "camera.json"), list(recording.frames())
    mount = mounted(msgspec.structs.replace(config.robot.mount, height_m=1.04, forward_m=0.0))
    shares = []
    for first in FIRST:
        slam = SequentialSlam(camera, mount, config.slam, 1)
        results = [slam.track(frame, recording.odometry_at(frame.stamp_ns)) for frame in frames[first:]]
        begun = next(k for k, result in enumerate(results) if result.T_world_cam is not None)
        tracked = sum(result.state.tracked and result.found > 0 for result in results)
        shares.append(tracked / (len(results) - begun))
        print(f"from frame {first}: {tracked} of {len(results) - begun} tracked", file=sys.stderr)
    print(f"tracked of the frames after the start: {100 * np.mean(shares):.1f} %, at worst {100 * min(shares):.1f} %")


if __name__ == "__main__":
    main()
