"""Calibrations and mounts that cannot be are refused by name, before a frame is tracked."""

import dataclasses
import math

import numpy as np
import pytest
from spoilt_drives import CONFIG

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam


@pytest.mark.parametrize("kind", [SequentialSlam, ThreadedSlam])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx": 5.0, "fy": 5.0}, "view of 178 deg"),
        ({"fx": 5e4, "fy": 5e4}, "view of 0.733 deg"),
        ({"fy": 5000.0}, "focal lengths"),
        ({"cx": -5000.0}, "principal point"),
        ({"distortion": (5.0, -100.0, 0.0, 0.0, 0.0)}, "distortion"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused_at_once(arc_drive, kind, change, words):
    camera = dataclasses.replace(arc_drive.camera, **change)
    with pytest.raises(CalibrationError, match=words):
        kind(camera, arc_drive.T_base_cam, CONFIG)


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        (np.eye(3), [math.nan, 0.0, 0.3], "not finite"),
        (np.full((3, 3), math.nan), [0.0, 0.0, 0.3], "not finite"),
        (2.0 * np.eye(3), [0.0, 0.0, 0.3], "no rotation"),
        (-np.eye(3), [0.0, 0.0, 0.3], "no rotation"),
        (np.eye(3), [-90.0, 0.0, 310.0], "in metres"),
    ],
)
def test_a_mount_that_cannot_be_is_refused_at_once(arc_drive, rotation, translation, words):
    with pytest.raises(CalibrationError, match=words):
        SequentialSlam(arc_drive.camera, SE3(rotation, np.array(translation)), CONFIG)


def test_a_calibration_of_another_size_is_refused_with_the_first_image(arc_drive):
    camera = dataclasses.replace(arc_drive.camera, width=1280, height=960)
    slam = SequentialSlam(camera, arc_drive.T_base_cam, CONFIG)
    with pytest.raises(InputError, match="640x480 does not fit the calibration for 1280x960"):
        slam.track(*arc_drive.frames[0][:2])
