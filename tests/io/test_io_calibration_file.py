import json
from dataclasses import replace

import pytest

from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera, Shutter
from vsx_ros.io.calibration_file import camera_from_info, read_calibration, write_calibration

CAMERA = PinholeCamera(640, 480, 517.306408, 516.469215, 318.643040, 255.313989, (0.26, -0.95, -0.005, 0.0026, 1.16))

AS_CAMERA_CALIBRATION_WRITES = """
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [438.78, 0.0, 305.59, 0.0, 437.34, 243.73, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.36, 0.11, 0.001, 0.0005, 0.0]
"""


def test_a_written_camera_is_read_back_exactly(tmp_path):
    rational = replace(CAMERA, distortion=(*CAMERA.distortion, 0.1, -0.2, 1 / 3), model="rational_polynomial")
    fisheye = replace(CAMERA, distortion=(0.1, -0.2, 1 / 3, 0.0), model="equidistant", shutter=Shutter(0.033, 0.008))
    for camera in (CAMERA, rational, fisheye):
        write_calibration(tmp_path / "c.yaml", camera)
        assert read_calibration(tmp_path / "c.yaml") == camera


@pytest.mark.parametrize(
    ("model", "dist", "expected"),
    [
        ("radtan", [0.1, 0.2, 0.0, 0.0], ("plumb_bob", 5)),
        ("radtan", [0.1] * 8, ("rational_polynomial", 8)),
        ("rational_polynomial", [0.1] * 8 + [0.0] * 6, ("rational_polynomial", 8)),
        ("fisheye", [0.1, 0.0, 0.0, 0.0], ("equidistant", 4)),
        ("none", [], ("plumb_bob", 5)),
        ("inverse_brown_conrady", [0.0] * 5, ("plumb_bob", 5)),
        ("Inverse Brown Conrady", [0.0] * 5, ("plumb_bob", 5)),
    ],
)
def test_models_go_by_many_names(tmp_path, model, dist, expected):
    tree = {"model": model, "width": 640, "height": 480, "fx": 300.0, "fy": 300.0, "cx": 320.0, "cy": 240.0}
    (tmp_path / "c.json").write_text(json.dumps({**tree, "dist": dist}))
    camera = read_calibration(tmp_path / "c.json")
    assert (camera.model, len(camera.distortion)) == expected
    (tmp_path / "c.json").write_text(json.dumps({**tree, "dist": [0.1] * 9}))
    with pytest.raises(CalibrationError, match=r"with 9 coefficients is not supported"):
        read_calibration(tmp_path / "c.json")


@pytest.mark.parametrize(("model", "D"), [("ftheta", [0.0] * 5), ("inverse_brown_conrady", [0.1, 0.0, 0.0, 0.0, 0.0])])
def test_a_lens_that_is_no_pinhole_is_refused_by_its_unknown_model(model, D):
    with pytest.raises(CalibrationError, match=f"model '{model}' with 5 coefficients is not supported"):
        camera_from_info(640, 480, [300.0, 0.0, 320.0, 0.0, 300.0, 240.0, 0.0, 0.0, 1.0], D, model, "c")


@pytest.mark.parametrize(
    "shutter",
    ["-1", "{readout_s: 0.03}", "{readout_s: -0.03, exposure_s: 0.01}", "{readout_s: 26.0, exposure_s: 0.01}",
     "{readout_s: 0.03, exposure_s: 0.3}"],
)  # fmt: skip
def test_a_shutter_is_two_times(tmp_path, shutter):
    (tmp_path / "c.yaml").write_text(AS_CAMERA_CALIBRATION_WRITES + f"shutter: {shutter}\n")
    with pytest.raises(CalibrationError, match="exposure_s|negative|missing"):
        read_calibration(tmp_path / "c.yaml")


def test_the_yaml_of_ros_is_read(tmp_path):
    (tmp_path / "c.yaml").write_text(AS_CAMERA_CALIBRATION_WRITES)
    camera = read_calibration(tmp_path / "c.yaml")
    assert (camera.fx, camera.cy, camera.distortion) == (438.78, 243.73, (-0.36, 0.11, 0.001, 0.0005, 0.0))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("plumb_bob", "omnidirectional", "'omnidirectional'"),
        ("[438.78, 0.0,", "[438.78,", "9 numbers, got 8"),
        (
            "438.78, 0.0, 305.59, 0.0, 437.34, 243.73, 0.0, 0.0, 1.0",
            "0, 0, 0, 0, 0, 0, 0, 0, 0",
            "vsx calibrate camera",
        ),
        ("image_width: 640", "", "'image_width'"),
        ("image_width: 640", "image_width: wide", "wide"),
        ("438.78", ".nan", "not finite"),
        ("camera_matrix:", "camera_matrix: [", "cannot be read"),
    ],
)
def test_wrong_files_are_one_sentence(tmp_path, before, after, message):
    (tmp_path / "c.yaml").write_text(AS_CAMERA_CALIBRATION_WRITES.replace(before, after))
    with pytest.raises(CalibrationError, match=message) as caught:
        read_calibration(tmp_path / "c.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"), [("c.json", "[1]"), ("c.yaml", ""), ("c.json", "{"), ("c.json", '{"width": 3}')]
)
def test_files_of_something_else_are_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match=name):
        read_calibration(tmp_path / name)
    with pytest.raises(CalibrationError, match="absent"):
        read_calibration(tmp_path / "absent.yaml")


def test_a_file_that_is_not_there_is_to_be_made(tmp_path):
    with pytest.raises(CalibrationError, match="there is no calibration .*; 'vsx calibrate camera' makes one"):
        read_calibration(tmp_path / "c.yaml")
