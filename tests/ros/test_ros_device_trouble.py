"""A device that is missing is named even when its node's warning was lost."""

import pytest

pytest.importorskip("rospy")

from diagnostic_msgs.msg import DiagnosticStatus

from vsx_ros.ros.logs import ERROR, OK
from vsx_ros.ros.monitor import DeviceTrouble

MISSING = "no such port; plug the base in"


def said(trouble, message=MISSING, level=ERROR, name="mobile_base: link", times=1):
    told = [trouble.heard(DiagnosticStatus(level, name, message, "/dev/ttyUSB9", [])) for _ in range(times)]
    return [line for line in told if line is not None]


def test_a_missing_device_is_told_once_in_the_words_of_its_node():
    assert said(DeviceTrouble("/"), times=10) == [f"mobile_base: /dev/ttyUSB9: {MISSING}"]
    assert said(DeviceTrouble("/"), f"/dev/ttyUSB9: {MISSING}", times=10) == [f"mobile_base: /dev/ttyUSB9: {MISSING}"]


def test_a_link_that_is_being_made_is_no_trouble():
    trouble = DeviceTrouble("/")
    assert said(trouble, "not started", times=2) == []
    assert said(trouble, "no images", times=2) == []
    assert said(trouble, "connected", OK, times=10) == []


def test_another_trouble_is_told_anew():
    trouble = DeviceTrouble("/")
    assert len(said(trouble, times=4)) == 1
    assert said(trouble, "permission denied", times=4) == ["mobile_base: /dev/ttyUSB9: permission denied"]


def test_other_robots_and_components_are_not_ours():
    trouble = DeviceTrouble("/robot1/")
    assert said(trouble, times=5) == []
    assert said(trouble, name="robot1/camera: calibration", times=5) == []
    assert said(trouble, name="robot1/camera: stream", times=5) == [f"robot1/camera: /dev/ttyUSB9: {MISSING}"]
