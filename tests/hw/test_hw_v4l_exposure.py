"""Exposure of a kernel camera, locked and let go."""

import queue

import cv2
import numpy as np
import pytest
from hw_scripted_capture import ScriptedCapture
from waiting import PATIENCE_S

from vsx_hw import v4l
from vsx_hw.v4l import V4lCamera, V4lMode, set_up
from vsx_hw.v4l_exposure import lock

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
