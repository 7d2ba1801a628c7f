"""Making one point of two: keyframes look for points that the map knows from elsewhere, and what they have seen at the
same spot was the same."""

from __future__ import annotations

import numpy as np

from vsx_ros.arrays import BoolArray, IntArray, Pixels
from vsx_ros.slam.keyframe import KeyFrame
from vsx_ros.slam.map import Map, MapView
from vsx_ros.slam.point_creation import observations_at
from vsx_ros.slam.tracker import predicted
from vsx_ros.vision.patch_search import Predictions, find_patches

RADIUS_PX, REACH = 6.0, 2
SAME_PX = 2.0


def fuse(world: Map, keyframes: list[int], rows: IntArray) -> int:
    """Let keyframes (indices) see the points (rows) where they appear in them; their own points at the same spots
    become these. Returns the number of points fused."""
    votes: dict[tuple[int, int], int] = {}
    view = world.view()
    found_in = {k: _find(world.keyframes[k], view, rows) for k in keyframes}
    for k, (predictions, uv) in found_in.items():
        for mine, known in _same(world.keyframes[k], predictions, uv):
            votes[mine, known] = votes.get((mine, known), 0) + 1
    becomes: dict[int, int] = {}
    for (mine, known), _ in sorted(votes.items(), key=lambda item: (-item[1], item[0])):
        if mine not in becomes and mine not in becomes.values() and known not in becomes:
            becomes[mine] = known
    old = np.array(sorted(becomes), np.int64)
    world.replace_points(old, np.array([becomes[int(k)] for k in old], np.int64))
    for k, (predictions, uv) in found_in.items():
        unseen = ~np.isin(predictions.rows, world.keyframes[k].observations.rows)
        seen = predictions.rows[unseen], uv[unseen], predictions.level[unseen]
        keyframe = world.keyframes[k]
        world.observe(k, observations_at(keyframe.data, keyframe.T_world_cam, world.points, *seen))
    return len(old)


def same_points(keyframe: KeyFrame, rows: IntArray, uv: Pixels, level: IntArray) -> tuple[IntArray, IntArray]:
    """Points (mine, known) that a keyframe sees at the spots (uv, level) where other points (rows) were found in it."""
    observed = keyframe.observations
    if not len(rows) or not len(observed.rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    apart = np.linalg.norm(uv[:, None] - observed.uv[None], axis=2)
    near = apart.argmin(axis=1)
    tolerance = SAME_PX * 2.0 ** np.maximum(level, observed.level[near])
    same: BoolArray = (apart[np.arange(len(rows)), near] < tolerance) & (np.abs(level - observed.level[near]) <= 1)
    same &= observed.rows[near] != rows
    return observed.rows[near[same]], rows[same]


def _find(keyframe: KeyFrame, view: MapView, rows: IntArray) -> tuple[Predictions, Pixels]:
    """Where the points appear in a keyframe that does not see them yet."""
    wanted = rows[view.alive[rows] & ~np.isin(rows, keyframe.observations.rows)]
    expected = predicted(keyframe.data.camera, keyframe.T_world_cam.inverse(), view, wanted)
    templates = view.templates
    found, uv = find_patches(
        keyframe.data.pyramid, keyframe.data.corners, templates.patches, templates.offset, expected, RADIUS_PX, REACH
    )
    return expected.take(found), uv[found]


def _same(keyframe: KeyFrame, predictions: Predictions, uv: Pixels) -> list[tuple[int, int]]:
    mine, known = same_points(keyframe, predictions.rows, uv, predictions.level)
    return list(zip(mine.tolist(), known.tolist()))
