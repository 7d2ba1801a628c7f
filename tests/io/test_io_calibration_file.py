import pytest

from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.io.calibration_file import read_calibration, write_calibration

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
    write_calibration(tmp_path / "c.yaml", CAMERA)
    assert read_calibration(tmp_path / "c.yaml") == CAMERA


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
