"""An emulated drive as a folder of images, and its replay."""

import pytest
from recorded_drive import write_camera, write_images

from vsx_ros.cli.main import execute
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.robot import VelocityCommand
from vsx_ros.runs.folder import RunFolder
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot


@pytest.fixture(scope="session")
def drive(tmp_path_factory):
    """Four seconds straight ahead in an emulated lab."""
    folder = tmp_path_factory.mktemp("drive")
    robot = EmulatedRobot(generate_world("lab", 3), 3)
    seen, odometry, truth = [], [], []
    for _ in range(60):
        frame, reading = robot.step(VelocityCommand(0.2, 0.0))
        seen.append(frame)
        odometry.append(StampedPose(reading.stamp_ns, SE3.from_se2(reading.T_odom_base)))
        truth.append(StampedPose(frame.stamp_ns, robot.truth.T_world_cam))
    write_images(folder, seen)
    write_camera(folder, robot.camera_given)
    write_trajectory(folder / "odometry.txt", odometry)
    write_trajectory(folder / "groundtruth.txt", truth)
    return folder


@pytest.fixture(scope="session")
def replayed(drive, tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "drive"
    assert execute(["replay", str(drive), "--map", "--out", str(out)]) == 0
    return RunFolder.open(out)
