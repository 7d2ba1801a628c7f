"""Patches: scores against NumPy, alignment and search against known shifts."""

import cv2
import numpy as np
import pytest

from vsx_ros.kernels.vision.patches import best_pixel, quantize, refine, zmssd
from vsx_ros.kernels.vision.search import search, warp_template, warp_templates
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.patch_search import cut_patches, target_of
from vsx_ros.vision.pyramid import build_pyramid


@pytest.fixture(scope="module")
def texture():
    rng = np.random.default_rng(3)
    coarse = rng.uniform(0, 255, (60, 80)).astype(np.float32)
    return np.clip(cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC), 0, 255)


def shifted(texture, dx, dy):
    moved = cv2.warpAffine(texture, np.float32([[1, 0, dx], [0, 1, dy]]), (320, 240), flags=cv2.INTER_CUBIC)
    return np.rint(np.clip(moved, 0, 255)).astype(np.uint8)


def template_at(image, x, y):
    pyramid = build_pyramid(image)
    patch = cut_patches(pyramid, np.array([[x, y]], np.int32), 0)[0]
    template, core = np.empty((10, 10), np.int32), np.empty(64, np.int32)
    assert warp_template(patch, np.zeros(2), np.array([1.0, 0.0, 0.0, 1.0]), template)
    return template, core, quantize(template, core)


def test_zmssd_is_the_variance_of_the_difference(texture):
    image = shifted(texture, 0, 0)
    _, core, contrast = template_at(image, 100, 80)
    window = image[56:64, 146:154].astype(float)
    difference = window - core.reshape(8, 8)
    expected = ((difference - difference.mean()) ** 2).sum()
    pixels = build_pyramid(image).pixels
    assert zmssd(pixels, 56 * 320 + 146, 320, core) == pytest.approx(expected, rel=1e-9)
    own = core.astype(float)
    assert contrast == pytest.approx(((own - own.mean()) ** 2).sum(), rel=1e-9)


def test_zmssd_ignores_brightness(texture):
    image = shifted(texture, 0, 0) // 2
    _, core, contrast = template_at(image, 100, 80)
    brighter = build_pyramid((image + 40).astype(np.uint8)).pixels
    assert zmssd(brighter, 76 * 320 + 96, 320, core) == pytest.approx(0.0, abs=1e-6)


def test_template_outside_its_patch_is_refused():
    template = np.empty((10, 10), np.int32)
    assert not warp_template(np.zeros((24, 24), np.uint8), np.zeros(2), np.array([3.0, 0.0, 0.0, 3.0]), template)


@pytest.mark.parametrize("shift", [(0.4, -0.3), (0.0, 0.5), (-0.7, 0.6)])
def test_refinement_finds_the_subpixel_shift(texture, shift):
    template, *_ = template_at(shifted(texture, 0, 0), 150, 120)
    pixels = build_pyramid(shifted(texture, *shift)).pixels
    ok, x, y, rest = refine(pixels, np.array([0, 240, 320, 0]), template, 150.0, 120.0)
    assert ok
    assert (x - 150, y - 120) == pytest.approx(shift, abs=0.08)
    assert rest < 2000


def test_refinement_gives_up_on_a_blank_wall():
    blank = np.full((10, 10), 16 * 90, np.int32)
    assert not refine(np.full(240 * 320, 90, np.uint8), np.array([0, 240, 320, 0]), blank, 150.0, 120.0)[0]


def test_best_pixel_is_the_exhaustive_minimum(texture):
    _, core, contrast = template_at(shifted(texture, 0, 0), 150, 120)
    pyramid = build_pyramid(shifted(texture, 2, -1))
    score, x, y = best_pixel(target_of(pyramid, CornerDetector().detect(pyramid)), 0, 150.2, 119.7, 3, core)
    assert (x, y) == (152, 119)
    assert score < 500


@pytest.mark.compiled
@pytest.mark.parametrize("reach", [0, 3])
def test_search_finds_shifted_points_and_rejects_foreign_ones(texture, reach):
    first, second = build_pyramid(shifted(texture, 0, 0)), build_pyramid(shifted(texture, 2.3, -1.4))
    detected = CornerDetector().detect(first)
    corners = detected.positions[: detected.counts[0]]
    inside = ((corners > 30) & (corners < [290, 210])).all(axis=1)
    corners = corners[inside][::9]
    n = len(corners)
    patches = cut_patches(first, corners, 0)
    patches[::2] = patches[::2][:, ::-1, ::-1]
    warped, usable = warp_templates(patches, np.zeros((n, 2)), np.arange(n), np.tile([1.0, 0.0, 0.0, 1.0], (n, 1)))
    found, position = search(
        target_of(second, CornerDetector().detect(second)),
        warped,
        usable,
        np.zeros(n, np.int64),
        corners.astype(float),
        6.0,
        reach,
    )
    true, foreign = found[1::2], found[::2]
    assert true.mean() > (0.95 if reach else 0.6)
    assert foreign.mean() < 0.3
    error = position[1::2][true] - corners[1::2][true] - [2.3, -1.4]
    assert np.abs(np.median(error, axis=0)).max() < 0.08
    assert np.percentile(np.linalg.norm(error, axis=1), 90) < 0.15
