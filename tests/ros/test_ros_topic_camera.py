"""A camera with a driver of its own: where its calibration is, and what its messages must be."""

import pytest

pytest.importorskip("rospy")

import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vsx_ros.errors import InputError
from vsx_ros.ros import images, topic_camera
from vsx_ros.ros.topic_camera import TopicCamera, image_of, info_topic


def test_the_calibration_is_looked_for_beside_the_images() -> None:
    assert info_topic("/usb_cam/image_raw") == "/usb_cam/camera_info"
    assert info_topic("/cam/rgb/image_raw/compressed") == "/cam/rgb/camera_info"
    assert info_topic("/image_raw") == "/camera_info"
    assert info_topic("cam/image_raw") == "cam/camera_info"
    assert info_topic("image_raw") == info_topic("image_raw/compressed") == "camera_info"


@pytest.mark.parametrize(
    ("topic", "images_of", "info"),
    [
        ("image_raw", "/robot2/image_raw", "/robot2/camera_info"),
        ("image_raw", "/usb_cam/image_rect", "/usb_cam/camera_info"),
        ("~image_raw", "/robot2/camera/image_raw", "/robot2/camera/camera_info"),
        ("/cam/image_raw/compressed", "/cam/image_raw/compressed", "/cam/camera_info"),
    ],
)
def test_the_calibration_is_that_beside_the_images_as_their_name_is_resolved(
    topic: str, images_of: str, info: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a namespace, or remapped; another camera's may be on the global topic."""
    heard = list[str]()
    monkeypatch.setattr(topic_camera, "subscribe", lambda name, *_, **__: heard.append(rospy.resolve_name(name)))

    def resolved(name: str) -> str:
        return {topic: images_of}.get(name, name if name.startswith("/") else f"/robot2/{name}")

    monkeypatch.setattr(rospy, "resolve_name", resolved)
    camera = TopicCamera(topic, lambda _: None)
    camera.start()
    assert heard == [info, images_of]
    assert camera.rectified is images_of.endswith("rect")


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [("/cam/image_rect_color", True), ("/cam/image_rect/compressed", True), ("/rect/image_raw", False)],
)
def test_rectified_images_are_not_undistorted_again(
    topic: str, rectified: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    info = CameraInfo(width=640, height=480, distortion_model="plumb_bob", D=[-0.3, 0.1, 0.0, 0.0, 0.0])
    info.K = [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0]
    info.P = [520.0, 0.0, 310.0, 0.0, 0.0, 540.0, 235.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    camera = TopicCamera(topic, lambda _: None)
    camera._on_info(info)
    seen = camera.calibration
    assert seen is not None
    expected = (520.0, 540.0, 310.0, 235.0) if rectified else (600.0, 601.0, 320.0, 240.0)
    assert (seen.fx, seen.fy, seen.cx, seen.cy) == expected
    assert any(seen.distortion) is not rectified
    info.P = [0.0] * 12
    camera._on_info(info)
    assert camera.calibration is not None
    assert camera.calibration.fx == 600.0, "nobody has told P"


def test_a_topic_of_another_kind_or_a_damaged_message_is_named() -> None:
    with pytest.raises(InputError, match=r"/scan carries sensor_msgs/LaserScan; give a topic of sensor_msgs/Image"):
        image_of("sensor_msgs/LaserScan", b"", "/scan", images.Frames())
    for kind in (Image, CompressedImage):
        with pytest.raises(InputError, match="/cam"):
            image_of(kind._type, b"\x01\x02", "/cam", images.Frames())
