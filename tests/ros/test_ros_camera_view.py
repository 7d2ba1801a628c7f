"""The nodes that choose views and ways hear how wide the camera sees."""

from typing import Any

import pytest

pytest.importorskip("rospy")

from sensor_msgs.msg import CameraInfo

from vsx_ros.config import Config
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.view import KINECT_RAD, view_rad
from vsx_ros.ros import callbacks, images, topics


def camera(fx: float) -> PinholeCamera:
    return PinholeCamera(640, 480, fx, fx, 319.5, 239.5)


def info(fx: float) -> CameraInfo:
    return images.camera_info(camera(fx), 1, "camera")


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    heard: dict[str, Any] = {}
    monkeypatch.setattr(callbacks, "subscribe", lambda topic, _, take, **__: heard.update({topic: take}))
    monkeypatch.setattr("rospy.resolve_name", lambda name: f"/{name}")
    return heard


def test_the_view_is_told_with_each_new_calibration(heard: dict[str, Any]) -> None:
    told = list[float]()
    callbacks.hear_view(told.append)
    for fx in (700.0, 700.0, 350.0):
        heard[topics.CAMERA_INFO](info(fx))
    assert told == [view_rad(camera(700.0)), view_rad(camera(350.0))]


def test_a_mission_takes_a_kinects_view_until_it_knows_the_cameras(heard: dict[str, Any]) -> None:
    selector = Mission(Config(), lambda start, grid, clearance_m, poses: poses[:, 0]).view_selector
    callbacks.hear_view(selector.look_with)
    assert selector._config.sensor_fov_rad == KINECT_RAD
    heard[topics.CAMERA_INFO](info(350.0))
    assert selector._config.sensor_fov_rad == view_rad(camera(350.0))
