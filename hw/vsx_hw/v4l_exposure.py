"""Exposure and white balance of a kernel camera: automatic, or locked as they are.

Source: Linux media documentation, "Camera control reference"."""

from typing import Any

import cv2

MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
AUTOMATIC_EXPOSURES = (3, 0)  # V4L2_EXPOSURE_APERTURE_PRIORITY, which most webcams have, or V4L2_EXPOSURE_AUTO


def unlock(capture: Any) -> None:
    """Automatic exposure and white balance, where the camera has them. A camera keeps what was locked, also after a
    crash."""
    _expose_automatically(capture)
    capture.set(cv2.CAP_PROP_AUTO_WB, 1)


def _expose_automatically(capture: Any) -> None:
    any(capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, automatic) for automatic in AUTOMATIC_EXPOSURES)


def lock(capture: Any) -> str:
    """Lock exposure and white balance; exposure that cannot be locked as it is stays automatic. Returns the result as
    words to append to "streaming"."""
    exposure = capture.get(cv2.CAP_PROP_EXPOSURE)
    kept = capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE) and capture.set(cv2.CAP_PROP_EXPOSURE, exposure)
    if not kept:
        _expose_automatically(capture)
    capture.set(cv2.CAP_PROP_AUTO_WB, 0)  # many cameras have none
    return ", exposure locked" if kept else ", exposure cannot be locked"
