"""Pyramid, corners, small images, patches: geometry between levels and promises about input."""

import cv2
import numpy as np
import pytest

from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se3 import so3_exp
from vsx_ros.kernels.vision.fast import fast_corners
from vsx_ros.vision.corners import CornerDetector, dense_corners, indexed, strongest
from vsx_ros.vision.patch_search import cast_rays, cut_patches
from vsx_ros.vision.pyramid import Pyramid, build_pyramid, from_level, rotation_between, small_image, to_level

CAMERA = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)


def noise_image(scale=4, seed=0):
    coarse = np.random.default_rng(seed).uniform(0, 255, (480 // scale, 640 // scale)).astype(np.float32)
    return np.clip(cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_CUBIC), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size", [(480, 640), (480, 752), (241, 323)])
def test_levels_are_means_of_two_by_two(size):
    image = np.random.default_rng(1).integers(0, 255, size, np.uint8)
    pyramid = build_pyramid(image)
    assert (pyramid.level(0) == image).all()
    for level in (1, 2, 3):
        fine, coarse = pyramid.level(level - 1).astype(float), pyramid.level(level)
        h, w = coarse.shape
        assert (h, w) == (size[0] >> level, size[1] >> level)
        mean = fine[: 2 * h, : 2 * w].reshape(h, 2, w, 2).mean(axis=(1, 3))
        assert np.abs(coarse - mean).max() <= 0.5


def test_a_small_image_has_the_scale_of_the_pyramid_also_where_rows_are_left_over():
    row = np.arange(540)
    image = np.repeat(((row // 8) * 3).astype(np.uint8)[:, None], 960, axis=1)
    small = small_image(build_pyramid(image))
    assert np.diff(small[3:-3, 30]) == pytest.approx(np.full(len(small) - 7, 6.0), abs=0.05)


@pytest.mark.parametrize(
    "image",
    [np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.float32), np.zeros((20, 20), np.uint8), None, "x"],
)
def test_what_is_no_grey_image_is_refused(image):
    with pytest.raises(InputError, match="image"):
        build_pyramid(image)


def test_level_coordinates_keep_the_pixel_centre():
    uv = np.array([[100.0, 37.5], [0.0, 0.0]])
    for level in range(4):
        assert from_level(to_level(uv, level), level) == pytest.approx(uv)
    assert to_level(np.array([[0.5, 0.5]]), 1) == pytest.approx(np.zeros((1, 2)))


@pytest.mark.parametrize("many", [0, 1, 40])
def test_every_row_begins_where_a_search_finds_it(many):
    table = np.array([[0, 12, 20, 0], [240, 6, 10, 13], [300, 3, 5, 20], [315, 1, 2, 24]])
    rng = np.random.default_rng(many)
    levels = []
    for _, height, width, _ in table:
        found = np.column_stack([rng.integers(0, width, many), np.sort(rng.integers(0, height, many))])
        levels.append(found.astype(np.int32))
    rows = [k * many + np.searchsorted(found[:, 1], np.arange(table[k, 1] + 1)) for k, found in enumerate(levels)]
    corners = indexed(levels, Pyramid(np.zeros(0, np.uint8), table))
    assert corners.row_table.tolist() == np.concatenate(rows).tolist()


@pytest.mark.compiled
def test_row_table_finds_every_corner_of_a_row():
    pyramid = build_pyramid(noise_image())
    corners = CornerDetector().detect(pyramid)
    assert len(corners.positions) == sum(corners.counts)
    start = 0
    for level in range(4):
        own = corners.positions[start : start + corners.counts[level]]
        first, height = int(pyramid.table[level, 3]), int(pyramid.table[level, 1])
        for row in range(0, height, 7):
            a, b = corners.row_table[first + row], corners.row_table[first + row + 1]
            assert sorted(map(tuple, corners.positions[a:b])) == sorted(map(tuple, own[own[:, 1] == row]))
        start += corners.counts[level]


@pytest.mark.compiled
def test_corner_counts_settle_near_their_targets():
    detector, rich = CornerDetector(), build_pyramid(noise_image(4) // 2)
    first = detector.detect(rich).counts[0]
    for _ in range(40):
        settled = detector.detect(rich).counts[0]
    assert settled < first
    assert 650 < settled < 2600


LARGE = [pytest.param(size, marks=pytest.mark.compiled) for size in ((480, 640), (480, 752), (241, 323))]


@pytest.mark.parametrize("size", [*LARGE, (96, 128), (12, 16), (5, 9)])
@pytest.mark.parametrize("threshold", [5, 20, 80])
def test_corners_are_those_of_opencv(size, threshold):
    noise = np.random.default_rng(3).integers(0, 256, size, np.uint8)
    image = cv2.resize(noise_image(5), size[::-1], interpolation=cv2.INTER_AREA)
    image[: size[0] // 3] = noise[: size[0] // 3]
    expected = cv2.KeyPoint.convert(cv2.FastFeatureDetector.create(threshold, False).detect(image))
    assert fast_corners(image, threshold).tolist() == np.array(expected, np.int32).reshape(-1, 2).tolist()


@pytest.mark.compiled
def test_faint_noise_gives_no_corners():
    grain = np.random.default_rng(5).normal(0.0, 1.5, (480, 640))
    dark = build_pyramid(np.clip(8.0 + grain, 0, 255).astype(np.uint8))
    detector = CornerDetector()
    for _ in range(40):
        found = detector.detect(dark)
    assert found.counts[0] < 130
    assert sum(found.counts[1:]) == 0


@pytest.mark.compiled
def test_dense_corners_meet_their_targets_at_once_whatever_the_contrast():
    for contrast in (1, 2, 6):
        counts = np.array(dense_corners(build_pyramid(noise_image(4) // contrast), 2600).counts)
        assert (np.abs(np.log(counts / [2600, 1400, 700, 350])) < np.log(1.5)).all()
        assert all(count > 100 for count in counts)


def test_no_corner_on_black():
    assert len(CornerDetector().detect(build_pyramid(np.zeros((480, 640), np.uint8))).positions) == 0
    assert strongest(np.zeros((480, 640), np.uint8), np.zeros((480, 640), np.bool_), 50).shape == (0, 2)


def test_strongest_corners_keep_their_distance_and_the_mask():
    image, occupied = noise_image(), np.zeros((480, 640), np.bool_)
    occupied[:, :320] = True
    chosen = strongest(image, occupied, 150, spacing_px=12)
    assert 50 < len(chosen) <= 150
    assert (chosen[:, 0] >= 320).all()
    gaps = np.abs(chosen[:, None] - chosen[None]).max(axis=2) + 100 * np.eye(len(chosen), dtype=int)
    assert gaps.min() > 12


@pytest.mark.parametrize("omega", [(0.0, 0.04, 0.0), (0.03, -0.02, 0.0), (0.0, 0.02, 0.05), (0.0, 0.0, 0.0)])
def test_rotation_is_read_from_small_images(omega):
    scene = cv2.GaussianBlur(noise_image(40), (0, 0), 9)
    R = so3_exp(np.array(omega))
    turned = cv2.warpPerspective(
        scene, CAMERA.K @ R @ np.linalg.inv(CAMERA.K), (640, 480), borderMode=cv2.BORDER_REFLECT
    )
    a, b = small_image(build_pyramid(scene)), small_image(build_pyramid(turned))
    assert a.shape == (30, 40)
    assert abs(float(a.mean())) < 1e-3
    found, score = rotation_between(a, b, CAMERA.focal_px)
    error = np.linalg.norm(cv2.Rodrigues(found @ R.T)[0])
    assert error < 0.006
    assert score < 0.2 * float(a.var())


def test_a_tilt_is_read_with_the_vertical_focal_length():
    scene = noise_image(40)
    a, b = (small_image(build_pyramid(np.ascontiguousarray(scene[row : row + 416]))) for row in (32, 0))
    found, _ = rotation_between(a, b, (525.0, 0.75 * 525.0))
    tilt = cv2.Rodrigues(found)[0].ravel()
    assert tilt[0] == pytest.approx(-32.0 / (0.75 * 525.0), rel=0.03)
    assert np.abs(tilt[1:]).max() < 0.003


def test_rays_and_patches_belong_to_their_corner():
    pyramid = build_pyramid(noise_image())
    positions = np.array([[30, 40], [60, 25]], np.int32)
    rays, basis = cast_rays(kernel_camera(CAMERA), positions, 1)
    expected = CAMERA.unproject(from_level(positions.astype(float), 1))[:, :2]
    assert rays == pytest.approx(expected, abs=1e-9)
    assert basis == pytest.approx(np.tile([2 / 525.0, 0, 0, 2 / 525.0], (2, 1)), abs=1e-9)
    patches = cut_patches(pyramid, positions, 1)
    assert patches.shape == (2, 24, 24)
    assert (patches[0] == pyramid.level(1)[28:52, 18:42]).all()


def test_a_level_smaller_than_a_patch_has_none():
    pyramid = build_pyramid(noise_image()[:180, :320])
    assert pyramid.level(3).shape == (22, 40)
    assert cut_patches(pyramid, np.zeros((0, 2), np.int32), 3).shape == (0, 24, 24)
