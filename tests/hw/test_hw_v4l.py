"""Kernel cameras, with a capture device that the test scripts."""

import os
import queue
import threading
import time

import cv2
import numpy as np
import pytest
from hw_scripted_capture import ScriptedCapture
from waiting import PATIENCE_S, wait_for

from vsx_hw import v4l
from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.v4l import GRBG, MJPG, YUYV, V4lCamera, V4lMode, buffer_ns, grey, open_video, set_up


def test_bayer_stays_raw_and_colour_becomes_gray():
    color = np.full((480, 640, 3), (50, 100, 200), np.uint8)
    raw = np.arange(480 * 640, dtype=np.uint32).reshape(480, 640).astype(np.uint8)
    capture = ScriptedCapture([raw, color])
    images: queue.Queue = queue.Queue()
    camera = V4lCamera(3, images.put, lambda number: capture)
    camera.start()
    first, second = images.get(timeout=PATIENCE_S), images.get(timeout=PATIENCE_S)
    camera.close()
    assert (first.encoding, second.encoding) == ("bayer_grbg8", "mono8")
    np.testing.assert_array_equal(first.image, raw)
    assert second.image.shape == (480, 640)
    assert abs(int(second.image[0, 0]) - 124) <= 1
    assert second.stamp_ns >= first.stamp_ns
    assert capture.released
    assert camera.status().counters["frames"] == 2


def test_raw_bayer_that_comes_as_one_row_keeps_the_size_of_the_mode():
    raw = np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8)
    images: queue.Queue = queue.Queue()
    with V4lCamera(3, images.put, lambda number: ScriptedCapture([raw.reshape(1, -1)])):
        reading = images.get(timeout=PATIENCE_S)
    assert reading.encoding == "bayer_grbg8"
    np.testing.assert_array_equal(reading.image, raw)


@pytest.mark.parametrize("shape", [(1, 640 * 481), (240, 320), (240, 320, 2), (240, 320, 3)])
def test_an_image_of_another_size_is_told_with_the_remedy(shape):
    with pytest.raises(DeviceError, match=r"none of 640x480; set ~mode .*640x480/yuyv"):
        grey(np.zeros(shape, np.uint8), V4lMode())


def test_absent_device_is_named():
    with pytest.raises(DeviceNotFound, match="/dev/video97"):
        open_video(97)


def test_a_picture_that_repeats_itself_is_not_delivered():
    still, other = (np.full((480, 640), value, np.uint8) for value in (7, 8))
    images: queue.Queue = queue.Queue()
    camera = V4lCamera(3, images.put, lambda number: ScriptedCapture([still] * 9 + [other]))
    camera.start()
    delivered = [int(images.get(timeout=PATIENCE_S).image[0, 0]) for _ in range(6)]
    camera.close()
    assert delivered == [7, 7, 7, 7, 7, 8]
    assert camera.status().counters["frozen_frames"] == 4


def test_a_few_images_that_cannot_be_read_cost_only_themselves(monkeypatch):
    monkeypatch.setattr(v4l, "BACKOFF_S", (0.01,))
    opened, images = [], queue.Queue()

    class Flawed(ScriptedCapture):
        def read(self):
            image = self.images.pop(0) if self.images else None
            return image is not None, image

    def opens(number):
        new = [np.full((48, 64), 10 * len(opened) + k, np.uint8) for k in range(3)]
        opened.append(Flawed([new[0], *[None] * 9, new[1], None, new[2]]))
        return opened[-1]

    with V4lCamera(3, images.put, opens, mode=V4lMode(64, 48)) as camera:
        seen = [int(images.get(timeout=PATIENCE_S).image[0, 0]) for _ in range(4)]
        wait_for(lambda: camera.status().counters["bad_frames"] >= 20)
    assert seen == [0, 1, 2, 10], "after the tenth failed read in a row it is opened again"


def test_a_camera_that_gives_no_image_is_told_while_its_driver_waits(monkeypatch):
    monkeypatch.setattr(v4l, "SILENT_S", 0.2)
    waits = threading.Event()

    class Waiting(ScriptedCapture):
        def read(self):
            if not self.images:
                waits.wait(PATIENCE_S)
            return super().read()

    with V4lCamera(3, lambda _: None, lambda _: Waiting([np.zeros((48, 64), np.uint8)]), mode=V4lMode(64, 48)) as cam:
        wait_for(lambda: "/dev/video3: no image for 0." in cam.status().message)
        assert not cam.status().connected
        waits.set()


def test_opencv_does_not_wait_ten_seconds_for_an_image(monkeypatch):
    """Its driver could not be closed meanwhile."""
    monkeypatch.delenv("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", raising=False)
    with pytest.raises(DeviceNotFound):
        open_video(97)
    assert os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] == "1"
    monkeypatch.setenv("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "3")
    with pytest.raises(DeviceNotFound):
        open_video(97)
    assert os.environ["OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT"] == "3", "the user's own"


def test_a_camera_that_hangs_is_opened_again(monkeypatch):
    monkeypatch.setattr(v4l, "NEW_WITHIN_S", 0.2)
    monkeypatch.setattr(v4l, "BACKOFF_S", (0.01,))
    opened, images = [], queue.Queue()

    class Hanging(ScriptedCapture):
        def read(self):
            time.sleep(0.01)
            return True, self.images[0]

    def opens(number):
        opened.append(Hanging([np.full((48, 64), len(opened) // 2, np.uint8)]))
        return opened[-1]

    with V4lCamera(3, images.put, opens, mode=V4lMode(64, 48)) as camera:
        wait_for(lambda: len(opened) == 3)
        wait_for(lambda: camera.status().connected)
        assert opened[1].released
    assert images.queue[-1].image[0, 0] == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1280x720@30/mjpeg", V4lMode(1280, 720, 30.0, MJPG)),
        ("640x480/yuyv", V4lMode(640, 480, 0.0, YUYV)),
        ("320x240@7.5", V4lMode(320, 240, 7.5, GRBG)),
        ("640x480@30/h264", None),
        ("vga", None),
    ],
)
def test_modes_are_size_rate_and_format(text, expected):
    assert V4lMode.parse(text) == expected


def test_a_mode_is_asked_for_and_another_size_refused():
    capture = ScriptedCapture([])
    set_up(capture, 3, V4lMode(1280, 720, 30.0, YUYV))
    assert [capture.values[cv2.CAP_PROP_FPS], capture.values[cv2.CAP_PROP_CONVERT_RGB]] == [30.0, 0]
    colour = ScriptedCapture([])
    set_up(colour, 3, V4lMode(640, 480, 0.0, MJPG))
    assert not {cv2.CAP_PROP_FPS, cv2.CAP_PROP_CONVERT_RGB} & set(colour.values)
    capture.refused = {cv2.CAP_PROP_FRAME_WIDTH}
    with pytest.raises(DeviceError, match="gives 1280x480 instead of 640x480.*list-formats"):
        set_up(capture, 3, V4lMode())


def test_yuyv_is_its_own_grey():
    yuyv = np.random.default_rng(0).integers(0, 256, (48, 64, 2)).astype(np.uint8)
    image, encoding = grey(yuyv, V4lMode(64, 48))
    assert encoding == "mono8"
    assert np.array_equal(image, cv2.cvtColor(yuyv, cv2.COLOR_YUV2GRAY_YUY2))


def test_buffer_times_of_either_clock_become_wall_time():
    wall_ns, monotonic_ns, age_ns = 1_700_000_000_000_000_000, 5_000_000_000_000, 33_000_000
    for clock_ns in (wall_ns, monotonic_ns):
        taken_ns = buffer_ns((clock_ns - age_ns) / 1e6, wall_ns, monotonic_ns)
        assert taken_ns is not None
        assert abs(taken_ns - (wall_ns - age_ns)) < 1000  # a double holds wall time in ms to a quarter of a microsecond
    for nonsense in (0.0, -1.0, monotonic_ns / 1e6 + 40.0, monotonic_ns / 1e6 - 60_000.0):
        assert buffer_ns(nonsense, wall_ns, monotonic_ns) is None


@pytest.mark.parametrize(("buffered", "latency_s"), [(True, 0.0), (True, 0.04), (False, 0.04)])
def test_stamps_are_the_buffers_less_the_latency(buffered, latency_s):
    capture = ScriptedCapture([np.zeros((48, 64), np.uint8)])
    if buffered:
        capture.values[cv2.CAP_PROP_POS_MSEC] = time.monotonic() * 1e3 - 100.0
    images: queue.Queue = queue.Queue()
    before_ns = time.time_ns()
    camera = V4lCamera(3, images.put, lambda number: capture, mode=V4lMode(64, 48), latency_s=latency_s)
    camera.start()
    stamp_ns = images.get(timeout=PATIENCE_S).stamp_ns
    camera.close()
    off_s = (stamp_ns - before_ns) * 1e-9 + latency_s + (0.1 if buffered else 0.0)
    assert -0.01 < off_s < 5.0
    told = camera.status().counters
    assert told["unstamped_frames"] == (0 if buffered else 1)
    assert (told["waited_us"] >= 100_000) == buffered
