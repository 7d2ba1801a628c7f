"""The SLAM over a bag or a TUM-layout folder, a frame at a time, and the trajectory as a TUM file.

python examples/track_a_recording.py drive.bag trajectory.txt
"""

import sys
from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.bag import open_recording
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.slam.slam import SequentialSlam


def main(recording_path: Path, trajectory_path: Path) -> None:
    recording, config = open_recording(recording_path), Config()
    if recording.camera is None:
        sys.exit(f"{recording_path} brings no calibration: see 'vsx calibrate camera'")
    T_base_cam = mounted(config.robot.mount)
    # Without odometry the map has no scale, and the world is the first camera's frame.
    slam = SequentialSlam(recording.camera, T_base_cam if recording.odometry else None, config.slam)
    poses = []
    for frame in recording.frames():
        result = slam.track(frame, recording.odometry_at(frame.stamp_ns))
        if result.state.tracked and result.T_world_cam is not None:
            poses.append(StampedPose(frame.stamp_ns, result.T_world_cam))
    write_trajectory(trajectory_path, poses)
    print(f"{len(poses)} of {recording.frame_count} frames tracked, {len(slam.snapshot().points_world)} map points")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
