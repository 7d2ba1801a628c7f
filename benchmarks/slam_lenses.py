"""The same loops seen by other cameras: all lens models, 320 x 240 to 1280 x 720, fields of view up to 180 degrees."""

import math
from dataclasses import replace
from pathlib import Path

import msgspec
from slam_accuracy import Row, loop_courses, note, run
from slam_drives import EMULATION, lab_drive

from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.lens import EQUIDISTANT, RATIONAL
from vsx_ros.sim.camera import KINECT

LOOP_M = 8.0  # shorter than in ``loops``, because many cameras drive it
MUST, AIM = 2.0, 1.2  # factors on the Kinect's error in the same lab


def scaled(camera: PinholeCamera, ratio: float, width: int, height: int) -> PinholeCamera:
    """The same lens on a sensor of another size, with its centre at the same relative position."""
    cx, cy = (0.5 * (n - 1) + ratio * (c - 0.5 * (m - 1)) for n, c, m in (
        (width, camera.cx, camera.width), (height, camera.cy, camera.height)))  # fmt: skip
    return replace(camera, width=width, height=height, fx=ratio * camera.fx, fy=ratio * camera.fy, cx=cx, cy=cy)


def fisheye(view_deg: float) -> PinholeCamera:
    """640 x 480, with this angle between left and right border."""
    focal = 640.0 / math.radians(view_deg)
    return PinholeCamera(640, 480, focal, focal, 321.0, 238.0, (-0.012, 0.006, -0.004, 0.0006), EQUIDISTANT)


WIDE = (0.199416, -0.207364, 0.000704, 0.000806, 0.047875)  # of a real camera with 113 degrees
EIGHT = (4.1, 1.7, 2e-4, -1e-4, 0.07, 4.45, 3.1, 0.42)  # similar to the colour lens of a time-of-flight camera
CAMERAS = {
    "kinect": KINECT,
    "320x240": scaled(KINECT, 0.5, 320, 240),
    "1280x720": scaled(KINECT, 2.0, 1280, 720),
    "radtan wide": PinholeCamera(640, 480, 210.2, 211.5, 318.5, 252.5, WIDE),
    "rational": PinholeCamera(640, 480, 310.0, 309.0, 320.0, 241.0, EIGHT, RATIONAL),
    "fisheye 120": fisheye(120.0),
    "fisheye 150": fisheye(150.0),
    "fisheye 180": fisheye(180.0),
}


def lenses(seeds: range, keep: Path | None) -> list[Row]:
    """Once around 8 m at 2 cm per frame with each camera."""
    ate = {name: list[float]() for name in CAMERAS}
    ratio = {name: list[float]() for name in CAMERAS}
    for seed in seeds:
        for name, camera in CAMERAS.items():
            config = msgspec.structs.replace(EMULATION, camera=msgspec.structs.replace(EMULATION.camera, lens=camera))
            drive = lab_drive(f"lens_{name.replace(' ', '_')}", seed, loop_courses(LOOP_M), keep, config)
            if drive is None:
                continue
            done = run(drive)
            ate[name].append(100.0 * done.ate_m())
            ratio[name].append(ate[name][-1] / ate["kinect"][-1])
            note(
                f"{name} {seed}: {len(drive)} frames, ATE {ate[name][-1]:.2f} cm, lost {done.lost()}, "
                f"{done.keyframes} keyframes"
            )
    rows = [Row(f"loop of 8 m, {name}: ATE", "cm", None, None, values) for name, values in ate.items()]
    others = {name: values for name, values in ratio.items() if name != "kinect"}
    return rows + [Row(f"loop of 8 m, {name}: times the Kinect's", "", MUST, AIM, v) for name, v in others.items()]
