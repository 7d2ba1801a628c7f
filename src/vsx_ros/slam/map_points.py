"""Maintains the map. Points: made from corners of a new keyframe, found in others, given new templates, removed when
they are rarely found (paper 3.1). Keyframes: culled where a place was passed many times (after Mur-Artal et al.,
ORB-SLAM, T-RO 2015, VI.E)."""

import math

import numpy as np
from msgspec.structs import replace

from vsx_ros.arrays import FloatArray, IntArray, Pixels
from vsx_ros.config.maps import CullingConfig, MapperConfig
from vsx_ros.slam.keyframe import KeyFrame, MapView
from vsx_ros.slam.map import Map
from vsx_ros.slam.point_creation import (
    Candidates,
    TargetMatches,
    candidates_in,
    match_in_target,
    observations_at,
    templates_in,
)
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.slam.tracker import predicted
from vsx_ros.slam.tracking_record import is_hopeless
from vsx_ros.vision.patch_search import Predictions, find_patches

REFIND_RADIUS_PX, UNSEEN_REACH = 4.0, 2  # small, as poses are known; level px searched without corners
NEW_TEMPLATE = 0.006  # squared angle [rad2]: a change of 4.4 deg in direction or of a fifth in distance
# A keyframe with fewer points is kept: little else constrains it. So is one without which only odometry would connect
# its neighbours in its segment.
ASSESSED_POINTS, TIED_POINTS = 40, 40


class MapPoints:
    """Keyframes are given by index, points by row."""

    def __init__(self, world: Map, config: MapperConfig) -> None:
        self._world, self._config = world, config

    def enter(self, source: int, target: int, candidates: Candidates, matches: TargetMatches) -> IntArray:
        """Add points found in two keyframes to the map; returns their rows."""
        chosen = matches.chosen
        looks = NewTemplates(candidates.basis[chosen], np.zeros((len(chosen), 2)), candidates.patches[chosen])
        rows = self._world.add_points(matches.points_world, looks, source)
        observe_at(self._world, source, rows, candidates.uv[chosen], candidates.level[chosen])
        observe_at(self._world, target, rows, matches.uv, matches.level)
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
        """Search keyframes for points that they have not seen."""
        if not len(rows):
            return
        view = self._world.live_view()
        for index in indices:
            found, uv = find_unseen(self._world.keyframes[index], view, rows, REFIND_RADIUS_PX)
            observe_at(self._world, index, found.rows, uv, found.level)

    def renew_templates(self, index: int) -> None:
        """Add a template to points seen here from a direction or distance unlike that of all their templates."""
        world, keyframe = self._world, self._world.keyframes[index]
        rows = keyframe.observations.rows
        view = world.live_view()
        known, centres = view.templates, view.centres
        here = world.points[rows] - keyframe.T_world_cam.translation
        numbers = known.of_point[rows]
        there = world.points[rows][:, None] - centres[known.source[numbers]]
        here2, there2 = (here**2).sum(axis=1)[:, None], (there**2).sum(axis=2)
        cosine = (here[:, None] * there).sum(axis=2) / np.sqrt(here2 * there2)
        unlike = 2.0 * (1.0 - cosine) + 0.05 * np.log(there2 / here2) ** 2
        unlike[numbers < 0] = np.inf
        chosen, more = templates_in(keyframe, np.flatnonzero(unlike.min(axis=1, initial=np.inf) > NEW_TEMPLATE))
        world.templates.add(rows[chosen], more, index)

    def remove_unfound(self, searched: IntArray, found: IntArray) -> None:
        """Remove points that the tracker searches often and rarely finds."""
        n = min(len(searched), len(self._world.points))
        bad = is_hopeless(searched[:n], found[:n]) & self._world.alive[:n]
        self._world.remove_points(np.flatnonzero(bad))


def observe_at(world: Map, index: int, rows: IntArray, uv: FloatArray, level: IntArray) -> None:
    """Add observations of points (rows) to a keyframe (uv (N, 2) level-0 px, level (N,))."""
    keyframe = world.keyframes[index]
    world.observe(index, observations_at(keyframe.data, keyframe.T_world_cam, world.points, rows, uv, level))


def find_unseen(keyframe: KeyFrame, view: MapView, rows: IntArray, radius_px: float) -> tuple[Predictions, Pixels]:
    """The points (rows) found in a keyframe that does not see them yet, and their pixels."""
    wanted = rows[view.alive[rows] & ~np.isin(rows, keyframe.observations.rows)]
    data, templates = keyframe.data, view.templates
    expected = predicted(data.camera, keyframe.T_world_cam.inverse(), view, wanted)
    found, uv = find_patches(data.target, templates.patches, templates.offset, expected, radius_px, UNSEEN_REACH)
    return expected.take(found), uv[found]


def cull_redundant(world: Map, among: list[int], config: CullingConfig) -> list[int]:
    """Cull the redundant ones of the keyframes ``among`` (indices), oldest first; returns them.

    The first two of a map, which fix its frame and scale, and the newest ones are never culled."""
    held = {k for m in {world.keyframes[k].map_id for k in among} for k in world.living_in(m)[:2]}
    newest = set(world.living[-config.keep_newest :])
    culled = []
    for k in sorted(set(among) - held - newest):
        if world.keyframes[k].alive and is_redundant(world, k, config) and not _ties_its_neighbours(world, k):
            world.cull_keyframe(k)
            culled.append(k)
    return culled


def leave_behind(world: Map, config: CullingConfig, added: int = 1) -> list[int]:
    """Cull the keyframe that the camera has just left behind, if it is redundant among those around it; returns it. If
    it stays, its image is compressed. added: how many new keyframes there are, and as many are left behind."""
    behind = world.living[-config.behind - added : -config.behind]
    culled = cull_redundant(world, behind, replace(config, viewers=config.viewers_behind))
    for index in set(behind) - set(culled):
        world.compress_keyframe(index)
    return culled


def is_redundant(world: Map, index: int, config: CullingConfig) -> bool:
    """Whether enough of a keyframe's points are seen by enough other keyframes at the same or a finer level."""
    seen = world.keyframes[index].observations
    if len(seen.rows) < ASSESSED_POINTS:
        return False
    viewers = np.zeros(len(world.points), np.int64)
    finest: IntArray = np.full(len(world.points), -1, np.int64)
    finest[seen.rows] = seen.level
    for k in world.observers(seen.rows):
        if k != index:
            other = world.keyframes[k].observations
            viewers[other.rows[other.level <= finest[other.rows]]] += 1
    enough = np.count_nonzero(viewers[seen.rows] >= config.viewers)
    return bool(enough >= config.seen_ratio * len(seen.rows))


def _ties_its_neighbours(world: Map, index: int) -> bool:
    """Whether the keyframes before and after it share too few points to stay connected by images without it."""
    before, after = world.predecessor(index), world.successor(index)
    if before is None or after is None:
        return False
    rows = world.keyframes[before].observations.rows
    return bool(np.isin(world.keyframes[after].observations.rows, rows).sum() < TIED_POINTS)
