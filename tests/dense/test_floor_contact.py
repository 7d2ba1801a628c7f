import numpy as np
import pytest
import wall_scene as scene

from vsx_ros.config import DenseConfig
from vsx_ros.dense.photoconsistency import KeyframeImages
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.dense.region_growing import Contact, fill_heights, floor_contact, supported_runs
from vsx_ros.kernels.dense.plane_fits import in_plane_axes

CONFIG = DenseConfig()
NORMAL = np.array([-1.0, 0.0, 0.0])
COLUMNS = np.arange(-10, 10)
MIDDLES = (COLUMNS + 0.5) * 0.08
FLOOR = scene.floor(grey=90.0, contrast=15.0, seed=1)


def contact(world: list[scene.Rectangle], x: float = 2.0) -> Contact:
    plane = Plane(
        1, NORMAL, -x, np.zeros((3, 3)), PlaneKind.WALL, in_plane_axes(NORMAL), np.zeros(4), np.zeros(0, np.int64)
    )
    images = KeyframeImages(scene.CAMERA)
    views = images.views(scene.snapshot(world, scene.DRIVE, np.zeros((0, 3))), len(scene.DRIVE))
    return floor_contact(views, plane, COLUMNS, CONFIG)


def plain(x: float, y_from: float, y_to: float, grey: float) -> scene.Rectangle:
    return scene.wall(x, y_from, y_to, 1.5, grey=grey, contrast=0.0, seed=0)


@pytest.mark.parametrize("grey", [40.0, pytest.param(170.0, marks=pytest.mark.compiled)])
def test_a_plain_wall_touches_the_floor_and_the_gap_in_it_does_not(grey: float) -> None:
    world = [FLOOR, plain(2.0, -3.0, -0.3, grey), plain(2.0, 0.3, 3.0, grey), plain(4.5, -5.0, 5.0, grey)]
    found = contact(world)
    # The right axis points to -y.
    inside, beside = np.abs(MIDDLES) < 0.25, (np.abs(MIDDLES) > 0.35) & (np.abs(MIDDLES) < 0.7)
    assert not found.touches[inside].any()
    assert found.touches[beside].mean() > 0.9
    assert (found.keyframe[beside] >= 0).all()
    for witnesses in found.witnesses[beside & found.touches]:
        seen_from = np.array([scene.DRIVE[k].translation for k in witnesses[witnesses >= 0]])
        assert len(seen_from) > 1
        away = np.linalg.norm(seen_from[:, None] - seen_from[None], axis=2) + 9.0 * np.eye(len(seen_from))
        assert away.min() >= 0.3


def test_a_wall_as_bright_as_the_floor_is_not_seen_to_touch() -> None:
    assert contact([FLOOR, plain(2.0, -3.0, 3.0, 90.0)]).touches.mean() < 0.05


@pytest.mark.compiled
def test_a_wall_that_stands_elsewhere_does_not_touch_here() -> None:
    assert contact([FLOOR, plain(3.2, -5.0, 5.0, 170.0)]).touches.mean() < 0.1


def test_runs_are_near_support_closed_over_one_column_and_at_least_three_long() -> None:
    touches = np.array([int(c) for c in "0110111000010000111"], bool)
    support = np.zeros(19, np.bool_)
    support[[3, 11]] = True
    expected = np.array([int(c) for c in "0111111000000000000"], bool)
    assert (supported_runs(touches, support, CONFIG) == expected).all()


def test_columns_are_filled_up_to_the_lowest_believed_cell_in_reach() -> None:
    believed = np.zeros((12, 20), np.bool_)
    believed[1, 3] = True
    believed[2, 12] = True
    runs = np.ones(12, np.bool_)
    runs[11] = False
    heights = fill_heights(believed, runs, CONFIG)
    assert heights[[0, 1, 2, 4, 5, 10, 11]].tolist() == [3, 3, 8, 3, 8, 8, 0]
