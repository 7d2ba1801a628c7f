"""Small-image alignment against known planar motions."""

import cv2
import numpy as np
import pytest

from vsx_ros.kernels.vision.alignment import align_small


def small(angle=0.0, shift=(0.0, 0.0)):
    rng = np.random.default_rng(8)
    image = cv2.GaussianBlur(rng.uniform(0, 255, (90, 120)).astype(np.float32), (0, 0), 4)
    image = (image - image.mean()) * 10
    M = cv2.getRotationMatrix2D((59.5, 44.5), -np.degrees(angle), 1.0)
    M[:, 2] += shift
    return cv2.warpAffine(image, M, (120, 90), borderMode=cv2.BORDER_REFLECT)[30:60, 40:80].copy()


@pytest.mark.parametrize(
    ("angle", "shift"), [(0.0, (0.0, 0.0)), (0.0, (1.5, -0.8)), (0.05, (0.0, 0.0)), (-0.04, (0.7, 1.1))]
)
def test_planar_motion_is_found(angle, shift):
    tx, ty, a, score = align_small(small(), small(angle, shift), 10)
    assert (tx, ty) == pytest.approx(shift, abs=0.08)
    assert a == pytest.approx(angle, abs=0.005)
    assert score < 0.05 * float(small().var())


def test_brightness_does_not_matter():
    plain = align_small(small(), small(0.02, (0.5, 0.5)), 10)
    brighter = align_small(small(), small(0.02, (0.5, 0.5)) + np.float32(30), 10)
    assert brighter[:3] == pytest.approx(plain[:3], abs=0.01)


@pytest.mark.parametrize("gain", [0.75, 1.25])
def test_gain_does_not_matter(gain):
    plain = align_small(small(), small(0.02, (0.5, 0.5)), 10)
    lit = align_small(small(), np.float32(gain) * small(0.02, (0.5, 0.5)), 10)
    assert lit[:3] == pytest.approx(plain[:3], abs=0.02)


def test_blobs_that_stand_in_the_image_do_not_hold_it():
    """Lamps reflected by the lens: the scene moves behind them."""
    images = [small(), small(0.0, (1.2, -0.6))]
    for image in images:
        image[8:12, 5:10] = image[20:24, 28:33] = 200.0
    tx, ty, *_ = align_small(*images, 12)
    assert (tx, ty) == pytest.approx((1.2, -0.6), abs=0.2)


def test_images_that_leave_each_other_have_no_score():
    flat = np.zeros((30, 40), np.float32)
    ramp = np.tile(np.arange(40, dtype=np.float32), (30, 1))
    tx, *_, score = align_small(ramp, ramp + np.float32(0), 4)
    assert abs(tx) < 1e-6
    assert align_small(flat, flat, 4)[:3] == (0.0, 0.0, 0.0)
    assert score == pytest.approx(0.0, abs=1e-9)
