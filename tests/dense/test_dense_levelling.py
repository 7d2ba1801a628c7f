import dataclasses

import numpy as np
import pytest
from plane_scene import FOCAL_PX, angle_deg, looking, on_floor, on_wall, seen

from vsx_ros.config.maps import PlanesConfig
from vsx_ros.dense.levelling import aligned, gravity, held_up, level_of
from vsx_ros.dense.plane_finding import PlaneFinder
from vsx_ros.geometry.se3 import SE3, so3_exp
from vsx_ros.slam.snapshot import MapSnapshot

CAMERAS = [looking(0.0, 0.12 * k, 0.1 * k) for k in range(-3, 4)]
UNIT = 3.7


def somewhere(snapshot: MapSnapshot, T: SE3) -> MapSnapshot:
    """The map turned, moved and in another unit, as one without odometry is."""
    poses = tuple((T @ pose).scaled(UNIT) for pose in snapshot.T_world_cams)
    return dataclasses.replace(snapshot, T_world_cams=poses, points_world=UNIT * (T @ snapshot.points_world))


def room(rng: np.random.Generator) -> np.ndarray:
    """200 points on x = 2.5, 150 on y = 1.2, 150 on the floor."""
    walls = on_wall((2.5, -1.2), (2.5, 1.2), 200, rng), on_wall((1.0, 1.2), (2.5, 1.2), 150, rng)
    return np.vstack([*walls, on_floor(150, rng)])


@pytest.mark.parametrize("seed", range(3))
def test_a_room_is_stood_on_its_floor(seed):
    rng = np.random.default_rng(seed)
    T = SE3(so3_exp(rng.normal(size=3)), rng.normal(size=3))
    rolled = [pose @ SE3(so3_exp(np.array([0.2, 0.0, 0.1])), np.zeros(3)) for pose in CAMERAS]
    free = somewhere(seen(room(rng), rolled, rng), T)
    finder = PlaneFinder(FOCAL_PX, PlanesConfig(), False, seed)
    planes, up = finder.update(free), T.rotation @ [0.0, 0.0, 1.0]
    assert len(planes) == 3
    assert angle_deg(gravity(planes, free.T_world_cams), up) < 2.0
    level = level_of(planes, free, finder.unit)
    assert level is not None
    height = (level.T_level_world @ free.points_world[-150:])[:, 2] / UNIT
    assert np.abs(np.median(height)) < 0.02
    assert np.quantile(np.abs(height), 0.9) < 0.05
    assert level.of(free).T_world_cams[0].translation[2] * finder.unit == pytest.approx(0.3 * UNIT, abs=0.1)


def test_cameras_that_look_down_and_around_tell_up_by_their_horizon():
    down = SE3(so3_exp(np.array([-0.6, 0.0, 0.0])), np.zeros(3))
    assert (
        angle_deg(held_up([looking(0.0, 0.0, yaw) @ down for yaw in (0.0, 0.7, 1.4)]), np.array([0.0, 0.0, 1.0])) < 3.0
    )


def test_walls_and_tables_are_aligned_and_a_ramp_is_not():
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.5, np.sqrt(0.75)]])
    assert aligned(normals, np.array([0.0, 0.0, 1.0])).tolist() == [True, True, False]


def test_a_map_of_one_wall_has_no_floor():
    rng = np.random.default_rng(5)
    snapshot = seen(on_wall((2.5, -1.2), (2.5, 1.2), 200, rng), CAMERAS, rng)
    planes = PlaneFinder(FOCAL_PX, PlanesConfig(), False).update(snapshot)
    assert len(planes) == 1
    assert level_of(planes, snapshot, 1.0) is None
    assert level_of((), snapshot, 1.0) is None
