"""The camera of a bag: its topic, its calibration and its shutter."""

import cv2
import numpy as np
import pytest
from ros1_bags import SCENE, compressed, image, info, numbers, odometry, write

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.io.bag import open_recording


def test_no_image_topic_lists_what_there_is(tmp_path):
    path = write(tmp_path / "n.bag", [("/odom", odometry(1, 0.0))])
    with pytest.raises(InputError, match=r"no image topic; it has /odom \(nav_msgs/Odometry\)"):
        open_recording(path)


def test_two_cameras_must_be_chosen_between(tmp_path):
    path = write(tmp_path / "s.bag", [("/left/image", image(1)), ("/right/image", image(1, SCENE[::-1]))])
    with pytest.raises(InputError, match="--image-topic: /left/image, /right/image"):
        open_recording(path)
    chosen = open_recording(path, image_topic="right/image")
    assert np.array_equal(next(chosen.frames()).image, SCENE[::-1])


def chosen_of(path, **encodings):
    """The image topic that is found among those of the encodings, / for __ in their names."""
    pixels = {"16UC1": SCENE.astype("<u2"), "32FC1": SCENE.astype("<f4")}
    messages = [
        (name.replace("__", "/"), image(1, pixels.get(encoding, SCENE), encoding))
        for name, encoding in encodings.items()
    ]
    return open_recording(write(path, messages)).image_topic


@pytest.mark.parametrize(
    "topic", ["__r200_depth__image_raw", "__depth_camera__rgb__image_raw", "__disparity_rig__left"]
)
def test_a_camera_with_depth_in_its_name_is_one(tmp_path, topic):
    assert chosen_of(tmp_path / "a.bag", **{topic: "mono8"}) == topic.replace("__", "/")
    both = {topic: "mono8", "__r200_depth__depth__image_raw": "32FC1", "__r200_depth__depth__sw__image": "16UC1"}
    assert chosen_of(tmp_path / "b.bag", **both) == topic.replace("__", "/")


def test_depth_is_chosen_only_where_it_may_be_a_camera(tmp_path):
    assert chosen_of(tmp_path / "a.bag", __c__rgb__image="mono8", __c__depth__image="mono8") == "/c/rgb/image"
    with pytest.raises(InputError, match=r"choose one with --image-topic: /a_depth/i, /b_depth/i"):
        chosen_of(tmp_path / "b.bag", __a_depth__i="mono8", __b_depth__i="mono8")
    with pytest.raises(InputError, match=r"choose one with --image-topic: /depth_camera/rgb/i, /usb/i"):
        chosen_of(tmp_path / "c.bag", __depth_camera__rgb__i="mono8", __usb__i="mono8")
    with pytest.raises(InputError, match=r"no image topic; it has /c/depth/i \(.*can be chosen with --image-topic"):
        chosen_of(tmp_path / "d.bag", __c__depth__i="16UC1")


def test_a_topic_that_is_not_there_is_named(drive):
    with pytest.raises(InputError, match="no image topic /cam0; it has"):
        open_recording(drive, image_topic="/cam0")
    with pytest.raises(InputError, match="no odometry topic /wheels; it has"):
        open_recording(drive, odometry_topic="/wheels")


def test_a_topic_of_another_kind_is_told(tmp_path, drive):
    with pytest.raises(InputError, match=r"no image topic odom \(that is 5 messages of nav_msgs/msg/Odometry\);"):
        open_recording(drive, image_topic="odom")
    depth = compressed(1)
    depth.format = "16UC1; compressedDepth png"
    path = write(tmp_path / "d.bag", [("/depth/image/compressedDepth", depth)])
    with pytest.raises(InputError, match="has no image topic; it has /depth/image/compressedDepth"):
        open_recording(path)
    recording = open_recording(path, image_topic="/depth/image/compressedDepth")
    with pytest.raises(InputError, match="none can be used.*it is a depth image; choose the camera's topic"):
        list(recording.frames())


def test_a_calibration_that_comes_after_images_is_found(tmp_path):
    path = write(tmp_path / "l.bag", [*(("/c/image_raw", image(k)) for k in range(1, 5)), ("/c/camera_info", info())])
    assert open_recording(path).camera.fx == 30.0
    assert len(list(open_recording(path).frames())) == 4


@pytest.mark.parametrize("kind", ["png", "jpg"])
def test_compressed_colour_is_grey(tmp_path, kind):
    colours = cv2.applyColorMap(cv2.GaussianBlur(SCENE, (0, 0), 3.0), cv2.COLORMAP_JET)
    path = write(
        tmp_path / "c.bag", [("/c/image_raw/compressed", compressed(1, colours, kind)), ("/c/camera_info", info())]
    )
    recording = open_recording(path)
    [frame] = recording.frames()
    expected = cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY).astype(int)
    assert np.abs(frame.image - expected).mean() <= (1.0 if kind == "png" else 4.0)
    assert recording.camera.fx == 30.0


def test_the_only_calibration_serves_images_elsewhere(tmp_path):
    messages = [("/c/image_raw", image(1)), ("/calibration", info()), ("/wheels/odometry_filtered", odometry(1, 0.0))]
    recording = open_recording(write(tmp_path / "e.bag", messages))
    assert recording.camera.fx == 30.0
    assert recording.damage.startswith("the calibration is that of /calibration, the only one of the bag, which does")
    assert recording.odometry_topic == "/wheels/odometry_filtered"
    assert open_recording(write(tmp_path / "f.bag", [*messages, ("/other/camera_info", info())])).camera is None


@pytest.mark.parametrize("name", ["image_rect", "image_rect_color", "image_rect_raw", "rectified", "image_rectified"])
def test_rectified_images_take_the_projection(tmp_path, name):
    messages = [(f"/c/{name}", image(1)), ("/c/camera_info", info())]
    camera = open_recording(write(tmp_path / "r.bag", messages)).camera
    assert (camera.fx, camera.cx, camera.distortion) == (28.0, 15.0, (0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("name", ["image_raw", "image_color_corrected", "image_unrectified", "direct"])
def test_other_images_take_the_lens(tmp_path, name):
    messages = [(f"/c_rect/{name}", image(1)), ("/c_rect/camera_info", info())]
    camera = open_recording(write(tmp_path / "r.bag", messages)).camera
    assert (camera.fx, camera.cx, camera.distortion) == (30.0, 15.5, (0.1, 0.0, 0.0, 0.0, 0.0))


def test_an_uncalibrated_camera_is_no_camera(tmp_path):
    path = write(tmp_path / "u.bag", [("/c/camera_info", info(fx=0.0)), ("/c/image_raw", image(1))])
    assert open_recording(path).camera is None


def test_an_unknown_lens_is_refused_by_name(tmp_path):
    path = write(tmp_path / "f.bag", [("/c/camera_info", info(model="omni")), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="'omni'"):
        open_recording(path)


@pytest.mark.parametrize("wrong", [info(model="thin_prism"), info(width=0), info(D=(np.nan,) * 5)])
def test_a_calibration_that_cannot_be_used_is_not_looked_at_where_another_is_given(tmp_path, wrong):
    path = write(tmp_path / "f.bag", [("/c/camera_info", wrong), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="^topic /c/camera_info: .*, or give another with --calibration FILE$"):
        open_recording(path)
    recording = open_recording(path, own_camera=False)
    assert (recording.camera, recording.damage) == (None, "")
    assert len(list(recording.frames())) == 1


def test_calibration_of_another_size_is_refused(tmp_path):
    path = write(tmp_path / "z.bag", [("/c/camera_info", info(width=64)), ("/c/image_raw", image(1))])
    with pytest.raises(CalibrationError, match="32x24 but the calibration is for 64x24"):
        list(open_recording(path).frames())


def told_shutter(times):
    return "/camera/rgb/shutter", numbers(times)


@pytest.mark.parametrize(("times", "shutter"), [([0.026, 0.015], (0.026, 0.015)), ([], None)])
def test_the_shutter_that_the_camera_told_is_the_recordings(tmp_path, times, shutter):
    path = write(tmp_path / "a.bag", [("/camera/rgb/camera_info", info()), told_shutter(times),
                                      ("/camera/rgb/image_raw", image(1))])  # fmt: skip
    known = open_recording(path).camera.shutter
    assert known == (None if shutter is None else pytest.approx(shutter))


@pytest.mark.parametrize("times", [[0.026], [0.026, -0.1], [np.nan, 0.01], [1.0, 2.0, 3.0], [0.6, 0.015]])
def test_a_shutter_that_cannot_be_is_one_sentence(tmp_path, times):
    path = write(tmp_path / "a.bag", [("/camera/rgb/camera_info", info()), told_shutter(times),
                                      ("/camera/rgb/image_raw", image(1))])  # fmt: skip
    with pytest.raises(CalibrationError, match="readout and exposure in seconds"):
        _ = open_recording(path)
