"""What the emulated machine is like: rates, errors and noise. The stack under test never sees these values."""

from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Rate = Annotated[float, Meta(ge=1, le=20)]


class BodySettings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A Kobuki by default: wheel base, encoder step and gyro step are its own; errors are half-widths or deviations."""

    wheel_base_m: Positive = 0.230
    tick_m: Positive = 0.000085292
    lag_s: Positive = 0.08
    latency_ns: Annotated[int, Meta(ge=0)] = 60_000_000
    wheel_scale_error: NonNegative = 0.005
    slip: NonNegative = 0.02
    gyro_scale_error: NonNegative = 0.003
    gyro_bias_rad_s: NonNegative = 0.0003
    gyro_step_rad: Positive = 0.00017453


class CameraSettings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A Kinect's colour camera: rolling shutter of 26 ms, indoor exposure, noise of its small pixels."""

    readout_ns: Annotated[int, Meta(ge=0)] = 26_000_000
    exposure_ns: Annotated[int, Meta(ge=0)] = 15_000_000
    shot_noise: NonNegative = 1.2e-4
    read_noise: NonNegative = 0.004
    vignetting: NonNegative = 0.35
    response_exponent: Positive = 0.6
    target_signal: Positive = 0.30
    exposure_ramp: Annotated[float, Meta(ge=0, le=1)] = 0.15
    vibration_rad: NonNegative = 0.0008
    focal_error: NonNegative = 0.003
    centre_error_px: NonNegative = 1.0
    pitch_error_rad: NonNegative = 0.0087
    height_error_m: NonNegative = 0.005


class SimulationConfig(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The whole emulated robot. frame_rate_hz applies to the lock-step robot."""

    frame_rate_hz: Rate = 15.0
    threads: Annotated[int, Meta(ge=1, le=64)] = 1
    body: BodySettings = BodySettings()
    camera: CameraSettings = CameraSettings()
