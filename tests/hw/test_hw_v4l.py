"""Kernel cameras, with a capture device that the test scripts."""

import os
import queue
import threading
import time

import cv2
import numpy as np
import pytest
from waiting import PATIENCE_S, wait_for

from vsx_hw import v4l
from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.v4l import GRBG, MJPG, YUYV, V4lCamera, V4lMode, buffer_ns, grey, open_video, set_up
from vsx_hw.v4l_exposure import lock


class ScriptedCapture:
    def __init__(self, images: list) -> None:
        self.images = images
        self.released = False
        self.values: dict = {}
        self.refused: set = set()

    def get(self, name):
        return self.values.get(name, 0.0)

    def set(self, name, value):
        accepted = not {name, (name, value)} & self.refused
        if accepted:
            self.values[name] = value
        return accepted

    def read(self):
        return (True, self.images.pop(0)) if self.images else (False, None)

    def grab(self):
        self.taken = self.read()
        return self.taken[0]

    def retrieve(self):
        return self.taken

    def release(self) -> None:
        self.released = True


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


class UvcCapture(ScriptedCapture):
    """uvcvideo below OpenCV, in its own time: an image takes a queued buffer when it begins, or is lost as a whole.
    OpenCV holds the buffer of an image until it has decoded it. period_s: between images, of which a millisecond is a
    gap. stall: the number of the image after which the reader stands still for 0.3 s."""

    def __init__(self, period_s: float = 1 / 30, decode_s: float = 0.008, images: int = 300, stall: int = -1) -> None:
        super().__init__([])
        self.period_s, self.decode_s, self.last, self.stall = period_s, decode_s, images, stall
        self.now_s = self.start_s = 1000.0
        self.free, self.next, self.held = 4, 0, False
        self.filled: list[int] = []
        self.at_end = threading.Event()
        self.values[cv2.CAP_PROP_FPS] = 30.0

    def set(self, name, value):
        if name == cv2.CAP_PROP_BUFFERSIZE:
            self.free, self.filled, self.held = int(value), [], False
        return super().set(name, value)

    def monotonic(self):
        return self.now_s

    def time_ns(self):
        return round(1e9 * self.now_s)

    monotonic_ns = time_ns

    def begins_s(self, k):
        return self.start_s + k * self.period_s

    def wait_until(self, now_s):
        self.now_s = max(self.now_s, now_s)
        while self.begins_s(self.next) <= self.now_s:
            if self.free:
                self.free -= 1
                self.filled.append(self.next)
            self.next += 1

    def grab(self):
        if self.next >= self.last:
            self.at_end.set()
            time.sleep(0.001)
            return False
        self.free += self.held
        while not self.filled:
            self.wait_until(self.begins_s(self.next))
        self.taken = self.filled.pop(0)
        self.wait_until(self.begins_s(self.taken + 1) - 0.001)
        self.held = True
        self.values[cv2.CAP_PROP_POS_MSEC] = 1e3 * self.begins_s(self.taken)
        return True

    def retrieve(self):
        self.wait_until(self.now_s + self.decode_s + (0.3 if self.taken == self.stall else 0.0))
        self.free, self.held = self.free + 1, False
        return True, np.full((48, 64), self.taken % 251, np.uint8)


def streamed(capture: UvcCapture, monkeypatch, mode: V4lMode = V4lMode(64, 48)) -> tuple[list[float], V4lCamera]:  # noqa: B008
    """The ages [s] of the images when they were passed on."""
    monkeypatch.setattr(v4l, "time", capture)
    ages_s: list[float] = []

    def opened(number):
        capture.values |= {cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}
        set_up(capture, number, mode)
        return capture

    with V4lCamera(3, lambda reading: ages_s.append(capture.now_s - reading.stamp_ns * 1e-9), opened, mode=mode) as cam:
        assert capture.at_end.wait(PATIENCE_S)
    return ages_s, cam


@pytest.mark.parametrize("decode_s", [0.002, 0.008, 0.02])
def test_every_image_of_a_uvc_camera_is_taken_while_others_are_decoded(decode_s, monkeypatch, caplog):
    ages_s, camera = streamed(UvcCapture(decode_s=decode_s, images=600), monkeypatch)
    assert len(ages_s) >= 598
    assert max(ages_s) < 1 / 30 + decode_s
    assert camera.status().counters["passed_frames"] == 0
    assert not [r for r in caplog.records if "images a second" in r.getMessage()]


@pytest.mark.parametrize("decode_s", [0.05, 0.1])
def test_a_reader_slower_than_the_camera_gets_new_images(decode_s, monkeypatch):
    """Two older ones would wait before each."""
    ages_s, camera = streamed(UvcCapture(decode_s=decode_s), monkeypatch)
    assert max(ages_s) < 1 / 30 + v4l.LATE_US * 1e-6 + decode_s
    assert len(ages_s) >= 0.7 * 10.0 / decode_s
    assert camera.status().counters["passed_frames"] > 0


def test_images_that_waited_while_the_reader_stood_still_are_passed_over(monkeypatch):
    ages_s, camera = streamed(UvcCapture(stall=100), monkeypatch)
    assert [k for k, age_s in enumerate(ages_s) if age_s > 0.1] == [100]
    assert camera.status().counters["passed_frames"] == 2  # the third buffer is held
    assert len(ages_s) > 280


def test_a_clock_that_was_set_costs_no_images(monkeypatch):
    """Stamps of the wall clock seem old for ever after it was set."""
    capture = UvcCapture()
    monkeypatch.setattr(capture, "monotonic_ns", lambda: 0, raising=False)
    monkeypatch.setattr(capture, "time_ns", lambda: round(1e9 * (capture.now_s + 0.5 * (capture.now_s > 1005.0))))
    ages_s, camera = streamed(capture, monkeypatch)
    assert camera.status().counters["passed_frames"] == v4l.BUFFERS
    assert len(ages_s) >= 298 - v4l.BUFFERS


def test_a_driver_without_times_gets_one_buffer(monkeypatch):
    capture = ScriptedCapture([np.full((48, 64), k, np.uint8) for k in range(3)])
    images: queue.Queue = queue.Queue()
    with V4lCamera(3, images.put, lambda number: capture, mode=V4lMode(64, 48)):
        assert [int(images.get(timeout=PATIENCE_S).image[0, 0]) for _ in range(3)] == [0, 1, 2]
    assert capture.values[cv2.CAP_PROP_BUFFERSIZE] == 1


@pytest.mark.parametrize(("asked_hz", "told_hz"), [(0.0, 30.0), (60.0, 60.0)])
def test_a_rate_far_below_the_one_asked_for_is_told_once(asked_hz, told_hz, monkeypatch, caplog):
    mode = V4lMode(64, 48, asked_hz)
    streamed(UvcCapture(period_s=1 / 15, images=600), monkeypatch, mode)
    told = [r.getMessage() for r in caplog.records if "images a second" in r.getMessage()]
    assert len(told) == 1
    assert f"/dev/video3: 15 images a second instead of {told_hz:.0f}" in told[0]


AUTO_CONTROLS = (cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_AUTO_WB)


@pytest.mark.parametrize("closed", [True, False])
def test_what_one_run_locked_is_automatic_in_the_next_and_after_it(closed, monkeypatch):
    """The controls are inside the camera; a crash leaves them locked."""
    monkeypatch.setattr(v4l, "LOCK_AFTER_S", 0.0)
    controls: dict = dict(zip(AUTO_CONTROLS, (3, 1)))
    seen: queue.Queue = queue.Queue()
    first = camera_with(controls, lock_exposure=True, on_image=lambda _: seen.put(dict(controls)))
    with first:
        at_image = seen.get(timeout=PATIENCE_S)
    assert [at_image[name] for name in AUTO_CONTROLS] == [1, 0]
    assert [controls[name] for name in AUTO_CONTROLS] == [3, 1]
    if not closed:
        controls |= at_image
    with camera_with(controls, lock_exposure=False, on_image=lambda _: seen.put(dict(controls))):
        at_image = seen.get(timeout=PATIENCE_S)
    assert [at_image[name] for name in AUTO_CONTROLS] == [3, 1]


def camera_with(controls: dict, *, lock_exposure: bool, on_image) -> V4lCamera:
    """A camera of 64x48 whose controls outlive its capture."""

    def opened(number: int) -> ScriptedCapture:
        capture = ScriptedCapture([np.zeros((48, 64), np.uint8)])
        capture.values = controls
        set_up(capture, number, V4lMode(64, 48))
        return capture

    return V4lCamera(3, on_image, opened, mode=V4lMode(64, 48), lock_exposure=lock_exposure)


def test_a_camera_without_aperture_priority_gets_the_other_automatic_exposure():
    capture = ScriptedCapture([])
    capture.refused = {(cv2.CAP_PROP_AUTO_EXPOSURE, 3)}
    set_up(capture, 3, V4lMode())
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 0


def test_the_exposure_is_kept_as_it_is_or_said_not_to():
    capture = ScriptedCapture([])
    capture.values[cv2.CAP_PROP_EXPOSURE] = 157.0
    assert lock(capture) == ", exposure locked"
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
    assert (capture.values[cv2.CAP_PROP_EXPOSURE], capture.values[cv2.CAP_PROP_AUTO_WB]) == (157.0, 0)
    capture.refused = {cv2.CAP_PROP_AUTO_EXPOSURE}
    assert "cannot" in lock(capture)


@pytest.mark.parametrize("automatic", [3, 0])
def test_exposure_that_is_refused_stays_automatic(automatic):
    """Manual, but with another exposure, the images may be black."""
    capture = ScriptedCapture([])
    capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] = automatic
    capture.refused = {cv2.CAP_PROP_EXPOSURE, (cv2.CAP_PROP_AUTO_EXPOSURE, 3 - automatic)}
    assert "cannot" in lock(capture)
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == automatic
