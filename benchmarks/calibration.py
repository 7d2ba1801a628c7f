"""How exactly the camera's mount is found from one straight drive, and its shutter from one with bends.

PYTHONPATH=src:hw:benchmarks python benchmarks/calibration.py [--what mount|shutter] [--seeds 100-109]

Generated labs with the standard emulator: lens known only to 0.3 % and 1 px, rolling shutter, blur, noise, wheels and
gyro wrong by up to 0.5 % and 0.3 %, slip. mount: the camera's pose differs for each seed: pitch up to 8 deg, yaw up to
5 deg, 0.25 to 0.5 m high. The height error includes the effect of the wheels' scale error. shutter: the readout is 10
to 34 ms where the stack is told 26, images are stamped 20 ms early to 120 ms late; half a minute of bends at 0.5 rad/s.
It prints the errors of 'vsx calibrate'. Everything repeats exactly.
"""

import argparse
import math
from pathlib import Path

import msgspec
import numpy as np
from seeds import seed_range
from slam_drives import Leg, clearest_start

from vsx_ros.calibration.mount import TrackedPose, calibrate_mount
from vsx_ros.cli.calibrate_shutter import shutter_of_drive
from vsx_ros.config import Config, MountConfig, RobotConfig, SlamConfig
from vsx_ros.errors import InputError
from vsx_ros.io.recording import Recording
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.sim.camera import CameraSettings
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.slam.slam import SequentialSlam

WAY_M, SPEED_M_S, RATE_HZ = 2.0, 0.15, 15.0
BENDS_M, BENDS_S = 3.0, 32.0


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
            drive.append(TrackedPose(odometry.T_odom_base, result.T_world_cam, odometry.odom_epoch))
    found = calibrate_mount(drive, slam.snapshot().points_world, mount.forward_m, mount.left_m)
    ahead = robot.T_base_cam_true.rotation.T @ [1.0, 0.0, 0.0]
    off_pitch = math.degrees(found.pitch_down - math.atan2(-ahead[1], ahead[2]))
    off_yaw = math.degrees(found.yaw_left - math.asin(ahead[0]))
    height = float(robot.T_base_cam_true.translation[2])
    return off_pitch, off_yaw, 1e3 * (found.floor.height - height) if found.floor else None, str(found.verdict)


def shutter_errors(seed: int) -> tuple[float, float, str]:
    """Errors of latency and readout [ms], and the verdict."""
    rng = np.random.default_rng(seed)
    late_ns, off_ns = int(rng.uniform(-20e6, 120e6)), int(rng.uniform(-16e6, 8e6))
    world = generate_world("lab", seed)
    world = msgspec.structs.replace(world, start=clearest_start(world, [Leg(BENDS_M)])[1])
    robot = EmulatedRobot(world, seed, SimulationConfig(camera=CameraSettings(readout_off_ns=off_ns)))
    frames, odometry = [], []
    for k in range(round(BENDS_S * RATE_HZ)):
        seconds = k / RATE_HZ
        turn = 0.0 if seconds < 4.0 else 0.5 * math.sin(2.0 * math.pi * seconds / 4.0)
        frame, reading = robot.step(VelocityCommand(0.2 if seconds < 4.0 else 0.08, turn))
        frames.append(frame._replace(stamp_ns=frame.stamp_ns + late_ns))
        odometry.append(reading)
    drive = Recording(Path("lab"), None, None, len(frames), robot.camera_given, odometry, (), lambda: iter(frames))
    found, _ = shutter_of_drive(drive, Config())
    readout_s = robot.camera_true.shutter.readout_s
    off_s = found.latency.value - 1e-9 * late_ns, found.readout.value - readout_s
    return 1e3 * off_s[0], 1e3 * off_s[1], str(found.verdict)


def _mount(seeds: range) -> None:
    rows = []
    for seed in seeds:
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


def _shutter(seeds: range) -> None:
    rows = []
    for seed in seeds:
        latency, readout, verdict = shutter_errors(seed)
        rows.append((abs(latency), abs(readout)))
        print(f"{seed}: latency {latency:+.1f} ms, readout {readout:+.1f} ms; {verdict}", flush=True)
    for name, of in (("median", np.median), ("worst", np.max)):
        latency, readout = of(np.array(rows), axis=0)
        print(f"{name} of {len(rows)}: latency {latency:.1f} ms, readout {readout:.1f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", choices=("mount", "shutter"), default="mount")
    parser.add_argument("--seeds", type=seed_range, default=range(100, 110), help="of labs, robots and errors")
    args = parser.parse_args()
    {"mount": _mount, "shutter": _shutter}[args.what](args.seeds)


if __name__ == "__main__":
    main()
