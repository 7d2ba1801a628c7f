"""Detects places that the map holds elsewhere: a loop to close or another map to join. Every new keyframe is checked; a
detection counts when it is certain or a second keyframe agrees."""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config.maps import DriftConfig, SlamConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import METRIC, KeyFrame, MapView, Unit, unit_of
from vsx_ros.slam.local_map import nearest_keyframes, path_lengths
from vsx_ros.slam.loop_correction import LoopClosure, same_points, scale_is_observed
from vsx_ros.slam.map import Map
from vsx_ros.slam.place_recognition import PlaceRecognizer, Recognition
from vsx_ros.slam.tracker import Tracker

TRIED, DRIFTED_PX = 2, 60.0  # similar keyframes tried, to limit time; px that drift moves points in the image
# A keyframe is connected to an old one if they share so many points; old: so many median depths of path ago.
KNOWN_POINTS, LONG_AGO = 40, 1.5
# Tracking closed a loop if its path is so many depths and the last loop is more than so many keyframes ago.
LOOP_WAY, LOOP_KEYFRAMES = 4.0, 20
VIEW_DEPTHS, VIEW_RAD = 0.7, 0.6  # largest distance (median depths) and angle of two keyframes in one place
SCALE_PAIRS, SCALE_SPREAD = 12, 0.1  # points for the scale factor; median absolute deviation of its logarithm
AGREE_M, AGREE_RAD, AGREE_SCALE, AGREE_KEYFRAMES = 0.05, 0.03, 0.05, 6  # per median depth; of log scale; keyframes


class LoopDetector:
    """Call ``detect`` once for every new keyframe. Of two maps, the later one is to move into the earlier, whichever of
    them the keyframe is in. tracked_loop: a message when tracking alone has closed a loop (the
    keyframe shares points with old keyframes, those just before it did not); else empty."""

    def __init__(self, camera: PinholeCamera, config: SlamConfig, rng: np.random.Generator) -> None:
        self.places = PlaceRecognizer(camera, Tracker(config.tracker, rng))
        self._recognition, self._drift = config.recognition, config.drift
        self._unconfirmed: LoopClosure | None = None
        self._last_loop = -LOOP_KEYFRAMES
        self.tracked_loop = ""

    def detect(self, world: Map, view: MapView, index: int) -> list[LoopClosure]:
        """The loop closures at keyframe ``index``: a certain one, or two that agree; empty when there are none."""
        self.tracked_loop = ""
        groups = self._elsewhere(world, view, index), self._long_ago(world, view, index)
        newest = world.keyframes[index]
        for seen in chain.from_iterable(self._recognitions(newest, view, among) for among in groups if len(among)):
            if not seen.is_sure(self._recognition):
                continue
            closure = self._closure(world, index, seen)
            if closure is None or not self._is_plausible(world, closure):
                continue
            before, self._unconfirmed = self._unconfirmed, closure
            found = [closure] if seen.is_certain(self._recognition) else []
            if before is not None and self._agree(world, before, closure):
                found = [before, closure]
            self._last_loop = index if found else self._last_loop
            later = world.keyframes[seen.keyframe].map_id > newest.map_id
            return [closure.exchanged() for closure in found] if later else found
        return []

    def _recognitions(self, newest: KeyFrame, view: MapView, among: IntArray) -> Iterator[Recognition]:
        """By the most similar keyframes; then, assuming small drift, by the nearest one of the same map."""
        features = self.places.described(newest)[1]
        for k in self.places.ranked(newest.data.small, view, among)[:TRIED]:
            seen = self.places.recognise(newest.data, features, view, int(k))
            if seen is not None:
                yield seen
        if view.keyframes[int(among[0])].map_id == newest.map_id:
            nearest = nearest_keyframes(view._replace(living=among), newest.T_world_cam)[0]
            yield self.places.verify(newest.data, view, int(nearest), newest.T_world_cam, DRIFTED_PX)

    def forget(self) -> None:
        """Drop the unconfirmed closure after a correction."""
        self._unconfirmed = None

    def _elsewhere(self, world: Map, view: MapView, index: int) -> IntArray:
        """Keyframes of other maps, which may show the same place."""
        here = world.keyframes[index].map_id
        return np.array([k for k in view.living if world.keyframes[int(k)].map_id != here], np.int64)

    def _long_ago(self, world: Map, view: MapView, index: int) -> IntArray:
        """Keyframes of the first map that may show the same place but are not connected to it: old ones that are near
        enough for the drift since then."""
        newest = world.keyframes[index]
        if newest.map_id:
            return np.zeros(0, np.int64)
        way = path_lengths(view)
        way = way[index] - way
        mine = view.part(newest.map_id).living
        long_ago = mine[way[mine] > LONG_AGO * max(newest.median_depth, 1e-6)]
        shared = world.covisible(newest.observations.rows)[long_ago]
        if not len(long_ago) or shared.max() >= KNOWN_POINTS:
            self._notice_tracked_loop(view, index, long_ago[shared >= KNOWN_POINTS], way)
            return np.zeros(0, np.int64)
        offset = np.linalg.norm(view.centres[long_ago] - newest.T_world_cam.translation, axis=1)
        cosine = view.R_world_cam[long_ago, :, 2] @ newest.T_world_cam.rotation[:, 2]
        reach, angle = _drift(self._drift, way[long_ago], unit_of(world.keyframes, index))
        near = offset < reach + VIEW_DEPTHS * newest.median_depth
        near &= np.arccos(np.clip(cosine, -1.0, 1.0)) < angle + VIEW_RAD
        return np.asarray(long_ago[near])

    def _notice_tracked_loop(self, view: MapView, index: int, known: IntArray, way: FloatArray) -> None:
        oldest = max(known.tolist(), key=lambda k: float(way[k]), default=index)
        if way[oldest] < LOOP_WAY * view.keyframes[index].median_depth:
            return
        if index - self._last_loop > LOOP_KEYFRAMES:
            length = f"{way[oldest]:.1f} {unit_of(view.keyframes, index).word}"
            self.tracked_loop = f"after {length}, by tracking alone: keyframe {index} sees points of {oldest}"
        self._last_loop = index

    def _is_plausible(self, world: Map, closure: LoopClosure) -> bool:
        """Whether the map can have drifted so far; always True between two maps."""
        older, newer = world.keyframes[closure.older], world.keyframes[closure.newer]
        if older.map_id != newer.map_id:
            return True
        way = path_lengths(world.live_view())
        unit = unit_of(world.keyframes, closure.newer, closure.older)
        reach, angle = _drift(self._drift, way[closure.newer] - way[closure.older], unit)
        return closure.place(world).is_near(newer.T_world_cam, float(reach), float(angle))

    def _closure(self, world: Map, index: int, seen: Recognition) -> LoopClosure | None:
        """The closure with its scale factor (1 by odometry, else from depths of shared points); None if unclear."""
        newest, track = world.keyframes[index], seen.track
        factor = 1.0
        if not scale_is_observed(world, newest, world.keyframes[seen.keyframe]):
            mine, known = same_points(newest, track.rows, track.uv, track.level)
            if len(mine) < SCALE_PAIRS:
                return None
            ratio = np.log(_depth(world, track.T_world_cam, known) / _depth(world, newest.T_world_cam, mine))
            middle = float(np.median(ratio))
            if float(np.median(np.abs(ratio - middle))) > SCALE_SPREAD:
                return None
            factor = float(np.exp(middle))
        T_older_newer = world.keyframes[seen.keyframe].T_world_cam.inverse() @ track.T_world_cam
        return LoopClosure(
            older=seen.keyframe, newer=index, T_older_newer=T_older_newer, factor=factor, points=len(track.rows)
        )

    def _agree(self, world: Map, a: LoopClosure, b: LoopClosure) -> bool:
        """Whether two closures show the same displacement; False if a keyframe of the first was culled."""
        if not (world.keyframes[a.older].alive and world.keyframes[a.newer].alive):
            return False
        first, second = world.keyframes[a.newer], world.keyframes[b.newer]
        older = [world.keyframes[r.older].map_id for r in (a, b)]
        if b.newer - a.newer > AGREE_KEYFRAMES or first.map_id != second.map_id or older[0] != older[1]:
            return False
        expected = a.place(world) @ (first.T_world_cam.inverse() @ second.T_world_cam).scaled(b.factor)
        reach = AGREE_M * max(b.factor * second.median_depth, 1e-6)
        near = b.place(world).is_near(expected, reach, AGREE_RAD)
        return near and bool(abs(np.log(a.factor / b.factor)) < AGREE_SCALE)


def _drift(config: DriftConfig, way: FloatArray, unit: Unit) -> tuple[FloatArray, FloatArray]:
    """Largest drift [the map's unit, rad] of the map after a path [its unit]."""
    by_odometry = unit == METRIC
    share = config.odometry_ratio if by_odometry else config.camera_ratio
    turn_rad_m = config.odometry_rad_m if by_odometry else config.camera_rad_m
    return config.distance_m * unit.metre + share * way, config.turn_rad + turn_rad_m * way / unit.metre


def _depth(world: Map, T_world_cam: SE3, rows: IntArray) -> FloatArray:
    here = world.points[rows] - T_world_cam.translation
    return np.maximum(here @ T_world_cam.rotation[:, 2], 1e-6)
