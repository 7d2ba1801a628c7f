"""Blur is told from a bare wall, from a change of light and from noise."""

import cv2
import numpy as np
import pytest

from vsx_ros.vision.pyramid import BlurDetector, build_pyramid, sharpness


def scene(k=0):
    """A wall of random rectangles, shifted by k px, with sensor noise."""
    rng = np.random.default_rng(1)
    image = np.full((480, 700), 120.0, np.float32)
    for x, y, w, h, grey in zip(*rng.integers([[0], [0], [8], [8], [0]], [[660], [440], [80], [80], [255]], (5, 150))):
        image[y : y + h, x : x + w] = grey
    noise = np.random.default_rng(100 + k).normal(0, 2, (480, 640))
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.6)[:, k : k + 640] + noise, 0, 255).astype(np.uint8)


def motion_blurred(image, length_px, vertical=False):
    size = (1, length_px) if vertical else (length_px, 1)
    return cv2.blur(image, size)


def verdicts(images):
    detector = BlurDetector()
    return [detector.blurred(build_pyramid(image)) for image in images]


@pytest.mark.parametrize("vertical", [False, True])
def test_a_smeared_frame_stands_out_and_its_neighbours_do_not(vertical):
    images = [scene(k) for k in range(12)]
    images[6] = motion_blurred(images[6], 9, vertical)
    assert [k for k, blurred in enumerate(verdicts(images)) if blurred] == [6]


def test_darkness_and_a_bare_wall_are_no_blur():
    steady = [scene(k) for k in range(6)]
    dimmed = [image // 2 for image in steady]
    wall = np.random.default_rng(0).normal(120, 2, (480, 640)).astype(np.uint8)
    approach = [np.where(np.arange(640) < 100 * k, wall, scene(k)).astype(np.uint8) for k in range(6)]
    assert not any(verdicts([*steady, *dimmed]))
    assert not any(verdicts([*steady, *approach]))


def test_blur_that_lasts_becomes_normal():
    images = [scene(k) for k in range(6)] + [motion_blurred(scene(k), 9) for k in range(6, 26)]
    result = verdicts(images)
    assert result[6]
    assert 4 <= sum(result) <= 8
    assert not any(result[15:])


def test_sharpness_is_taken_along_the_blur_alone():
    sharp, smeared = sharpness(build_pyramid(scene())), sharpness(build_pyramid(motion_blurred(scene(), 15)))
    assert smeared[0] < 0.3 * sharp[0]
    assert smeared[1] > 0.5 * sharp[1]
