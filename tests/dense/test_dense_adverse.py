"""Scenes that deceive: skirting boards, pictures that repeat, a floor that shines, thin legs."""

import dataclasses

import numpy as np
import wall_scene as scene

from vsx_ros.config import DenseConfig, GroundMapConfig, RobotConfig
from vsx_ros.dense.photoconsistency import KeyframeImages, Views, judge
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.dense.region_growing import floor_contact
from vsx_ros.kernels.dense.plane_fits import in_plane_axes
from vsx_ros.occupancy.grid import OCCUPIED
from vsx_ros.occupancy.ground_map import GroundMap

CONFIG = DenseConfig()
NORMAL = np.array([-1.0, 0.0, 0.0])
COLUMNS = np.arange(-10, 10)
MIDDLES = (COLUMNS + 0.5) * 0.08
INSIDE, BESIDE = np.abs(MIDDLES) < 0.25, (np.abs(MIDDLES) > 0.35) & (np.abs(MIDDLES) < 0.7)
FLOOR = scene.floor(grey=90.0, contrast=15.0, seed=1)
HALVES = ((-3.0, -0.3), (0.3, 3.0))


def plane_at(x: float) -> Plane:
    return Plane(
        1, NORMAL, -x, np.zeros((3, 3)), PlaneKind.WALL, in_plane_axes(NORMAL), np.zeros(4), np.zeros(0, np.int64)
    )


def views_of(pictures: list[np.ndarray]) -> Views:
    snapshot = scene.snapshot([FLOOR], scene.DRIVE, np.zeros((0, 3)))
    return KeyframeImages(scene.CAMERA).views(dataclasses.replace(snapshot, images=tuple(pictures)), len(pictures))


def taken(world: list[scene.Rectangle]) -> list[np.ndarray]:
    return [scene.picture(world, pose) for pose in scene.DRIVE]


def upside_down(piece: scene.Rectangle) -> scene.Rectangle:
    """The mirror image of a wall in the floor."""
    return piece._replace(
        up=(0.0, 0.0, -1.0), right=(0.0, 1.0, 0.0), corner=(piece.corner[0], piece.corner[1] - piece.size[0], 0.0)
    )


def test_a_skirting_board_is_where_the_wall_meets_the_floor_and_keeps_the_gap_open() -> None:
    walls = [scene.wall(2.0, a, b, 1.5, grey=90.0, contrast=0.0, seed=0) for a, b in HALVES]
    boards = [scene.wall(1.99, a, b, 0.08, grey=200.0, contrast=0.0, seed=0) for a, b in HALVES]
    behind = scene.wall(4.5, -5.0, 5.0, 1.5, grey=90.0, contrast=0.0, seed=0)
    touches = floor_contact(views_of(taken([FLOOR, *walls, *boards, behind])), plane_at(2.0), COLUMNS, CONFIG).touches
    assert not touches[INSIDE].any()
    assert touches[BESIDE].mean() > 0.9


def test_a_shining_floor_fills_no_gap() -> None:
    walls = [scene.wall(2.0, a, b, 1.5, grey=170.0, contrast=0.0, seed=0) for a, b in HALVES]
    walls.append(scene.wall(4.5, -5.0, 5.0, 1.5, grey=40.0, contrast=0.0, seed=0))
    matt, mirrored = taken([FLOOR, *walls]), taken([upside_down(piece) for piece in walls])
    shining = [np.where(b > 0, 0.75 * a + 0.25 * b, a).astype(np.uint8) for a, b in zip(matt, mirrored)]
    touches = floor_contact(views_of(shining), plane_at(2.0), COLUMNS, CONFIG).touches
    assert not touches[INSIDE].any()
    assert touches[BESIDE].mean() > 0.7


def test_pictures_that_repeat_are_found_where_they_hang_and_not_before_the_wall() -> None:
    row = [scene.wall(2.5, y, y + 0.4, 1.5, grey=120.0, contrast=70.0, seed=5) for y in np.arange(-3.0, 3.0, 0.4)]
    views = views_of(taken([FLOOR, *row]))

    def share(x: float) -> float:
        cells = np.stack([np.repeat(np.arange(-6, 6), 6), np.tile(np.arange(3, 9), 12)], axis=1)
        plane = plane_at(x)
        centres = plane.points_at((cells + 0.5) * CONFIG.cell_m)
        said = judge(views, np.vstack([plane.axes, plane.normal]), centres, CONFIG, 1.0)
        return float(said.consistent(CONFIG).mean())

    assert share(2.5) > 0.8
    assert share(1.9) < 0.05
    assert share(2.2) < 0.05


def test_a_thin_leg_that_many_keyframes_see_beside_is_an_obstacle() -> None:
    leg = np.array([[1.5, 0.02, 0.1], [1.52, 0.0, 0.25], [1.5, 0.0, 0.4]])
    behind = np.column_stack([np.full(60, 3.0), np.linspace(-0.6, 0.6, 60), np.full(60, 0.02)])
    behind = behind[np.abs(behind[:, 1]) > 0.08]
    points = np.vstack([leg, behind])
    keyframe, point = (
        np.repeat(np.arange(len(scene.DRIVE)), len(points)),
        np.tile(np.arange(len(points)), len(scene.DRIVE)),
    )
    grid = GroundMap(GroundMapConfig(), RobotConfig()).build(scene.DRIVE, points, keyframe, point)
    assert OCCUPIED in {grid.value_at(1.51, 0.01), grid.value_at(1.49, 0.01)}
