"""Points that no adjustment determines stay where the keyframe that holds them saw them."""

import numpy as np
import pytest
from test_slam_bundle_adjustment import CAMERA, adjuster, driven_map

from vsx_ros.geometry.se3 import SE3

LOOSE = np.arange(60, 80)


def seen_by_two_alone():
    """The map of a drive in which 20 points are seen by keyframes 4 and 5 alone, first by 5, which is culled."""
    world, poses = driven_map()
    for k in set(range(8)) - {4, 5}:
        world.forget(k, np.isin(world.keyframes[k].observations.rows, LOOSE))
    world.source[LOOSE] = 5
    adjuster().adjust(world, list(range(8)), 20)
    world.cull_keyframe(5)
    return world, poses


def off_px(world, rows):
    """Median distance between points and the pixels where living keyframes saw them."""
    parts = []
    for keyframe in (world.keyframes[k] for k in world.living):
        seen = keyframe.observations.where(np.isin(keyframe.observations.rows, rows))
        there = [keyframe.T_world_cam.inverse() @ point for point in world.points[seen.rows]]
        parts += (CAMERA.project(np.array(there).reshape(-1, 3)) - seen.uv).tolist()
    return float(np.median(np.linalg.norm(parts, axis=1)))


def test_points_that_one_living_keyframe_sees_move_with_an_adjustment():
    world, poses = seen_by_two_alone()
    loose, drift = LOOSE[world.alive[LOOSE]], SE3.exp(np.array([0.0, 0.06, 0.0, 0.0, 0.0, 0.02]))
    assert len(loose) > 15
    before, least = off_px(world, loose), world.points[loose].copy()
    for k in world.living[2:]:
        world.move_keyframe(k, drift @ world.keyframes[k].T_world_cam)
    world.points[:] = drift @ world.points
    assert adjuster().adjust(world, list(range(8)), 20)
    ends = [np.linalg.norm(world.keyframes[k].T_world_cam.translation - poses[k].translation) for k in world.living]
    assert max(ends) < 0.004, "the drift is gone"
    assert off_px(world, loose) == pytest.approx(before, abs=1.0)
    assert np.linalg.norm(world.points[loose] - least, axis=1).max() < 0.02


def test_points_that_other_keyframes_determine_are_not_carried():
    world, _ = driven_map()
    world.source[:] = 5
    for k in (3, 4, 5):
        world.forget(k, np.isin(world.keyframes[k].observations.rows, LOOSE))
    where = world.points[LOOSE].copy()
    adjuster().adjust(world, [3, 4, 5], 20)
    assert np.array_equal(world.points[LOOSE], where)


def test_a_point_that_no_living_keyframe_accepts_leaves_the_map():
    world, _ = driven_map()
    for k in (1, 4, 6, 7):
        world.forget(k, world.keyframes[k].observations.rows == 5)
    world.source[5] = 2
    for k in (2, 3):
        world.cull_keyframe(k)
    for k, off in ((0, [0.0, -60.0]), (5, [60.0, 0.0])):
        world.keyframes[k].observations.ideal[world.keyframes[k].observations.rows == 5] += off
    adjuster().adjust(world, list(range(8)), 20)
    assert not world.alive[5]
