"""How exactly the camera mount is found from one straight drive.

PYTHONPATH=src:hw:benchmarks python benchmarks/calibration.py [--seeds 100-109]

Generated labs with the standard emulator: lens known only to 0.3 % and 1 px, rolling shutter, blur, noise, wheels and
gyro wrong by up to 0.5 % and 0.3 %, slip. The camera's pose differs for each seed: pitch up to 8 deg, yaw up to 5 deg,
0.25 to 0.5 m high. It prints the errors of 'vsx calibrate mount'. The height error includes the effect of the wheels'
scale error. Everything repeats exactly.
"""

import argparse
import math

import msgspec
import numpy as np
from slam_drives import Leg, clearest_start

from vsx_ros.calibration.mount import TrackedPose, calibrate_mount
from vsx_ros.config import MountConfig, RobotConfig, SlamConfig
from vsx_ros.errors import InputError
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.slam.slam import SequentialSlam

WAY_M, SPEED_M_S, RATE_HZ = 2.0, 0.15, 15.0


def errors(seed: int) -> tuple[float, float, float | None, str]:
    """Errors of pitch and yaw [deg] and height [mm, None if not found], and the verdict."""
    rng = np.random.default_rng(seed)
    pitch, yaw = math.radians(8.0) * rng.uniform(-1.0, 1.0), math.radians(5.0) * rng.uniform(-1.0, 1.0)
    mount = MountConfig(pitch_down_rad=pitch, yaw_left_rad=yaw, height_m=rng.uniform(0.25, 0.5))
    world = generate_world("lab", seed)
    world = msgspec.structs.replace(world, start=clearest_start(world, [Leg(WAY_M)])[1])
    robot = EmulatedRobot(world, seed, robot=RobotConfig(mount=mount))
    slam, drive = SequentialSlam(robot.camera_given, None, SlamConfig(), seed), []
    for k in range(round((WAY_M / SPEED_M_S + 1.0) * RATE_HZ)):
        moves = 0.5 * RATE_HZ < k < (WAY_M / SPEED_M_S + 0.5) * RATE_HZ
        frame, odometry = robot.step(VelocityCommand(SPEED_M_S, 0.0) if moves else STOP)
        result = slam.track(frame)
        if result.state.tracked and result.T_world_cam is not None:
            drive.append(TrackedPose(odometry.T_odom_base, result.T_world_cam))
    found = calibrate_mount(drive, slam.snapshot().points_world, mount.forward_m, mount.left_m)
    ahead = robot.T_base_cam_true.rotation.T @ [1.0, 0.0, 0.0]
    off_pitch = math.degrees(found.pitch_down - math.atan2(-ahead[1], ahead[2]))
    off_yaw = math.degrees(found.yaw_left - math.asin(ahead[0]))
    height = float(robot.T_base_cam_true.translation[2])
    return off_pitch, off_yaw, 1e3 * (found.floor.height - height) if found.floor else None, str(found.verdict)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="100-109", help="of labs, robots and mounts")
    first, last = map(int, parser.parse_args().seeds.split("-"))
    rows = []
    for seed in range(first, last + 1):
        try:
            pitch, yaw, height, verdict = errors(seed)
        except InputError as error:
            print(f"{seed}: refused: {error}", flush=True)
            continue
        rows.append((abs(pitch), abs(yaw), math.nan if height is None else abs(height)))
        text = "none" if height is None else f"{height:+.1f} mm"
        print(f"{seed}: pitch {pitch:+.2f} deg, yaw {yaw:+.2f} deg, height {text}; {verdict}", flush=True)
    for name, of in (("median", np.nanmedian), ("worst", np.nanmax)):
        pitch, yaw, height = of(np.array(rows), axis=0)
        print(f"{name} of {len(rows)}: pitch {pitch:.2f} deg, yaw {yaw:.2f} deg, height {height:.1f} mm")


if __name__ == "__main__":
    main()
