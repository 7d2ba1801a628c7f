"""The mapper owns the map: it adds keyframes, and makes, refines and removes points (paper 3.1)."""

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config import SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.bundle_adjustment import BundleAdjuster
from vsx_ros.slam.keyframe import FrameData, MapView, Observations
from vsx_ros.slam.loop_closing import LoopDetector
from vsx_ros.slam.loop_correction import correct_loops
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_points import MapPoints, cull_redundant, leave_behind
from vsx_ros.slam.point_creation import observations_at
from vsx_ros.slam.recount import Recount, recount
from vsx_ros.slam.start_watch import GiveUp, StartWatch
from vsx_ros.slam.state import SlamEvent
from vsx_ros.slam.two_view_reconstruction import InitialPair, TwoViewReconstruction
from vsx_ros.vision.corners import dense_corners

# The whole map is adjusted when it has grown by so many keyframes and this share: constant work per keyframe. Those
# culled behind the camera are no growth.
GLOBAL_EVERY, GLOBAL_GROWTH = 8, 0.1
VETO_OBSERVATIONS, VETO_AGE, VETO_SIGMAS = 100, 3, 6.0
BASELINES = (0.07, 0.025, 0.12, 0.045)


class KeyFrameRequest(NamedTuple):
    """A tracked frame to add to the map. anchor: its pose relative to its reference keyframe, which may have moved
    since. odom_segment: see KeyFrame. searched, found (P,): the tracker's counts per point so far."""

    data: FrameData
    anchor: Anchor
    odom_segment: int
    rows: IntArray
    uv: FloatArray
    level: IntArray
    searched: IntArray
    found: IntArray


class Mapper:
    """``add_keyframe`` does all the work for one keyframe; ``refine`` follows when there is time."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: SlamConfig, world: Map) -> None:
        self.map, self._loaded = world, len(world.keyframes)
        self._config, self._culling = config.mapper, config.culling
        self._points = MapPoints(world, config.mapper)
        self._reconstruction = TwoViewReconstruction(camera, config.initialization)
        self._adjuster = BundleAdjuster(camera, T_base_cam, config.odometry_noise)
        self._since_global = 0
        self._initialization = config.initialization
        self._new_loops = partial(LoopDetector, camera, config)
        self.loops = self._new_loops(np.random.default_rng(0))
        self._watch: StartWatch | None = None
        self.events: deque[SlamEvent] = deque()

    def start(self, pair: InitialPair) -> MapView | str:
        """Make a map of two frames, the first one or a separate one; returns the reason if they do not allow it."""
        start = self._reconstruction.reconstruct(pair)
        if isinstance(start, str):
            return start
        world = self.map
        map_id = 1 + max((keyframe.map_id for keyframe in world.keyframes), default=-1)
        world.odom_segment = pair.odom_segment
        first = world.add_keyframe(self._with_corners(pair.first), start.poses[0], Observations.none(), map_id)
        second = world.add_keyframe(self._with_corners(pair.second), start.poses[1], Observations.none(), map_id)
        self._points.enter(first, second, pair.candidates, start.matches)
        for k in (first, second):
            world.update_depth(k)
        self._adjuster.adjust(world, [second], 20)
        self._points.make(second, [first])
        self._adjuster.adjust(world, [second], 20)
        if pair.odometry is None and first == 0:
            self._watch = StartWatch(world, self._initialization)
        leave_behind(world, self._culling, added=2)
        world.version += 1
        return world.view()

    def add_keyframe(self, request: KeyFrameRequest) -> MapView:
        """Add a frame to the map: measurements, further searches, new points, local adjustment, culling. The map is
        empty if its start was wrong: it needs a new start, and earlier requests are ignored."""
        world = self.map
        if not world.keyframes:
            return world.view()
        pose, map_id = request.anchor.pose(world.keyframes), world.keyframes[request.anchor.keyframe].map_id
        world.odom_segment = request.odom_segment
        observed = observations_at(request.data, pose, world.points, request.rows, request.uv, request.level)
        self._points.remove_unfound(request.searched, request.found)
        observed = observed.where(world.alive[observed.rows])
        index = world.add_keyframe(self._with_corners(request.data), pose, observed, map_id)
        neighbours = self.neighbours(index, self._config.window_keyframes)
        self._points.refind([index], world.seen_by(neighbours))
        created = self._points.make(index, self._targets(index, neighbours))
        self._points.refind(neighbours, created)
        before = list(world.keyframes), world.points.copy(), world.alive.copy()
        self._adjuster.adjust(world, self._movable([index, *neighbours]), self._config.local_iterations)
        step = self._contradicted_step(index)
        if step is not None:
            world.keyframes[:], world.points[:], world.alive[:] = before
            self._place_by_odometry(index, step)
        self._points.renew_templates(index)
        self._since_global += 1
        self._correct_loops(index, neighbours)
        cull_redundant(world, neighbours, self._culling)
        self._since_global -= len(leave_behind(world, self._culling))
        return self._watched()

    def recount(self, wanted: Recount) -> MapView:
        """Correct a map made with a wrong wheel calibration; the whole map is adjusted next."""
        recount(self.map, wanted, self._loaded)
        self.events.append(SlamEvent(wanted.stamp_ns, "calibrated", wanted.reason))
        self._since_global = len(self.map.keyframes)
        self.map.version += 1
        return self.map.view()

    def _correct_loops(self, index: int, neighbours: list[int]) -> None:
        """Close a loop or join a map when a new keyframe shows a place that the map holds elsewhere."""
        closures = self.loops.detect(self.map, self.map.live_view(), index)
        if self.loops.tracked_loop:
            stamp_ns = self.map.keyframes[index].data.stamp_ns
            self.events.append(SlamEvent(stamp_ns, "loop closed", self.loops.tracked_loop))
            self._since_global = len(self.map.keyframes)
        if not closures:
            return
        older, newer = closures[-1].older, closures[-1].newer
        beside = neighbours if newer == index else self.neighbours(newer, self._config.window_keyframes)
        around = [newer, *beside]
        self.events.append(correct_loops(self.map, closures, around))
        self.loops.forget()
        there = [older, *self.neighbours(older, self._config.window_keyframes)]
        self._adjuster.adjust(self.map, self._movable(sorted({*around, *there})), self._config.local_iterations)
        self._since_global = len(self.map.keyframes)

    @property
    def refinement_due(self) -> bool:
        """Whether the whole map should be adjusted: while it is young, has grown by a tenth, or a loop was closed."""
        young = len(self.map.keyframes) < GLOBAL_EVERY
        return self._since_global >= (1 if young else max(GLOBAL_EVERY, round(GLOBAL_GROWTH * len(self.map.living))))

    def refine(self, interrupted: Callable[[], bool] = lambda: False) -> MapView:
        """Adjust the whole map; if interrupted, the adjustment stays due."""
        world = self.map
        free = self._movable(world.living)
        if self._adjuster.adjust(world, free, self._config.global_iterations, interrupted):
            self._since_global = 0
        return self._watched()

    def _watched(self) -> MapView:
        """The map after a change; empty if its start was wrong."""
        world, watch = self.map, self._watch
        if watch is not None and watch.is_over(world):
            self._watch = watch = None
        reason = watch.collapse(world) if watch is not None else ""
        if reason:
            self._clear(world.keyframes[-1].data.stamp_ns, reason)
        world.version += 1
        return world.view()

    def give_up(self, lost: GiveUp) -> MapView:
        """Begin again without the map if its start is still watched; else nothing happens."""
        if self._watch is not None and not self._watch.is_over(self.map):
            self._clear(*lost)
            self.map.version += 1
        return self.map.view()

    def _clear(self, stamp_ns: int, reason: str) -> None:
        self.events.append(SlamEvent(stamp_ns, "restarted", reason))
        self.map.clear()
        self._watch, self._since_global = None, 0
        self.loops = self._new_loops(np.random.default_rng(0))

    def _movable(self, indices: list[int]) -> list[int]:
        """Keyframes that an adjustment may move: not the first one of a second map, which fixes its frame. (The
        adjuster itself fixes that of the first map.)"""
        maps = {self.map.keyframes[k].map_id for k in indices} - {0}
        return [k for k in indices if k not in {self.map.living_in(m)[0] for m in maps}]

    def neighbours(self, index: int, count: int) -> list[int]:
        """Indices of the living keyframes that share most points (15 or more) with one, and of 1 to 3 predecessors."""
        shared = self.map.covisible(self.map.keyframes[index].observations.rows)
        shared[index] = 0
        ranked = [int(k) for k in np.argsort(-shared, kind="stable") if shared[k] >= 15][:count]
        previous = [k for k in islice(self.map.predecessors(index), 3) if k not in ranked]
        wanted = 1 if len(ranked) >= 3 else 3
        return [*ranked[: count - wanted], *previous[:wanted]]

    def _targets(self, index: int, neighbours: list[int]) -> list[int]:
        """Neighbours to triangulate with: one at a good baseline, one near for points just come into view, then wider
        ones. Baselines are relative to the depth."""
        keyframes, here = self.map.keyframes, self.map.keyframes[index].T_world_cam.translation
        depth = keyframes[index].median_depth or 1.0
        offset = {k: np.linalg.norm(keyframes[k].T_world_cam.translation - here) for k in neighbours}
        chosen: list[int] = []
        for wanted in BASELINES[: self._config.target_keyframes]:
            left = [k for k in neighbours if k not in chosen and offset[k] > 0.2 * BASELINES[1] * depth]
            if left:
                chosen.append(min(left, key=lambda k: abs(math.log(offset[k] / depth / wanted))))
        return chosen

    def _contradicted_step(self, index: int) -> tuple[int, SE3] | None:
        """The previous keyframe and the step from it by odometry, if the map contradicts odometry beyond its error and
        few older points support the map (many do when the wheels slip); else None."""
        factor, before = self._adjuster.by_odometry(self.map, index), self.map.predecessor(index)
        known = self.map.source[self.map.keyframes[index].observations.rows] < index - VETO_AGE
        if factor is None or before is None or np.count_nonzero(known) >= VETO_OBSERVATIONS:
            return None
        previous, newest = (self.map.keyframes[k].T_world_cam for k in (before, index))
        error = (factor.T_a_b.inverse() @ previous.inverse() @ newest).log()
        return (before, factor.T_a_b) if error @ factor.information @ error > VETO_SIGMAS**2 else None

    def _place_by_odometry(self, index: int, step: tuple[int, SE3]) -> None:
        """Place a keyframe by odometry and drop its points: few points that contradict odometry are not trusted,
        because they can change the scale of the map."""
        world, (before, T_before_here) = self.map, step
        world.remove_points(np.flatnonzero(world.alive & (world.source == index)))
        world.forget(index, np.ones(len(world.keyframes[index].observations.rows), np.bool_))
        world.move_keyframe(index, world.keyframes[before].T_world_cam @ T_before_here)

    def _with_corners(self, data: FrameData) -> FrameData:
        """The frame with dense corners, for new points."""
        return data._replace(corners=dense_corners(data.pyramid, self._config.corners))
