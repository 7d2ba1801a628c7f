"""Hard things that the emulated robot itself has: errors that nobody has told the stack of, drawn by the run's seed."""

from collections.abc import Mapping

import numpy as np
from msgspec.structs import replace

from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.camera import CameraSettings

# With robot-error=1, at most: what users' robots have.
WHEEL_SCALE_ERROR, SLIP = 0.05, 0.05
GYRO_SCALE_ERROR, GYRO_BIAS_RAD_S = 0.01, 0.001
MOUNT_ERROR_RAD, MOUNT_ERROR_M = 0.035, 0.02  # 2 degrees
READOUT_OFF_NS = -1_000_000, 4_000_000  # 25 to 30 ms of a Kinect, which is believed to take 26
EXPOSURE_OFF_NS = -5_000_000, 5_000_000
NOISE_FACTOR = 2.0  # and its inverse


def body_in(things: Mapping[str, float], settings: BodySettings) -> BodySettings:
    """The settings of the base among these hard things."""
    if error := things.get("robot-error", 0.0):
        settings = replace(
            settings,
            wheel_scale_error=max(error * WHEEL_SCALE_ERROR, settings.wheel_scale_error),
            slip=max(error * SLIP, settings.slip),
            gyro_scale_error=max(error * GYRO_SCALE_ERROR, settings.gyro_scale_error),
            gyro_bias_rad_s=max(error * GYRO_BIAS_RAD_S, settings.gyro_bias_rad_s),
        )
    return replace(settings, sticks_every_s=things.get("sticky-wheel", settings.sticks_every_s))


def camera_in(things: Mapping[str, float], seed: int, settings: CameraSettings) -> CameraSettings:
    """The settings of the camera among these hard things."""
    if error := things.get("robot-error", 0.0):
        rng = np.random.default_rng([seed, 402])
        noise, rattle = (NOISE_FACTOR ** (error * rng.uniform(-1.0, 1.0, 2))).tolist()
        settings = replace(
            settings,
            readout_off_ns=round(error * rng.uniform(*READOUT_OFF_NS)),
            exposure_off_ns=round(error * rng.uniform(*EXPOSURE_OFF_NS)),
            shot_noise=noise * settings.shot_noise,
            read_noise=noise * settings.read_noise,
            vibration_rad=rattle * settings.vibration_rad,
            pitch_error_rad=error * MOUNT_ERROR_RAD,
            yaw_error_rad=error * MOUNT_ERROR_RAD,
            height_error_m=error * MOUNT_ERROR_M,
            place_error_m=error * MOUNT_ERROR_M,
        )
    return replace(
        settings,
        dropped_share=0.01 * things.get("dropped-frames", 100.0 * settings.dropped_share),
        delay_ns=round(1e6 * things.get("latency", 1e-6 * settings.delay_ns)),
        smeared_share=things.get("fingerprints", settings.smeared_share),
    )
