"""Writes what 'vsx replay' reads from a folder."""

import json

import cv2

from vsx_ros.io.trajectory_file import format_stamp


def write_camera(folder, camera):
    tree = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    (folder / "camera.json").write_text(json.dumps({**tree, "dist": list(camera.distortion)}))


def write_images(folder, images):
    (folder / "rgb").mkdir(parents=True)
    lines = []
    for number, (stamp_ns, image) in enumerate(images):
        cv2.imwrite(str(folder / f"rgb/{number:06d}.png"), image)
        lines.append(f"{format_stamp(stamp_ns)} rgb/{number:06d}.png")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
