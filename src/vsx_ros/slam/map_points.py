"""The points of the map: made from corners of a new keyframe, found again in others, seen from new sides, removed when
they are looked for in vain (paper 3.1)."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.config import MapperConfig
from vsx_ros.slam.keyframe import KeyFrame
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_view import MapView
from vsx_ros.slam.point_creation import (
    Candidates,
    TargetMatches,
    candidates_in,
    match_in_target,
    observations_at,
    templates_in,
    templates_of,
)
from vsx_ros.slam.tracker import predicted
from vsx_ros.vision.patch_search import Predictions, find_patches

REFIND_RADIUS_PX, UNSEEN_REACH = 4.0, 2
NEW_TEMPLATE = 0.006


class MapPoints:
    """Keyframes are given by index, points by row."""

    def __init__(self, world: Map, config: MapperConfig) -> None:
        self._world, self._config = world, config

    def enter(self, source: int, target: int, candidates: Candidates, matches: TargetMatches) -> IntArray:
        """Points found in two keyframes enter the map; returns their rows."""
        world = self._world
        rows = world.add_points(matches.points_world, templates_of(candidates, matches.chosen), source)
        chosen = matches.chosen
        self._observe(source, rows, candidates.uv[chosen], candidates.level[chosen])
        self._observe(target, rows, matches.uv, matches.level)
        return rows

    def make(self, index: int, targets: list[int]) -> IntArray:
        """Triangulate new points of a keyframe with each target in turn; returns their rows."""
        keyframe = self._world.keyframes[index]
        candidates, depth = candidates_in(keyframe, self._config.max_points_per_keyframe), keyframe.median_depth or 1.0
        rows = []
        for k in targets:
            if not len(candidates.uv):
                break
            matches = match_in_target(
                self._world.keyframes[index],
                self._world.keyframes[k],
                candidates,
                (0.15 * depth, 8.0 * depth),
                math.radians(self._config.min_parallax_deg),
            )
            rows.append(self.enter(index, k, candidates, matches))
            left = np.ones(len(candidates.uv), np.bool_)
            left[matches.chosen] = False
            candidates = candidates.where(left)
        return np.concatenate(rows) if rows else np.zeros(0, np.int64)

    def refind(self, indices: list[int], rows: IntArray) -> None:
        """Look for points in keyframes that have not seen them."""
        if not len(rows):
            return
        view = self._world.view()
        for index in indices:
            found, uv = find_unseen(self._world.keyframes[index], view, rows, REFIND_RADIUS_PX)
            self._observe(index, found.rows, uv, found.level)

    def renew_templates(self, index: int) -> None:
        """Points seen here from a direction or distance that none of their templates comes near get one more."""
        world, keyframe = self._world, self._world.keyframes[index]
        rows = keyframe.observations.rows
        known = world.templates.view()
        here = world.points[rows] - keyframe.T_world_cam.translation
        centres = np.array([k.T_world_cam.translation for k in world.keyframes])
        numbers = known.of_point[rows]
        there = world.points[rows][:, None] - centres[known.source[numbers]]
        here2, there2 = (here**2).sum(axis=1)[:, None], (there**2).sum(axis=2)
        cosine = (here[:, None] * there).sum(axis=2) / np.sqrt(here2 * there2)
        unlike = 2.0 * (1.0 - cosine) + 0.05 * np.log(there2 / here2) ** 2
        unlike[numbers < 0] = np.inf
        chosen, more = templates_in(keyframe, np.flatnonzero(unlike.min(axis=1, initial=np.inf) > NEW_TEMPLATE))
        world.templates.add(rows[chosen], more, index)

    def remove_unfound(self, searched: IntArray, found: IntArray) -> None:
        """Remove points the tracker keeps looking for in vain."""
        n = min(len(searched), self._world.count)
        bad: BoolArray = (searched[:n] >= 8) & (found[:n] < 0.25 * searched[:n]) & self._world.alive[:n]
        self._world.remove_points(np.flatnonzero(bad))

    def _observe(self, index: int, rows: IntArray, uv: FloatArray, level: IntArray) -> None:
        world, keyframe = self._world, self._world.keyframes[index]
        world.observe(index, observations_at(keyframe.data, keyframe.T_world_cam, world.points, rows, uv, level))


def find_unseen(keyframe: KeyFrame, view: MapView, rows: IntArray, radius_px: float) -> tuple[Predictions, Pixels]:
    """Those of the points (rows) that appear in a keyframe that does not see them yet, and where."""
    wanted = rows[view.alive[rows] & ~np.isin(rows, keyframe.observations.rows)]
    data, templates = keyframe.data, view.templates
    expected = predicted(data.camera, keyframe.T_world_cam.inverse(), view, wanted)
    found, uv = find_patches(
        data.pyramid, data.corners, templates.patches, templates.offset, expected, radius_px, UNSEEN_REACH
    )
    return expected.take(found), uv[found]
