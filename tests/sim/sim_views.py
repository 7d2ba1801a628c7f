"""How tests look into an emulated world."""

from collections.abc import Callable

import numpy as np

from vsx_ros.arrays import FloatArray, GrayImage, IntArray
from vsx_ros.config import MountConfig
from vsx_ros.sim.camera import CameraSettings, EmulatedCamera
from vsx_ros.sim.drawn_world import DrawnWorld
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.scene import Scene
from vsx_ros.sim.world import Material, Origin, Outline, Start, World

PERFECT = CameraSettings(
    readout_ns=0, exposure_ns=0, shot_noise=0.0, read_noise=0.0, vibration_rad=0.0, pitch_error_rad=0.0,
    height_error_m=0.0, vignetting=0.0,
)  # fmt: skip


def plain_room(**changes: object) -> World:
    """6 m x 4 m, 2.5 m high, white walls, start in the middle of the west half looking east."""
    fields: dict[str, object] = {
        "generator": Origin(name="plain", seed=0),
        "start": Start(x=1.5, y=2.0, theta_rad=0.0),
        "ceiling_height": 2.5,
        "floor": "dark",
        "ceiling": "white",
        "ambient": 1.0,
        "materials": {
            "white": Material(kind="plain", brightness=0.8),
            "dark": Material(kind="plain", brightness=0.2),
            "red": Material(kind="plain", brightness=0.6, tint=(1.0, 0.25, 0.5)),
        },
        "outlines": [Outline(points=[(0, 0), (6, 0), (6, 4), (0, 4)], height=2.5, material="white")],
    }
    return World(**{**fields, **changes})  # type: ignore[arg-type]  # fields by name


def standing(x: float, y: float, theta: float) -> Callable[[IntArray], FloatArray]:
    """Poses of a base that does not move."""
    return lambda stamps: np.repeat(np.array([[x, y, theta, 0.0]]), len(stamps), axis=0)


def camera_in(world: World | Scene, settings: CameraSettings = PERFECT, threads: int = 1) -> EmulatedCamera:
    scene = DrawnWorld(world) if isinstance(world, Scene) else scene_of(world)
    return EmulatedCamera(scene, MountConfig(), settings, np.random.default_rng(0), threads)


def still_view(world: World) -> Callable[[float, float, float], GrayImage]:
    """Noisy pictures of a base that stands at x, y, theta."""
    camera = camera_in(world, CameraSettings(exposure_ramp=1.0))
    return lambda x, y, theta: camera.render_gray(0, standing(x, y, theta))
