"""Camera calibration files: ROS camera_info YAML (as camera_calibration writes it) and the plain camera.json."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vsx_ros.config import OdometryConfig
from vsx_ros.errors import CalibrationError, InputError, explained, reason_of
from vsx_ros.geometry import lens
from vsx_ros.geometry.camera import PinholeCamera, Shutter
from vsx_ros.io.atomic import write_text
from vsx_ros.limits import DAMAGE, file_text, json_tree, yaml_tree

_MODELS = dict.fromkeys(("plumb_bob", "radtan", "radial-tangential", "pinhole", ""), lens.PLUMB_BOB)
_MODELS |= dict.fromkeys(("rational_polynomial", "rational"), lens.RATIONAL)
_MODELS |= dict.fromkeys(("equidistant", "fisheye", "kannala_brandt"), lens.EQUIDISTANT)
# Of RealSense cameras: each is a pinhole while its coefficients are 0. A fisheye's model would not be.
_PINHOLES = ("none", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady")
_FORMATS = "a ROS camera_info YAML or a camera.json"


def camera_from_topic(
    image_topic: str, size: tuple[int, int], K: Sequence[float], D: Sequence[float], P: Sequence[float], model: str,
    name: str,
) -> PinholeCamera | None:  # fmt: skip
    """The camera of the images of a topic, from the sensor_msgs/CameraInfo beside them. Where the images are rectified,
    it is a pinhole with P, 12 numbers; otherwise see ``camera_from_info``."""
    if is_rectified(image_topic) and any(P):
        K, D, model = [*P[:3], *P[4:7], *P[8:11]], (), ""
    return camera_from_info(*size, K, D, model, name)


def is_rectified(image_topic: str) -> bool:
    """Whether ROS calls the images of a topic rectified: rect or rectified is a word of the name, as in
    image_rect_color."""
    words = image_topic.removesuffix("/compressed").rpartition("/")[2].split("_")
    return not {"rect", "rectified"}.isdisjoint(words)


def camera_from_info(
    width: int, height: int, K: Sequence[float], D: Sequence[float], model: str, name: str
) -> PinholeCamera | None:
    """The camera of a sensor_msgs/CameraInfo's fields; None if K is all zero, which means uncalibrated in ROS. K: 9
    numbers, row by row. D: the model's coefficients (``geometry.lens``); zeros at the end may be missing. name: its
    name in error messages. Raises CalibrationError for an unsupported lens model or impossible values."""
    k, d = [float(value) for value in K], [float(value) for value in D]
    if len(k) != 9:
        raise CalibrationError(f"{name}: the camera matrix needs 9 numbers, got {len(k)}; calibrate the camera again")
    if not any(k):
        return None
    is_pinhole = not any(d) and model.lower().replace(" ", "_") in _PINHOLES
    known = lens.PLUMB_BOB if is_pinhole else _MODELS.get(model, "")
    known = lens.RATIONAL if known == lens.PLUMB_BOB and any(d[5:]) else known
    count = lens.COEFFICIENTS.get(known, 0)
    if not known or any(d[count:]):
        raise CalibrationError(
            f"{name}: distortion model {model!r} with {len(d)} coefficients is not supported; calibrate with "
            "plumb_bob (5), rational_polynomial (8) or equidistant (4)"
        )
    coefficients = tuple((d + [0.0] * count)[:count])
    fx, _, cx, _, fy, cy, *_ = k
    try:
        return PinholeCamera(
            width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy, distortion=coefficients, model=known
        )
    except CalibrationError as error:
        raise CalibrationError(f"{name}: {error}") from error


def read_calibration(path: Path) -> PinholeCamera:
    """The camera of a camera_info YAML or a camera.json; the content decides which. Raises CalibrationError when the
    file is missing, malformed, uncalibrated or of an unsupported lens model."""
    with explained(CalibrationError, f"calibration {path} cannot be read", f"give {_FORMATS}"):
        if not path.exists():
            raise CalibrationError(f"there is no calibration {path}; 'vsx calibrate camera' makes one")
        text = file_text(path)
        tree = json_tree(text) if path.suffix == ".json" else yaml_tree(text)
    if not isinstance(tree, dict):
        raise CalibrationError(f"calibration {path} holds no names; give {_FORMATS}")
    try:
        camera = _camera_of(tree, f"calibration {path}")
    except DAMAGE as error:
        if isinstance(error, CalibrationError):
            raise
        raise CalibrationError(
            f"calibration {path}: entry {reason_of(error)} is missing or malformed; give a ROS camera_info YAML "
            "(image_width, image_height, camera_matrix, distortion_coefficients) or a camera.json (width, height, "
            "fx, fy, cx, cy, dist)"
        ) from error
    if camera is None:
        raise CalibrationError(f"calibration {path} is all zero (uncalibrated); run 'vsx calibrate camera'")
    return camera


def _camera_of(tree: dict[str, Any], name: str) -> PinholeCamera | None:
    if "camera_matrix" in tree:
        size = int(tree["image_width"]), int(tree["image_height"])
        K, D = tree["camera_matrix"]["data"], tree["distortion_coefficients"]["data"]
        camera = camera_from_info(*size, K, D, str(tree.get("distortion_model", "plumb_bob")), name)
    else:
        K = [tree["fx"], 0.0, tree["cx"], 0.0, tree["fy"], tree["cy"], 0.0, 0.0, 1.0]
        size = int(tree["width"]), int(tree["height"])
        camera = camera_from_info(*size, K, tree.get("dist", []), str(tree.get("model", "pinhole")), name)
    if camera is None or "shutter" not in tree:
        return camera
    times = tree["shutter"]
    return replace(camera, shutter=Shutter(float(times["readout_s"]), float(times["exposure_s"])))


def shutter_from_topic(times: Sequence[float], topic: str) -> Shutter | None:
    """Readout and exposure [s] as the camera node publishes them, None for no times. Raises CalibrationError if they
    are invalid."""
    numbers = [float(time) for time in times]
    if not numbers:
        return None
    if len(numbers) != len(Shutter._fields) or not Shutter(*numbers).is_possible:
        raise CalibrationError(f"topic {topic} holds {numbers[:5]}; it must be readout and exposure in seconds")
    return Shutter(*numbers)


def factors_from_topic(factors: Sequence[float], topic: str) -> OdometryConfig:
    """The factors in the odometry, of distance and turn, as mobile_base publishes them. Raises InputError if they are
    invalid."""
    numbers = [float(factor) for factor in factors]
    if len(numbers) != 2 or not all(0.0 < number < math.inf for number in numbers):
        raise InputError(f"topic {topic} holds {numbers[:5]}; it must be the factors of distance and turn")
    return OdometryConfig(*numbers)


def write_calibration(path: Path, camera: PinholeCamera, camera_name: str = "camera", remark: str = "") -> None:
    """Write a camera_info YAML that ROS's tools read; only this stack reads its shutter. remark: comment on top."""
    tree = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera_name,
        "camera_matrix": _matrix(camera.K),
        "distortion_model": camera.model,
        "distortion_coefficients": _matrix(np.array([camera.distortion])),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.column_stack([camera.K, np.zeros(3)])),
    }
    if camera.shutter is not None:
        tree["shutter"] = camera.shutter._asdict()
    comment = "".join(f"# {line}\n" for line in remark.splitlines())
    write_text(path, comment + yaml.safe_dump(tree, sort_keys=False, default_flow_style=None), durable=True)


def _matrix(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": [float(v) for v in values.ravel()]}
