"""Kernel cameras, with a capture device that the test scripts."""

import queue

import numpy as np
import pytest

from vsx_hw.cameras import V4lCamera, open_video
from vsx_hw.errors import DeviceNotFound


class ScriptedCapture:
    def __init__(self, images: list) -> None:
        self.images = images
        self.released = False

    def read(self):
        return (True, self.images.pop(0)) if self.images else (False, None)

    def release(self) -> None:
        self.released = True


def test_bayer_stays_raw_and_colour_becomes_gray():
    color = np.full((480, 640, 3), (50, 100, 200), np.uint8)
    raw = np.arange(480 * 640, dtype=np.uint32).reshape(480, 640).astype(np.uint8)
    capture = ScriptedCapture([raw, color])
    images: queue.Queue = queue.Queue()
    camera = V4lCamera(3, images.put, lambda number: capture)
    camera.start()
    first, second = images.get(timeout=5.0), images.get(timeout=5.0)
    camera.close()
    assert (first.encoding, second.encoding) == ("bayer_grbg8", "mono8")
    np.testing.assert_array_equal(first.image, raw)
    assert second.image.shape == (480, 640)
    assert abs(int(second.image[0, 0]) - 124) <= 1
    assert second.stamp_ns >= first.stamp_ns
    assert capture.released
    assert camera.status().counters["frames"] == 2


def test_absent_device_is_named():
    with pytest.raises(DeviceNotFound, match="/dev/video97"):
        open_video(97)


def test_a_picture_that_repeats_itself_is_not_delivered():
    still, other = (np.full((480, 640), value, np.uint8) for value in (7, 8))
    images: queue.Queue = queue.Queue()
    camera = V4lCamera(3, images.put, lambda number: ScriptedCapture([still] * 9 + [other]))
    camera.start()
    delivered = [int(images.get(timeout=5.0).image[0, 0]) for _ in range(6)]
    camera.close()
    assert delivered == [7, 7, 7, 7, 7, 8]
    assert camera.status().counters["frozen_frames"] == 4
