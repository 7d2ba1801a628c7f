"""The emulated camera on the emulated base: optics and shutter, then the sensor with its noise, vignetting, response
curve and automatic exposure."""

import dataclasses
import math
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, GrayImage, IntArray
from vsx_ros.config import MountConfig
from vsx_ros.geometry.camera import PinholeCamera, Shutter
from vsx_ros.geometry.mount import mounted
from vsx_ros.kernels.sim.raycast_pixels import expose
from vsx_ros.sim.body import NonNegative, Positive
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.lit_surfaces import AnyScene
from vsx_ros.sim.optics import optics_of
from vsx_ros.sim.renderer import Picture, lit
from vsx_ros.sim.smear import Smear

PosesAt = Callable[[IntArray], FloatArray]
"""(N,) stamps [ns] to (N, 4 + K) x, y [m], theta [rad] and travelled path [m] of the base, and the K numbers of the
movers' states, as ``Body.poses_at``."""

KINECT = PinholeCamera(
    width=640,
    height=480,
    fx=517.3,
    fy=516.5,
    cx=318.6,
    cy=255.3,
    distortion=(0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
)
"""Colour camera of one Kinect (TUM RGB-D benchmark, sequence family fr1)."""

VIBRATION_WAVES_PER_M = np.array([7.0, 13.0, 23.0, 41.0])  # without a common period: floor joints, treads, wheels


class CameraSettings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A Kinect's colour camera: rolling shutter of 26 ms, indoor exposure, noise of its small pixels. lens: may be
    replaced by any other. readout_off_ns, exposure_off_ns: how much longer these take than the stack is told. yaw,
    place: of the mount on the floor plan. dropped_share: of the images; delay_ns: until they arrive. smeared_share: of
    the lens. samples: rays a pixel in Gazebo worlds. eye: what draws; mitsuba traces mitsuba_samples paths a pixel, in
    fifty times the time. In a world with lighting, automatic exposure reaches most_gain, and the noise grows with all
    gain above amplified_from, as the light no longer does."""

    lens: PinholeCamera = KINECT
    readout_ns: Annotated[int, Meta(ge=0)] = 26_000_000
    exposure_ns: Annotated[int, Meta(ge=0)] = 15_000_000
    readout_off_ns: int = 0
    exposure_off_ns: int = 0
    shot_noise: NonNegative = 1.2e-4
    read_noise: NonNegative = 0.004
    vignetting: NonNegative = 0.35
    response_exponent: Positive = 0.6
    target_signal: Positive = 0.30
    exposure_ramp: Annotated[float, Meta(ge=0, le=1)] = 0.15
    amplified_from: Positive = 1.2
    most_gain: Annotated[float, Meta(ge=1, le=1000)] = 24.0
    vibration_rad: NonNegative = 0.0008
    focal_error: NonNegative = 0.003
    centre_error_px: NonNegative = 1.0
    pitch_error_rad: NonNegative = 0.0087
    height_error_m: NonNegative = 0.005
    yaw_error_rad: NonNegative = 0.0
    place_error_m: NonNegative = 0.0
    dropped_share: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    delay_ns: Annotated[int, Meta(ge=0)] = 0
    smeared_share: Annotated[float, Meta(ge=0, le=0.9)] = 0.0
    samples: Annotated[int, Meta(ge=1, le=16)] = 4
    eye: Literal["raster", "mitsuba"] = "raster"
    mitsuba_samples: Annotated[int, Meta(ge=1, le=4096)] = 16


def perturbed_calibration(camera: PinholeCamera, settings: CameraSettings, rng: np.random.Generator) -> PinholeCamera:
    """A user's calibration: focal lengths and centre slightly wrong, distortion right."""
    off = rng.uniform(-1.0, 1.0, 4).tolist()
    fx, fy = camera.fx * (1.0 + settings.focal_error * off[0]), camera.fy * (1.0 + settings.focal_error * off[1])
    cx, cy = camera.cx + settings.centre_error_px * off[2], camera.cy + settings.centre_error_px * off[3]
    return dataclasses.replace(camera, fx=fx, fy=fy, cx=cx, cy=cy)


class EmulatedCamera:
    """Images from a moving base. camera_true and T_base_cam_true are the truth; the stack gets the _given ones."""

    def __init__(
        self, scene: AnyScene, mount: MountConfig, settings: CameraSettings, rng: np.random.Generator,
        threads: int = 1,
    ) -> None:  # fmt: skip
        told = Shutter(1e-9 * settings.readout_ns, 1e-9 * settings.exposure_ns)
        self._readout_ns = max(settings.readout_ns + settings.readout_off_ns, 0)
        self._exposure_ns = max(settings.exposure_ns + settings.exposure_off_ns, 0)
        shutter = Shutter(1e-9 * self._readout_ns, 1e-9 * self._exposure_ns)
        self.camera_true = camera = dataclasses.replace(settings.lens, shutter=shutter)
        self.camera_given = perturbed_calibration(dataclasses.replace(camera, shutter=told), settings, rng)
        errors = rng.uniform(-1.0, 1.0, 2) * np.array([settings.pitch_error_rad, settings.height_error_m])
        pitch_down_rad, height_m = (np.array([mount.pitch_down_rad, mount.height_m]) + errors).tolist()
        self.T_base_cam_given = mounted(mount)
        off_rng, self._loss_rng, smear_rng = rng.spawn(3)
        yaw, *place = off_rng.uniform(-1.0, 1.0, 3).tolist()
        self.T_base_cam_true = mounted(
            replace(
                mount,
                height_m=height_m,
                pitch_down_rad=pitch_down_rad,
                yaw_left_rad=mount.yaw_left_rad + yaw * settings.yaw_error_rad,
                forward_m=mount.forward_m + place[0] * settings.place_error_m,
                left_m=mount.left_m + place[1] * settings.place_error_m,
            )
        )
        self._vibration_phases = rng.uniform(0.0, 2.0 * math.pi, len(VIBRATION_WAVES_PER_M))
        self._settings = settings
        paths = settings.mitsuba_samples if settings.eye == "mitsuba" else 0
        self._renderer = optics_of(scene, camera, threads, settings.samples, paths)
        changing = isinstance(scene, DrawnWorld) and scene.changing is not None
        self._sensor = Sensor(camera, settings, rng, amplifies=changing)
        smeared = settings.smeared_share
        self._smear = Smear(camera.height, camera.width, smeared, smear_rng) if smeared else None

    def loses_image(self) -> bool:
        """Whether the next image never arrives; to be asked once for each."""
        share = self._settings.dropped_share
        return share > 0.0 and float(self._loss_rng.random()) < share

    @property
    def span_ns(self) -> int:
        """Time from the stamp until the last row is exposed [ns]; the body must have advanced that far."""
        overhang = float(self._renderer.border_rows[-1]) / self.camera_true.height
        return self._exposure_ns + math.ceil(self._readout_ns * overhang) + 1

    def render_gray(self, stamp_ns: int, poses_at: PosesAt) -> GrayImage:
        """(H, W) uint8 luminance. stamp_ns: start of the first row's exposure."""
        return self._develop(self.picture(stamp_ns, poses_at, bayer=False))

    def render_bayer(self, stamp_ns: int, poses_at: PosesAt) -> GrayImage:
        """(H, W) uint8 raw mosaic, GRBG (first row green, red), as the Kinect sends it."""
        return self._develop(self.picture(stamp_ns, poses_at, bayer=True))

    def _develop(self, picture: Picture) -> GrayImage:
        radiance = picture.radiance
        return self._sensor.develop(radiance if self._smear is None else self._smear.through(radiance))

    def picture(self, stamp_ns: int, poses_at: PosesAt, bayer: bool = False, want_depth: bool = False) -> Picture:
        """The radiance before the sensor, with true depth if wanted."""
        self._renderer.enlighten(stamp_ns)
        ends = self.poses_cam(poses_at(np.array([stamp_ns, stamp_ns + self._exposure_ns])))
        sub_frames = self._renderer.sub_frames(*ends)
        rows_ns = self._readout_ns * self._renderer.border_rows / self.camera_true.height
        middles_ns = self._exposure_ns * (np.arange(sub_frames) + 0.5) / sub_frames
        stamps = stamp_ns + np.rint(middles_ns[:, None] + rows_ns[None, :]).astype(np.int64)
        base = poses_at(stamps.ravel())
        R, t = self.poses_cam(base)
        R, t = R.reshape(*stamps.shape, 3, 3), t.reshape(*stamps.shape, 3)
        return self._renderer.render(R, t, bayer, want_depth, base[:, 4:].reshape(*stamps.shape, base.shape[1] - 4))

    def poses_cam(self, base: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations (N, 3, 3), positions (N, 3) of the camera on bases (N, 4 + K), with true mount and vibration."""
        c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
        zero, one = np.zeros_like(c), np.ones_like(c)
        yaw = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
        waves = np.sin(2.0 * math.pi * VIBRATION_WAVES_PER_M * base[:, 3:4] + self._vibration_phases)
        pitch = self._settings.vibration_rad * math.sqrt(2.0 / waves.shape[1]) * waves.sum(axis=1)
        c, s = np.cos(pitch), np.sin(pitch)
        rattle = np.stack([c, zero, s, zero, one, zero, -s, zero, c], axis=1).reshape(-1, 3, 3)
        rotations = yaw @ rattle @ self.T_base_cam_true.rotation
        positions = yaw @ self.T_base_cam_true.translation + np.column_stack([base[:, :2], zero])
        return rotations, positions


NOISE_DRAWS = 1 << 18  # drawn once; each row starts at a random one
GAIN_MIN, GAIN_MAX = 0.3, 6.0  # of the automatic exposure, in steady light


class Sensor:
    """Turns radiance into 8-bit images; stores the gain of its automatic exposure. amplifies: noise grows with it."""

    def __init__(
        self, camera: PinholeCamera, settings: CameraSettings, rng: np.random.Generator, amplifies: bool = False
    ) -> None:
        self._settings = settings
        self._most_gain = settings.most_gain if amplifies else GAIN_MAX
        self._amplified_from = settings.amplified_from if amplifies else GAIN_MAX
        self._rng = rng
        v, u = np.mgrid[0 : camera.height, 0 : camera.width]
        r2 = ((u - camera.cx) / camera.fx) ** 2 + ((v - camera.cy) / camera.fy) ** 2
        inside = lit(camera, np.column_stack([u.ravel(), v.ravel()])).reshape(u.shape)
        self._vignette = (inside / (1.0 + settings.vignetting * r2)).astype(np.float32)
        self._noise = rng.standard_normal(NOISE_DRAWS).astype(np.float32)
        signal = np.linspace(0.0, 1.0, 4096) ** settings.response_exponent
        self._response = np.rint(255.0 * signal).astype(np.uint8)
        self.gain = 1.0
        self._metered = False

    def develop(self, radiance: NDArray[np.float32]) -> GrayImage:
        """(H, W) uint8 of (H, W) radiance. The first image meets the target at once, later ones approach it."""
        settings = self._settings
        ratio = settings.target_signal / max(float(radiance[4::8, 4::8].mean()), 1e-4)
        ramp = settings.exposure_ramp if self._metered else 1.0
        self.gain = float(np.clip(self.gain * (ratio / self.gain) ** ramp, GAIN_MIN, self._most_gain))
        amplified = max(self.gain / self._amplified_from, 1.0)
        self._metered = True
        height, width = radiance.shape
        image = np.empty((height, width), np.uint8)
        starts = self._rng.integers(0, NOISE_DRAWS - width, height)
        expose(
            radiance, self._vignette, np.float32(self.gain), np.float32(settings.shot_noise * amplified),
            np.float32((settings.read_noise * amplified) ** 2), self._noise, starts, self._response, image,
        )  # fmt: skip
        return image
