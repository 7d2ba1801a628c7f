"""Patches: scores against NumPy, alignment and search against known shifts."""

import cv2
import numpy as np
import pytest

from vsx_ros.kernels.vision.patches import GAINS, best_pixel, quantize, refine, relit_ssd
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


def relit(window, core):
    """The same with NumPy, by least squares."""
    image, wanted = window - window.mean(), core.reshape(8, 8) / 16.0
    gain = np.clip((image * wanted).sum() / (image**2).sum(), *GAINS)
    return ((gain * image - wanted) ** 2).sum()


def test_core_is_the_patch_without_its_mean(texture):
    template, core, contrast = template_at(shifted(texture, 0, 0), 100, 80)
    inner = template[1:9, 1:9] / 16.0
    assert core.sum() == 0
    assert np.abs(core.reshape(8, 8) / 16.0 - (inner - inner.mean())).max() <= 1.0 / 16.0
    assert contrast == pytest.approx(((inner - inner.mean()) ** 2).sum(), rel=1e-3)


@pytest.mark.parametrize(("x", "y"), [(150, 60), (150, 61), (60, 150)])
def test_difference_is_what_gain_and_offset_leave(texture, x, y):
    image = shifted(texture, 0, 0)
    _, core, contrast = template_at(image, 150, 60)
    score = relit_ssd(build_pyramid(image).pixels, (y - 4) * 320 + x - 4, 320, core, contrast)
    # Template pixel (5, 5), the core's (4, 4), is the point.
    assert score == pytest.approx(relit(image[y - 4 : y + 4, x - 4 : x + 4].astype(float), core), rel=1e-6, abs=30)
    assert (score < 200) == ((x, y) == (150, 60))


@pytest.mark.parametrize(("gain", "offset"), [(1.0, 40.0), (0.75, 0.0), (1.25, -30.0), (0.5, 90.0)])
def test_light_does_not_matter(texture, gain, offset):
    image = np.clip(shifted(texture, 0, 0).astype(float) * 0.5 + 50, 0, 255).astype(np.uint8)
    lit = np.clip(np.rint(image * gain + offset), 0, 255).astype(np.uint8)
    template, core, contrast = template_at(image, 100, 80)
    pixels, layout = build_pyramid(lit).pixels, np.array([0, 240, 320, 0])
    assert relit_ssd(pixels, 76 * 320 + 96, 320, core, contrast) < 0.02 * contrast
    ok, x, y, rest = refine(pixels, layout, template, core, contrast, 100.6, 79.6)
    assert ok
    assert (x, y) == pytest.approx((100.0, 80.0), abs=0.05)
    assert rest < 0.02 * contrast


def test_a_bare_wall_is_not_a_faint_patch(texture):
    _, core, contrast = template_at(shifted(texture, 0, 0), 100, 80)
    noise = np.random.default_rng(0).normal(90.0, 2.0, (240, 320))
    wall = build_pyramid(np.rint(noise).astype(np.uint8)).pixels
    assert relit_ssd(wall, 76 * 320 + 96, 320, core, contrast) > 0.8 * contrast


def test_template_outside_its_patch_is_refused():
    template = np.empty((10, 10), np.int32)
    assert not warp_template(np.zeros((24, 24), np.uint8), np.zeros(2), np.array([3.0, 0.0, 0.0, 3.0]), template)


@pytest.mark.parametrize("shift", [(0.4, -0.3), (0.0, 0.5), (-0.7, 0.6)])
def test_refinement_finds_the_subpixel_shift(texture, shift):
    template, core, contrast = template_at(shifted(texture, 0, 0), 150, 120)
    pixels = build_pyramid(shifted(texture, *shift)).pixels
    ok, x, y, rest = refine(pixels, np.array([0, 240, 320, 0]), template, core, contrast, 150.0, 120.0)
    assert ok
    assert (x - 150, y - 120) == pytest.approx(shift, abs=0.08)
    assert rest < 2000


def test_refinement_gives_up_on_a_blank_wall():
    blank, core = np.full((10, 10), 16 * 90, np.int32), np.empty(64, np.int32)
    contrast, wall = quantize(blank, core), np.full(240 * 320, 90, np.uint8)
    assert contrast == 0.0
    assert not refine(wall, np.array([0, 240, 320, 0]), blank, core, contrast, 150.0, 120.0)[0]


def test_best_pixel_is_the_exhaustive_minimum(texture):
    _, core, contrast = template_at(shifted(texture, 0, 0), 150, 120)
    pyramid = build_pyramid(shifted(texture, 2, -1))
    score, x, y = best_pixel(target_of(pyramid, CornerDetector().detect(pyramid)), 0, 150.2, 119.7, 3, core, contrast)
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
