import dataclasses

import numpy as np
import pytest
import wall_scene as scene

from vsx_ros.config import DenseConfig
from vsx_ros.dense import photoconsistency
from vsx_ros.dense.photoconsistency import Judgement, KeyframeImages, judge
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.kernels.dense.surface_cells import count_passing

CONFIG = DenseConfig()
FRAME = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
FLOOR = scene.floor(grey=90.0, contrast=40.0, seed=1)


def cells_at(x: float) -> np.ndarray:
    y, z = np.meshgrid(np.arange(-0.44, 0.5, 0.08), np.arange(0.12, 0.7, 0.08))
    return np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1)


def judged(world: list[scene.Rectangle], x: float, poses: list = scene.DRIVE) -> tuple[np.ndarray, Judgement]:
    images = KeyframeImages(scene.CAMERA)
    views = images.views(scene.snapshot(world, poses, np.zeros((0, 3))), len(poses))
    said = judge(views, FRAME, cells_at(x), CONFIG, 1.0)
    return said.consistent(CONFIG), said


def textured(x: float, **look: object) -> scene.Rectangle:
    return scene.wall(x, -2.0, 2.0, 1.5, **{"grey": 130.0, "contrast": 60.0, "seed": 3, **look})


def test_a_textured_wall_is_consistent_where_it_stands() -> None:
    good, said = judged([FLOOR, textured(2.2)], 2.2)
    assert good.mean() > 0.95
    assert np.median(said.score) > 0.9
    assert (said.keyframe >= 0).all()


@pytest.mark.parametrize("plane", [pytest.param(1.7, marks=pytest.mark.compiled), 3.0])
def test_a_plane_in_the_air_before_or_behind_a_textured_wall_is_not_consistent(plane: float) -> None:
    good, _ = judged([FLOOR, textured(2.2)], plane)
    assert good.mean() < 0.05


@pytest.mark.compiled
def test_a_plain_wall_says_nothing() -> None:
    good, said = judged([FLOOR, textured(2.2, contrast=0.0)], 2.2)
    high = cells_at(2.2)[:, 2] > 0.2
    assert not good[high].any()
    assert said.texture[high].max() < 0.5


@pytest.mark.parametrize("unit", [0.02, 50.0])
def test_a_judgement_does_not_depend_on_the_unit_of_the_map(unit: float) -> None:
    images, poses, cells = KeyframeImages(scene.CAMERA), scene.DRIVE, cells_at(2.2)
    views = images.views(scene.snapshot([FLOOR, textured(2.2)], poses, np.zeros((0, 3))), len(poses))
    scaled = views._replace(t=unit * views.t, centres=unit * views.centres)
    metric, other = judge(views, FRAME, cells, CONFIG, 1.0), judge(scaled, FRAME, unit * cells, CONFIG, unit)
    assert other.score == pytest.approx(metric.score, abs=1e-6)
    assert (other.views == metric.views).all()


def test_stripes_along_the_motion_are_alike_at_every_depth_and_say_nothing() -> None:
    poses = [scene.SE3(scene.pose(0.0, 0.0, 0.0).rotation, [0.0, y, 0.4]) for y in np.linspace(-0.5, 0.5, 8)]
    good, said = judged([textured(2.2, stripes=True)], 2.2, poses)
    seen = said.score > 0.9
    assert seen.mean() > 0.5
    assert good[seen].mean() < 0.1


def test_a_keyframe_behind_the_plane_is_not_asked() -> None:
    behind = [scene.pose(4.4 - 0.1 * k, 0.2 * k - 0.5, np.pi) for k in range(6)]
    _, said = judged([textured(2.2)], 2.2, behind)
    assert (said.keyframe == -1).all()
    assert (said.views == 0).all()


def test_cells_are_not_judged_by_views_without_parallax() -> None:
    _, said = judged([FLOOR, textured(2.2)], 2.2, [scene.pose(0.01 * k, 0.0, 0.0) for k in range(6)])
    assert (said.score == -1.0).all()


def test_images_of_dead_keyframes_make_room_for_new_ones() -> None:
    images = KeyframeImages(scene.CAMERA)
    first = scene.snapshot([FLOOR], scene.DRIVE[:3], np.zeros((0, 3)))
    images.views(first, 3)
    later = scene.snapshot([textured(2.0)], scene.DRIVE[:3], np.zeros((0, 3)))
    later = type(later)(
        **{**{name: getattr(later, name) for name in later.__slots__}, "keyframe_ids": np.array([0, 2, 5])}
    )
    views = images.views(later, 3)
    assert views.slots.tolist() == [0, 2, 1]
    offset, height, width = views.table[0]
    assert (views.store[1, offset : offset + height * width].reshape(height, width) == later.images[2]).all()


def test_the_newest_culled_keyframes_are_asked_as_long_as_their_images_are_stored(monkeypatch) -> None:
    images, whole = KeyframeImages(scene.CAMERA), scene.snapshot([FLOOR], scene.DRIVE[:6], np.zeros((0, 3)))
    images.views(whole, 6)
    living = np.array([0, 5])
    thinned = dataclasses.replace(
        whole, keyframe_ids=living, T_world_cams=tuple(whole.T_world_cams[k] for k in living),
        images=tuple(whole.images[k] for k in living), all_rays=whole.rays,
    )  # fmt: skip
    views = images.views(thinned, 2)
    assert views.ids.tolist() == views.slots.tolist() == list(range(6))
    assert views.centres == pytest.approx(np.array([T.translation for T in whole.T_world_cams]))
    assert images.views(thinned, 1).ids.tolist() == [0], "the newest are not settled"
    monkeypatch.setattr(photoconsistency, "_CULLED_KEPT", 3)
    assert images.views(thinned, 2).ids.tolist() == [0, 2, 3, 4, 5]
    assert KeyframeImages(scene.CAMERA).views(thinned, 2).ids.tolist() == [0, 5], "without images"


@pytest.mark.compiled
def test_images_that_are_packed_and_loaded_again_are_the_same(monkeypatch) -> None:
    whole, images = scene.snapshot([FLOOR, textured(2.2)], scene.DRIVE, np.zeros((0, 3))), KeyframeImages(scene.CAMERA)
    views = images.loaded(images.views(whole, len(scene.DRIVE)))
    before = views.store[views.slots].copy()
    monkeypatch.setattr(photoconsistency, "_UNPACKED", 2)
    views = images.views(whole, len(scene.DRIVE))
    assert sorted(images.ids) == views.ids.tolist()
    assert np.count_nonzero(views.slots >= 0) == 2
    for rows in ([1, 5, 9], [9, 0]):
        few = images.loaded(images.views(whole, len(scene.DRIVE)).at(np.array(rows)))
        assert (few.store[few.slots] == before[few.ids]).all()
        assert len(set(few.slots.tolist())) == len(few.ids)
    every = images.loaded(views)
    assert (every.store[every.slots] == before).all()
    at_once = KeyframeImages(scene.CAMERA)
    at_once.views(whole, len(scene.DRIVE))
    assert at_once.nbytes < before.nbytes, "no more than two were ever there unpacked"


@pytest.mark.parametrize("size", [(960, 540), (1283, 723)])
def test_levels_of_stored_images_halve_exactly_also_where_rows_are_left_over(size: tuple[int, int]) -> None:
    camera = PinholeCamera(*size, 500.0, 500.0, size[0] / 2, size[1] / 2)
    image = np.random.default_rng(1).integers(0, 255, size[::-1], np.uint8)
    empty = scene.snapshot([], scene.DRIVE[:1], np.zeros((0, 3)))
    views = KeyframeImages(camera).views(dataclasses.replace(empty, images=(image,)), 1)
    finer = image
    for times, (offset, height, width) in zip((4, 2, 2, 2), views.table):
        level = views.store[0, offset : offset + height * width].reshape(height, width)
        whole = finer[: times * height, : times * width].astype(float)
        assert np.abs(level - whole.reshape(height, times, width, times).mean(axis=(1, 3))).max() <= 0.51
        finer = level


def test_stored_images_are_free_of_distortion() -> None:
    bent = PinholeCamera(640, 480, 500.0, 500.0, 310.0, 250.0, (0.2, -0.3, 0.001, 0.002, 0.0))
    v, u = np.mgrid[0:480, 0:640]
    rays = bent.unproject(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    image = np.rint(128 + 200 * rays[:, 0]).clip(0, 255).astype(np.uint8).reshape(480, 640)
    empty = scene.snapshot([], scene.DRIVE[:1], np.zeros((0, 3)))
    shown = type(empty)(**{**{name: getattr(empty, name) for name in empty.__slots__}, "images": (image,)})
    views = KeyframeImages(bent).views(shown, 1)
    offset, height, width = views.table[1]
    level = views.store[0, offset : offset + height * width].reshape(height, width).astype(float)
    column = np.arange(20, width - 20)
    x = ((column + 0.5) * 2 - 0.5 - views.K[2]) / views.K[0]
    assert np.abs(level[height // 2, column] - (128 + 200 * x)).max() < 1.5


def test_rays_to_points_behind_pass_through_the_cell_they_cross() -> None:
    votes = np.zeros((4, 4), np.int64)
    centres = np.array([[0.0, 0.0, 0.1], [0.0, 0.02, 0.1]])
    points = np.array([[4.0, -0.2, 0.1], [2.05, -0.2, 0.1], [4.0, 5.0, 0.1]])
    keyframe, point = np.array([[0, 0, 0, 1], [0, 1, 2, 0]], np.int32)
    count_passing(
        FRAME, -2.0, centres, points, keyframe, point, np.array([0.15, 0.08]), np.zeros(2, np.int64), 0.08, votes
    )
    assert votes[1, 1] == 2
    assert votes.sum() == 2
