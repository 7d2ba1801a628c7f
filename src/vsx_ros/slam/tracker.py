"""Pose of one image against a map: coarse then fine patch search, robust pose, a verdict (PTAM's TrackMap)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.config import TrackerConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry.projection import predict, project_rows
from vsx_ros.kernels.slam.tracking import count_hidden
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.map import MapView
from vsx_ros.slam.pose_optimization import PoseEstimate, optimized
from vsx_ros.slam.state import TrackingState
from vsx_ros.vision.patch_search import Predictions, WarpedTemplates, find_patches, search_templates, warped_templates

COARSE_POINTS = 80
COARSE_LEVEL = 2
COARSE_MIN_FOUND = 10
MARGIN_PX = 8.0
FEW, FEW_RATIO = 12, 0.5
AGAIN_RADIUS_PX, AGAIN_REACH = 3.0, 1
MIN_FIRST = 10
HIDING_CELL_PX, BEHIND = 16, 1.25
# (iterations that accept almost everything, iterations): the first pose only has to guide the second search.
FIRST, SECOND = (4, 7), (1, 12)


class Track(NamedTuple):
    """Outcome for one frame. rows, uv, level (F,): points found where the pose puts them; searched_rows: all that were
    looked for. information (6, 6): inverse covariance of the pose in the camera's tangent. hidden: how many of the
    searched were not found and lie behind found ones. blurred: the image was, and not finding a point in it says
    nothing about the point."""

    T_world_cam: SE3
    state: TrackingState
    rows: IntArray
    uv: Pixels
    level: IntArray
    searched_rows: IntArray
    information: FloatArray
    reason: str
    hidden: int = 0
    blurred: bool = False

    @property
    def ratio(self) -> float:
        """Found over searched."""
        return len(self.rows) / max(1, len(self.searched_rows))

    @property
    def visible_ratio(self) -> float:
        """Found over those of the searched that no found point hides."""
        return len(self.rows) / max(1, len(self.searched_rows) - self.hidden)


def nothing_tracked(reason: str, T_world_cam: SE3 | None = None) -> Track:
    """A frame no point was looked for in; the pose is the one given, or means nothing."""
    none, pose = np.zeros(0, np.int64), T_world_cam or SE3.identity()
    return Track(pose, TrackingState.LOST, none, np.zeros((0, 2)), none, none, np.zeros((6, 6)), reason)


class Tracker:
    """``track`` changes nothing but the random order in which surplus points are dropped."""

    def __init__(self, config: TrackerConfig, rng: np.random.Generator) -> None:
        self._config = config
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
        expected pose is known, per axis of the camera's tangent; None without odometry.
        """
        pull = np.zeros(6) if information is None else information
        pose = T_world_cam.inverse()
        expected = predicted(data.camera, pose, view, candidates)
        radius = self._config.fine_radius_px
        if coarse_radius_px > 0:
            coarse = self._coarse(data, view, pose, expected, coarse_radius_px, pull)
            if coarse is not None:
                pose, radius = coarse, 0.5 * radius
                expected = predicted(data.camera, pose, view, candidates)
        expected = self._choose(expected)
        templates = warped_templates(view.templates.patches, view.templates.offset, expected)
        found, uv = search_templates(data.pyramid, data.corners, templates, expected.level, expected.uv, radius)
        fit = optimized(data.camera, pose, view.points, expected, found, uv, pull, FIRST)
        counted = np.ones(len(uv), np.bool_)
        # Where odometry holds the pose, points that are no corners in this image need none to lead to them.
        if np.count_nonzero(fit.weights) >= MIN_FIRST or pull.any():
            fit, uv, counted = self._again(data, view, fit, expected, templates, uv, pull)
        kept = fit.weights > 0
        searched, pose = expected.rows[counted], fit.T_cam_world
        depth = view.points[expected.rows] @ pose.rotation[2] + pose.translation[2]
        state, reason = self._judge(
            int(np.count_nonzero(kept)), len(searched), len(data.corners.positions), bool(pull.any())
        )
        if data.blurred:
            state = TrackingState.LOST if state is TrackingState.LOST else TrackingState.DUBIOUS
            reason = "; ".join(filter(None, ["the image is blurred", reason]))
        return Track(
            fit.T_cam_world.inverse(),
            state,
            expected.rows[kept],
            uv[kept],
            expected.level[kept],
            searched,
            fit.information,
            reason,
            hidden(expected.uv[counted], depth[counted], kept[counted]),
            data.blurred,
        )

    def _coarse(
        self, data: FrameData, view: MapView, pose: SE3, expected: Predictions, radius: float, pull: FloatArray
    ) -> SE3 | None:
        """Pose from up to 80 points of the coarse levels in a wide circle; None when too few are found."""
        rows = np.flatnonzero(expected.level >= COARSE_LEVEL)
        if len(rows) < COARSE_MIN_FOUND:
            rows = np.flatnonzero(expected.level >= 1)
        if len(rows) > COARSE_POINTS:
            rows = np.sort(self._rng.permutation(rows)[:COARSE_POINTS])
        chosen = expected.take(rows)
        found, uv = find_patches(
            data.pyramid, data.corners, view.templates.patches, view.templates.offset, chosen, radius
        )
        if np.count_nonzero(found) < COARSE_MIN_FOUND:
            return None
        fit = optimized(data.camera, pose, view.points, chosen, found, uv, pull, FIRST)
        return fit.T_cam_world if np.count_nonzero(fit.weights) >= COARSE_MIN_FOUND else None

    def _choose(self, expected: Predictions) -> Predictions:
        """At most ``max_points``: coarse levels first, the rest at random."""
        n = len(expected.rows)
        if n <= self._config.max_points:
            return expected
        order = self._rng.permutation(n)
        order = order[np.argsort(-expected.level[order], kind="stable")]
        return expected.take(np.sort(order[: self._config.max_points]))

    def _again(
        self,
        data: FrameData,
        view: MapView,
        fit: PoseEstimate,
        expected: Predictions,
        templates: WarpedTemplates,
        uv: Pixels,
        pull: FloatArray,
    ) -> tuple[PoseEstimate, Pixels, BoolArray]:
        """Search what the first pose does not explain once more around it: (better pose, uv (S, 2), which of the
        expected (S,) are in the image after all)."""
        kept, pose = fit.weights > 0, fit.T_cam_world
        where, inside = project_rows(
            data.camera, pose.rotation, pose.translation, view.points, expected.rows, MARGIN_PX
        )
        found, more = search_templates(
            data.pyramid, data.corners, templates, expected.level, where, AGAIN_RADIUS_PX, AGAIN_REACH, inside & ~kept
        )
        uv = np.where(kept[:, None], uv, more)
        fit = optimized(data.camera, pose, view.points, expected, kept | found, uv, pull, SECOND)
        return fit, uv, kept | inside

    def _judge(self, found: int, searched: int, corners: int, guided: bool) -> tuple[TrackingState, str]:
        """A pose that odometry supports needs fewer points, provided that most of them are where they should be."""
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


def hidden(uv: Pixels, depth: FloatArray, found: BoolArray) -> int:
    """How many points at uv (S, 2) px and depth (S,) m are not found and a quarter farther away than a found one in the
    same 16 px of the image."""
    return int(count_hidden(uv, depth, found, HIDING_CELL_PX, BEHIND))


def predicted(camera: FloatArray, T_cam_world: SE3, view: MapView, rows: IntArray) -> Predictions:
    """Which of the points (rows) are visible from a pose, and where. camera (18,): the image's."""
    return Predictions(
        *predict(
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
    )


class LocalMap:
    """The points worth projecting: those of keyframes that share points with, or stand near, the reference keyframe.
    Their number does not grow with the map. linked: the map without what lies near but is a long way off and not tied
    to it by points: the map may have drifted in between, and tracking on both would tear the camera from one to the
    other. To join them is the loop finder's."""

    NEAREST = 40
    LINKED_POINTS, STRANGE_WAY = 15, 8.0
    COVISIBLE = 12
    ALWAYS = 4

    def __init__(self) -> None:
        self._key: tuple[int, int] = (-1, -1)
        self.reference = 0
        self.keyframes: list[int] = []
        self.rows: IntArray = np.zeros(0, np.int64)
        self._seen, self._seer = self.rows, self.rows
        self.linked: MapView | None = None

    def select(self, view: MapView, reference: int) -> None:
        """Choose around a reference keyframe; cheap while neither it nor the map changed."""
        if self._key == (view.version, reference):
            return
        self._key, self.reference = (view.version, reference), reference
        near = nearest_keyframes(view, view.keyframes[reference].T_world_cam)[: self.NEAREST]
        mark = np.zeros(len(view.points), np.bool_)
        mark[view.keyframes[reference].observations.rows] = True
        shared = np.array([np.count_nonzero(mark[view.keyframes[k].observations.rows]) for k in near])
        self.linked = self._part(view, near[shared >= self.LINKED_POINTS])
        tied = np.isin(near, self.linked.living)
        near, shared = near[tied], shared[tied]
        chosen = [int(k) for k in near[np.argsort(-shared, kind="stable")[: self.COVISIBLE]]]
        chosen += [int(k) for k in near[: self.ALWAYS] if int(k) not in chosen]
        if reference not in chosen:
            chosen.append(reference)
        self.keyframes = chosen
        seen = [view.keyframes[k].observations.rows for k in chosen]
        self._seen, self._seer = np.concatenate(seen), np.repeat(np.arange(len(chosen)), [len(rows) for rows in seen])
        mark[self._seen] = True
        self.rows = np.flatnonzero(mark & view.alive)

    def _part(self, view: MapView, linked: IntArray) -> MapView:
        """The map within a way of so many depths from the reference or from a keyframe linked with it."""
        steps = np.linalg.norm(np.diff(view.centres, axis=0, prepend=view.centres[:1]), axis=1)
        way = np.cumsum(steps)
        known = np.sort(way[np.append(linked, self.reference)])
        after = np.minimum(np.searchsorted(known, way[view.living]), len(known) - 1)
        gap = np.abs(np.stack([known[after], known[np.maximum(after - 1, 0)]]) - way[view.living]).min(axis=0)
        return view._replace(living=view.living[gap <= self.STRANGE_WAY * view.depths[self.reference]])

    def follow(self, view: MapView, found: IntArray) -> int:
        """The keyframe that sees most of the found points; the reference stays unless another one is 20 % better."""
        mark = np.zeros(len(view.points), np.bool_)
        mark[found] = True
        counts = np.bincount(self._seer[mark[self._seen]], minlength=len(self.keyframes))
        best = max(range(len(counts)), key=lambda i: (counts[i], -self.keyframes[i]))
        current = counts[self.keyframes.index(self.reference)]
        return self.keyframes[best] if counts[best] > 1.2 * current else self.reference


def nearest_keyframes(view: MapView, T_world_cam: SE3) -> IntArray:
    """Indices of the living keyframes by distance in position and viewing direction (1 rad weighs like the median
    depth)."""
    living = view.living
    offset = np.linalg.norm(view.centres[living] - T_world_cam.translation, axis=1)
    cosine = view.R_world_cam[living, :, 2] @ T_world_cam.rotation[:, 2]
    return living[np.argsort(offset / view.depths[living] + np.arccos(np.clip(cosine, -1.0, 1.0)), kind="stable")]
