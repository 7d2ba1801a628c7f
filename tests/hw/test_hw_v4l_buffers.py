"""Buffers of a kernel camera: which images are taken, and how many a second."""

import queue
import threading
import time

import cv2
import numpy as np
import pytest
from hw_scripted_capture import ScriptedCapture
from waiting import PATIENCE_S

from vsx_hw import v4l
from vsx_hw.v4l import V4lCamera, V4lMode, set_up


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
