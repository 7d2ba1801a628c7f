"""Drives of the emulated robot, recorded into folders as a user's are into bags."""

from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec

from vsx_ros.config import MountConfig, RobotConfig
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.camera import CameraSettings
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.world import Start

SEED, START = 3, Start(x=10.48, y=3.78, theta_rad=2.59)
MOUNT = MountConfig(pitch_down_rad=0.09, yaw_left_rad=-0.05, height_m=0.38)


class Recorded(NamedTuple):
    """Where it is, the true way [m] and turn [rad] of the base, and the true mount."""

    folder: Path
    way: float
    turn: float
    T_base_cam: SE3


EXACT = CameraSettings(focal_error=0.0, centre_error_px=0.0)


def record(
    folder: Path, parts: list[tuple[float, float, float]], rate_hz: float = 10.0, error: float = 0.02,
    camera: CameraSettings = EXACT, late_ns: int = 0,
) -> Recorded:  # fmt: skip
    """Drive (v, omega, seconds) through a generated lab on wheels and gyro wrong by up to ``error``. late_ns: how much
    later than its exposure each image is stamped."""
    body = BodySettings(wheel_scale_error=error, gyro_scale_error=error)
    settings = SimulationConfig(frame_rate_hz=rate_hz, body=body, camera=camera)
    world = msgspec.structs.replace(generate_world("lab", SEED), start=START)
    robot = EmulatedRobot(world, SEED, settings, RobotConfig(mount=MOUNT))
    (folder / "rgb").mkdir(parents=True)
    names, odometry, heading, turn = [], [], START.theta_rad, 0.0
    for v, omega, seconds in [(0.0, 0.0, 0.5), *parts, (0.0, 0.0, 0.5)]:
        for _ in range(round(seconds * rate_hz)):
            seen = robot.step(VelocityCommand(v, omega))
            name = f"rgb/{len(names):06d}.png"
            cv2.imwrite(str(folder / name), seen.frame.image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            names.append(f"{(seen.frame.stamp_ns + late_ns) / 1e9:.9f} {name}")
            odometry.append(StampedPose(seen.frame.stamp_ns, SE3.from_se2(seen.odometry.T_odom_base)))
            truth = robot.truth.T_world_base
            turn, heading = turn + truth.theta - heading, truth.theta
    assert robot.truth.collisions == 0
    (folder / "rgb.txt").write_text("\n".join(names) + "\n", encoding="utf-8")
    write_trajectory(folder / "odometry.txt", odometry)
    write_calibration(folder / "camera.yaml", robot.camera_given)
    return Recorded(folder, robot.truth.path_length_m, turn, robot.T_base_cam_true)
