"""Spots of surface keep their place beside their keyframe, whatever becomes of the map."""

import dataclasses

import numpy as np
import pytest
import wall_scene as scene

from vsx_ros.dense.cells import Cells
from vsx_ros.dense.densify import DenseMap
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.dense.plane_fits import in_plane_axes

NORMAL = np.array([-1.0, 0.0, 0.0])
CELL_M = 0.08
SNAPSHOT = scene.snapshot([scene.wall(2.0, -1.0, 1.0, 1.0, grey=120.0, contrast=50.0, seed=1)], scene.DRIVE[:3],
                          np.array([[2.0, 0.0, 0.5]]))  # fmt: skip


def dense(covariance: np.ndarray) -> DenseMap:
    """A wall at x = 2, two cells of it, seen by keyframes 0 and 2; keyframe 1 shows the foot of the second, too."""
    axes, extent = in_plane_axes(NORMAL), np.array([-1.0, 1.0, 0.0, 1.0])
    plane = Plane(4, NORMAL, -2.0, covariance, PlaneKind.WALL, axes, extent, np.array([0]))
    cell = np.array([[0, 2], [10, 2]])
    centre = plane.points_at((cell + 0.5) * CELL_M)
    one = np.zeros(2, np.int64)
    cells = Cells(one + 4, cell, centre, one, np.ones(2), np.array([0, 2]), np.array([[-1, -1], [1, 2]]))
    return DenseMap(SNAPSHOT.version, 2, (plane,), cells, True, 0)


def test_an_update_is_due_with_a_new_keyframe_or_while_work_is_left() -> None:
    found = dense(np.diag([0.0, 0.0, 1e-4]))
    assert not found.is_due(SNAPSHOT)
    assert found._replace(newest_keyframe=1).is_due(SNAPSHOT)
    assert found._replace(complete=False).is_due(SNAPSHOT)


def test_a_cell_is_four_spots_within_it_and_on_its_plane() -> None:
    found = dense(np.diag([0.0, 0.0, 1e-4]))
    spots = AnchoredSurface.of(found, SNAPSHOT, CELL_M).surfaces(SNAPSHOT)
    assert spots.keyframe.tolist() == [0, 0, 0, 0, 2, 2, 2, 2]
    assert spots.points[:, 0] == pytest.approx(2.0, abs=1e-9)
    off = (spots.points.reshape(2, 4, 3) - found.cells.centre[:, None])[..., 1:]
    assert np.abs(off) == pytest.approx(0.02, abs=1e-9)
    assert spots.sigma_m == pytest.approx(0.01)
    assert spots.shown.tolist() == 2 * [4, 5, 6, 7]
    assert spots.witness.tolist() == [1, 1, 1, 1, 2, 2, 2, 2]


def test_far_from_the_middle_a_tilt_makes_it_uncertain() -> None:
    sigma = AnchoredSurface.of(dense(np.diag([0.0, 0.1**2, 0.0])), SNAPSHOT, CELL_M).sigma_m
    assert sigma == pytest.approx(np.repeat([0.04, 0.84], 4) * 0.1, rel=1e-6)


def test_spots_follow_their_keyframe_and_go_with_it() -> None:
    spots = AnchoredSurface.of(dense(np.zeros((3, 3))), SNAPSHOT, CELL_M)
    shift = SE3.from_se2(SE2(0.2, -0.1, 0.3))
    T0, T1, T2 = SNAPSHOT.T_world_cams
    moved = spots.surfaces(dataclasses.replace(SNAPSHOT, T_world_cams=(T0, T1, shift @ T2)))
    before = spots.surfaces(SNAPSHOT).points
    assert moved.points[:4] == pytest.approx(before[:4], abs=1e-12)
    assert moved.points[4:] == pytest.approx(shift @ before[4:], abs=1e-9)
    culled = dataclasses.replace(SNAPSHOT, keyframe_ids=SNAPSHOT.keyframe_ids[1:], T_world_cams=(T1, T2))
    left = spots.surfaces(culled)
    assert left.keyframe.tolist() == [1, 1, 1, 1]
    assert left.points == pytest.approx(before[4:], abs=1e-12)
    assert (left.shown.tolist(), left.witness.tolist()) == (2 * [0, 1, 2, 3], [0, 0, 0, 0, 1, 1, 1, 1])
    without = dataclasses.replace(SNAPSHOT, keyframe_ids=SNAPSHOT.keyframe_ids[[0, 2]], T_world_cams=(T0, T2))
    assert spots.surfaces(without).witness.tolist() == [1, 1, 1, 1]
    first = dataclasses.replace(SNAPSHOT, keyframe_ids=SNAPSHOT.keyframe_ids[:2], T_world_cams=(T0, T1))
    assert not len(spots.surfaces(first).shown)
