"""Pose of one image against a map: coarse then fine patch search, robust pose, a verdict (PTAM's TrackMap)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.config import TrackerConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.projection import predict
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.map import MapView
from vsx_ros.slam.pose_optimization import PoseOptimizer
from vsx_ros.slam.state import TrackingState
from vsx_ros.vision.patch_search import Predictions, find_patches, kernel_camera

COARSE_POINTS = 80
COARSE_LEVEL = 2
COARSE_MIN_FOUND = 10
MARGIN_PX = 8.0
FEW, FEW_RATIO = 12, 0.5
AGAIN_RADIUS_PX, AGAIN_REACH = 3.0, 2


class Track(NamedTuple):
    """Outcome for one frame. rows, uv, level (F,): points found where the pose puts them; searched_rows: all that were
    looked for. information (6, 6): inverse covariance of the pose in the camera's tangent."""

    T_world_cam: SE3
    state: TrackingState
    rows: IntArray
    uv: Pixels
    level: IntArray
    searched_rows: IntArray
    information: FloatArray
    reason: str

    @property
    def ratio(self) -> float:
        """Found over searched."""
        return len(self.rows) / max(1, len(self.searched_rows))


def nothing_tracked(reason: str, T_world_cam: SE3 | None = None) -> Track:
    """A frame no point was looked for in; the pose is the one given, or means nothing."""
    none, pose = np.zeros(0, np.int64), T_world_cam or SE3.identity()
    return Track(pose, TrackingState.LOST, none, np.zeros((0, 2)), none, none, np.zeros((6, 6)), reason)


class Tracker:
    """``track`` changes nothing but the random order in which surplus points are dropped."""

    def __init__(self, camera: PinholeCamera, config: TrackerConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._array = kernel_camera(camera)
        self._optimizer = PoseOptimizer(camera)
        self._rng = rng

    def track(
        self,
        data: FrameData,
        view: MapView,
        T_world_cam: SE3,
        candidates: IntArray,
        coarse_radius_px: float,
        information: FloatArray | None = None,
    ) -> Track:
        """Look for the candidate points (rows) around their place at the expected pose.

        coarse_radius_px: 0 leaves the coarse stage out. information (6,): how firmly the
        expected pose is known, per axis of the camera's tangent; None without wheels.
        """
        pull = np.zeros(6) if information is None else information
        pose = T_world_cam.inverse()
        predictions = predicted(self._array, pose, view, candidates)
        radius = self._config.fine_radius_px
        if coarse_radius_px > 0:
            coarse = self._coarse(data, view, pose, predictions, coarse_radius_px, pull)
            if coarse is not None:
                pose, radius = coarse, 0.5 * radius
                predictions = predicted(self._array, pose, view, candidates)
        predictions = self._choose(predictions)
        found, uv = find_patches(
            data.pyramid, data.corners, view.templates.patches, view.templates.offset, predictions, radius
        )
        weights = np.zeros(len(found))
        certainty = np.zeros((6, 6))
        if int(found.sum()) >= 6:
            pose, weights, certainty = self._pose(view, pose, predictions, found, uv, pull)
            inliers = int((weights > 0).sum())
            if inliers >= 10:
                predictions, found, uv = self._again(data, view, pose, predictions, weights > 0, uv)
                pose, weights, certainty = self._pose(view, pose, predictions, found, uv, pull)
        inlier = weights > 0
        state, reason = self._judge(
            int(inlier.sum()), len(predictions.rows), int(len(data.corners.positions)), bool(pull.any())
        )
        return Track(
            pose.inverse(),
            state,
            predictions.rows[inlier],
            uv[inlier],
            predictions.level[inlier],
            predictions.rows,
            certainty,
            reason,
        )

    def _coarse(
        self, data: FrameData, view: MapView, pose: SE3, predictions: Predictions, radius: float, pull: FloatArray
    ) -> SE3 | None:
        """Pose from up to 80 points of the coarse levels in a wide circle; None when too few are found."""
        rows = np.flatnonzero(predictions.level >= COARSE_LEVEL)
        if len(rows) < COARSE_MIN_FOUND:
            rows = np.flatnonzero(predictions.level >= 1)
        if len(rows) > COARSE_POINTS:
            rows = np.sort(self._rng.permutation(rows)[:COARSE_POINTS])
        chosen = predictions.take(rows)
        found, uv = find_patches(
            data.pyramid, data.corners, view.templates.patches, view.templates.offset, chosen, radius
        )
        if int(found.sum()) < COARSE_MIN_FOUND:
            return None
        estimate, weights, _ = self._pose(view, pose, chosen, found, uv, pull)
        return estimate if int((weights > 0).sum()) >= COARSE_MIN_FOUND else None

    def _choose(self, predictions: Predictions) -> Predictions:
        """At most ``max_points``: coarse levels first, the rest at random."""
        n = len(predictions.rows)
        if n <= self._config.max_points:
            return predictions
        order = self._rng.permutation(n)
        order = order[np.argsort(-predictions.level[order], kind="stable")]
        return predictions.take(np.sort(order[: self._config.max_points]))

    def _pose(
        self,
        view: MapView,
        start: SE3,
        predictions: Predictions,
        found: BoolArray,
        uv: Pixels,
        pull: FloatArray,
    ) -> tuple[SE3, FloatArray, FloatArray]:
        """Pose, weights (S,) over all predictions (0: not found or outlier), information."""
        chosen = np.flatnonzero(found)
        estimate = self._optimizer.optimize(
            start, view.points[predictions.rows[chosen]], uv[chosen], predictions.level[chosen], pull
        )
        weights = np.zeros(len(found))
        weights[chosen] = estimate.weights
        return estimate.T_cam_world, weights, estimate.information

    def _again(
        self, data: FrameData, view: MapView, pose: SE3, before: Predictions, kept: BoolArray, uv: Pixels
    ) -> tuple[Predictions, BoolArray, Pixels]:
        """Search what was not found once more from the better pose; what was found stays."""
        fresh = predicted(self._array, pose, view, before.rows)
        is_kept = np.zeros(len(view.points), np.bool_)
        is_kept[before.rows[kept]] = True
        fresh = fresh.take(~is_kept[fresh.rows])
        found, more = find_patches(
            data.pyramid,
            data.corners,
            view.templates.patches,
            view.templates.offset,
            fresh,
            AGAIN_RADIUS_PX,
            AGAIN_REACH,
        )
        old = before.take(kept)
        joined = Predictions(*(np.concatenate(pair) for pair in zip(old, fresh)))
        everything = np.concatenate([np.ones(len(old.rows), np.bool_), found])
        return joined, everything, np.concatenate([uv[kept], more])

    def _judge(self, found: int, searched: int, corners: int, guided: bool) -> tuple[TrackingState, str]:
        """A pose that the wheels support needs fewer points, provided that most of them are where they should be."""
        config = self._config
        share = found / max(1, searched)
        if guided and found < config.min_found and found >= FEW and share > FEW_RATIO:
            return TrackingState.DUBIOUS, f"only {found} points in view"
        if found < config.min_found or share < config.lost_ratio:
            if corners < 50:
                return TrackingState.LOST, f"the image shows nothing to hold on to ({corners} corners)"
            return TrackingState.LOST, f"{found} of {searched} expected points found"
        if share < config.good_ratio:
            return TrackingState.DUBIOUS, f"only {found} of {searched} expected points found"
        return TrackingState.GOOD, ""


def predicted(camera: FloatArray, T_cam_world: SE3, view: MapView, rows: IntArray) -> Predictions:
    """Which of the points (rows) are visible from a pose, and where. camera (12,) as ``kernel_camera`` gives it."""
    level, uv, inverse_warp, template = predict(
        camera,
        T_cam_world.rotation,
        T_cam_world.translation,
        view.points,
        rows,
        view.templates.of_point,
        view.templates.source,
        view.templates.basis,
        view.R_world_cam,
        view.centres,
        MARGIN_PX,
    )
    visible = level >= 0
    return Predictions(rows[visible], level[visible], uv[visible], inverse_warp[visible], template[visible])


class LocalMap:
    """The points worth projecting: those of keyframes that share points with, or stand near, the reference keyframe.
    Their number does not grow with the map."""

    NEAREST = 40
    COVISIBLE = 12
    ALWAYS = 4

    def __init__(self) -> None:
        self._key: tuple[int, int] = (-1, -1)
        self.reference = 0
        self.keyframes: list[int] = []
        self.rows: IntArray = np.zeros(0, np.int64)

    def select(self, view: MapView, reference: int) -> None:
        """Choose around a reference keyframe; cheap while neither it nor the map changed."""
        if self._key == (view.version, reference):
            return
        self._key, self.reference = (view.version, reference), reference
        near = nearest_keyframes(view, view.keyframes[reference].T_world_cam)[: self.NEAREST]
        mark = np.zeros(len(view.points), np.bool_)
        mark[view.keyframes[reference].observations.rows] = True
        shared = np.array([np.count_nonzero(mark[view.keyframes[k].observations.rows]) for k in near])
        chosen = [int(k) for k in near[np.argsort(-shared, kind="stable")[: self.COVISIBLE]]]
        chosen += [int(k) for k in near[: self.ALWAYS] if int(k) not in chosen]
        if reference not in chosen:
            chosen.append(reference)
        self.keyframes = chosen
        for k in chosen:
            mark[view.keyframes[k].observations.rows] = True
        self.rows = np.flatnonzero(mark & view.alive)

    def follow(self, view: MapView, found: IntArray) -> int:
        """The keyframe that sees most of the found points; the reference stays unless another one is 20 % better."""
        mark = np.zeros(len(view.points), np.bool_)
        mark[found] = True
        counts = {k: int(np.count_nonzero(mark[view.keyframes[k].observations.rows])) for k in self.keyframes}
        best = max(counts, key=lambda k: (counts[k], -k))
        return best if counts[best] > 1.2 * counts.get(self.reference, 0) else self.reference


def nearest_keyframes(view: MapView, T_world_cam: SE3) -> IntArray:
    """Indices of the living keyframes by distance in position and viewing direction (1 rad weighs like the median
    depth)."""
    living = view.living
    offset = np.linalg.norm(view.centres[living] - T_world_cam.translation, axis=1)
    depth = np.array([view.keyframes[int(k)].median_depth or 1.0 for k in living])
    cosine = view.R_world_cam[living, :, 2] @ T_world_cam.rotation[:, 2]
    return living[np.argsort(offset / depth + np.arccos(np.clip(cosine, -1.0, 1.0)), kind="stable")]
