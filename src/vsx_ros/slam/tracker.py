"""Pose of one image against a map: coarse then fine patch search, robust pose, a verdict (PTAM's TrackMap)."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.config.maps import TrackerConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import project_rows
from vsx_ros.kernels.slam.pose import optimize_pose
from vsx_ros.kernels.vision.search import predict, search, warp_templates
from vsx_ros.slam.keyframe import FrameData, MapView
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.vision.patch_search import Predictions, find_patches

COARSE_POINTS = 80  # enough for a first pose; all would take as long as the fine search
COARSE_LEVEL = 2  # from this pyramid level on a wide search is cheap and motion blur does little
COARSE_MIN_FOUND = 20  # PTAM's; in so wide a circle one point in ten has a match by chance
MARGIN_PX = 8.0  # at level 0 from the border of the image, where patches are cut off
FEW, FEW_RATIO = 12, 0.5  # so many points are enough with odometry; least share of those searched
AGAIN_RADIUS_PX, AGAIN_REACH = 3.0, 1  # the pose is good now; level px searched without corners
SETTLED = 0.5  # Tukey weight at a residual of 2.5 sigma; larger ones are other things that look the same
MIN_FIRST = 10  # points; with fewer only the prior by odometry holds the pose
HIDING_CELL_PX, BEHIND = 16, 1.25  # side of a cell; points this many times as deep as a found one are hidden
# (iterations that accept almost everything, iterations): the first pose only has to guide the second search.
FIRST, SECOND = (4, 7), (1, 12)
# Residuals of found patches [px of their level]: the least is the alignment error. Inexact models of lens and shutter
# give more; above the largest they are other things that look the same.
SIGMA_MIN_PX, SIGMA_MAX_PX = 0.4, 3.0
TINY = 1e-6  # information that is added, so that all poses have a covariance


class PoseEstimate(NamedTuple):
    """weights (S,): Tukey weight per prediction, 0 for outliers and points not found. information (6, 6): inverse
    covariance in the camera's tangent (translation, rotation). sigma_px: of the matches, px of their level."""

    T_cam_world: SE3
    weights: FloatArray
    information: FloatArray
    sigma_px: float

    @property
    def settled(self) -> BoolArray:
        """Which of the predictions were found where the pose puts them."""
        return np.asarray(self.weights > SETTLED)


class Tracker:
    """``track`` changes no state but that of the random generator, which selects points to drop."""

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
        """Search for the candidate points (rows) around their predictions at the expected pose.

        coarse_radius_px: 0 skips the coarse stage. information (6,): that of the expected pose, per axis of the
        camera's tangent; None without odometry."""
        pull = np.zeros(6) if information is None else information
        pose, radius = T_world_cam.inverse(), self._config.fine_radius_px
        expected = predicted(data.camera, pose, view, candidates)
        guided = self._coarse(data, view, pose, expected, coarse_radius_px, pull) if coarse_radius_px > 0 else None
        if guided is not None:
            radius *= 0.5
            expected = expected if guided is pose else predicted(data.camera, guided, view, candidates)
            pose = guided
        expected = self._choose(expected)
        fit, uv, counted = self._fine(data, view, pose, expected, radius, pull)
        kept, searched, T_cam_world = fit.weights > 0, expected.rows[counted], fit.T_cam_world
        depth = view.points[expected.rows] @ T_cam_world.rotation[2] + T_cam_world.translation[2]
        state, reason = self._judge(data, int(kept.sum()), len(searched), bool(pull.any()))
        if state is TrackingState.GOOD and (reason := self._doubt(fit, pull, depth[kept])):
            state = TrackingState.DUBIOUS
        concealed = hidden(expected.uv[counted], depth[counted], kept[counted])
        return Track(
            T_cam_world.inverse(), state, rows=expected.rows[kept], uv=uv[kept], level=expected.level[kept],
            searched_rows=searched, information=fit.information, reason=reason, hidden_rows=searched[concealed],
            blurred=data.blurred, settled=fit.settled[kept], sigma_px=fit.sigma_px,
        )  # fmt: skip

    def _coarse(
        self, data: FrameData, view: MapView, pose: SE3, expected: Predictions, radius: float, pull: FloatArray
    ) -> SE3 | None:
        """The expected pose, or the pose from up to 80 coarse points found in a wide circle if that explains more of
        them; None when neither explains enough."""
        rows = np.flatnonzero(expected.level >= COARSE_LEVEL)
        if len(rows) < COARSE_MIN_FOUND:
            rows = np.flatnonzero(expected.level >= 1)
        if len(rows) > COARSE_POINTS:
            rows = np.sort(self._rng.permutation(rows)[:COARSE_POINTS])
        chosen = expected.take(rows)
        found, uv = find_patches(data.target, view.templates.patches, view.templates.offset, chosen, radius)
        if np.count_nonzero(found) < COARSE_MIN_FOUND:
            return None
        fitted = optimized(data, pose, view, chosen, found, uv, pull, FIRST).T_cam_world
        moved, _ = project_rows(data.camera, fitted.rotation, fitted.translation, view.points, chosen.rows, 0.0)
        before, after = (
            np.count_nonzero(np.linalg.norm(at - uv, axis=1)[found] < 0.5 * self._config.fine_radius_px)
            for at in (chosen.uv, moved)
        )
        if max(before, after) < COARSE_MIN_FOUND:
            return None
        return fitted if after > before else pose

    def _choose(self, expected: Predictions) -> Predictions:
        """At most ``max_points``: coarse levels first, the rest at random."""
        n = len(expected.rows)
        if n <= self._config.max_points:
            return expected
        order = self._rng.permutation(n)
        order = order[np.argsort(-expected.level[order], kind="stable")]
        return expected.take(np.sort(order[: self._config.max_points]))

    def _fine(
        self, data: FrameData, view: MapView, pose: SE3, expected: Predictions, radius: float, pull: FloatArray
    ) -> tuple[PoseEstimate, Pixels, BoolArray]:
        """Pose from all expected points: (pose, uv (S, 2), which of them (S,) are in the image). Points that the
        first pose does not explain are searched again around it for a better pose; all points, if it lies far from
        the start."""
        looks = view.templates
        templates, usable = warp_templates(looks.patches, looks.offset, expected.template, expected.inverse_warp)
        found, uv = search(data.target, templates, usable, expected.level, expected.uv, radius, 0)
        fit = optimized(data, pose, view, expected, found, uv, pull, FIRST)
        kept, pose = fit.weights > 0, fit.T_cam_world
        # With odometry the pose is good enough for the second search, which finds points without corners.
        if np.count_nonzero(kept) < MIN_FIRST and not pull.any():
            return fit, uv, np.ones(len(uv), np.bool_)
        where, inside = project_rows(
            data.camera, pose.rotation, pose.translation, view.points, expected.rows, MARGIN_PX
        )
        shift = np.abs(where - expected.uv)[inside]
        if shift.sum() > AGAIN_RADIUS_PX * shift.size:
            kept = np.zeros(len(uv), np.bool_)
        left = inside & ~kept & usable
        found, more = search(data.target, templates, left, expected.level, where, AGAIN_RADIUS_PX, AGAIN_REACH)
        uv = np.where(kept[:, None], uv, more)
        return optimized(data, pose, view, expected, kept | found, uv, pull, SECOND), uv, kept | inside

    def _judge(self, data: FrameData, found: int, searched: int, guided: bool) -> tuple[TrackingState, str]:
        """The verdict; a blurred image is never GOOD."""
        state, reason = self._judge_sharp(found, searched, len(data.corners.positions), guided)
        if not data.blurred:
            return state, reason
        state = TrackingState.LOST if state is TrackingState.LOST else TrackingState.DUBIOUS
        return state, "; ".join(filter(None, ["the image is blurred", reason]))

    def _doubt(self, fit: PoseEstimate, pull: FloatArray, depth: FloatArray) -> str:
        """Why a pose is unreliable though its points, at these depths (F,), were found; empty if it is reliable."""
        if fit.sigma_px > self._config.max_residual_px:
            return f"found points miss their places by {fit.sigma_px:.1f} px"
        information = fit.information + np.diag(pull + TINY)
        x, y, z, *_ = np.linalg.inv(information).diagonal().tolist()
        share = math.sqrt(x + y + z) / float(np.median(depth))  # in a mean, few far points outweigh the rest
        if share > self._config.max_sigma_ratio:
            return f"found points leave the position open by {100.0 * share:.0f} % of their distance"
        return ""

    def _judge_sharp(self, found: int, searched: int, corners: int, guided: bool) -> tuple[TrackingState, str]:
        """The verdict for a sharp image. With odometry fewer points are enough, if most of them are found."""
        config, share = self._config, found / max(1, searched)
        if guided and found < config.min_found and found >= FEW and share > FEW_RATIO:
            return TrackingState.DUBIOUS, f"only {found} points in view"
        if found < config.min_found or share < config.lost_ratio:
            if corners < 50:
                return TrackingState.LOST, f"the image shows nothing to hold on to ({corners} corners)"
            return TrackingState.LOST, f"{found} of {searched} expected points found"
        if share < config.good_ratio:
            return TrackingState.DUBIOUS, f"only {found} of {searched} expected points found"
        return TrackingState.GOOD, ""


def optimized(
    data: FrameData,
    start: SE3,
    view: MapView,
    predictions: Predictions,
    found: BoolArray,
    uv: Pixels,
    prior: FloatArray,
    effort: tuple[int, int],
) -> PoseEstimate:
    """Gauss-Newton with Tukey weights (PTAM 1.4) from the predictions found (S,) at uv (S, 2) px. prior (6,): diagonal
    information that pulls towards the start; effort: iterations that accept large residuals, and iterations in all."""
    R, t, weights, information, sigma_px = optimize_pose(
        data.camera, start.rotation, start.translation, view.points, predictions.rows, uv, predictions.level, found,
        prior, *effort, SIGMA_MIN_PX, SIGMA_MAX_PX,
    )  # fmt: skip
    return PoseEstimate(SE3(R, t), weights, information, sigma_px)


def hidden(uv: Pixels, depth: FloatArray, found: BoolArray) -> BoolArray:
    """Which points at uv (S, 2) px, depth (S,) m are not found and 25 % behind a found one in their 16 px cell."""
    cells = (uv // HIDING_CELL_PX).astype(np.int64)
    at = cells @ (1, 1 + cells[:, 0].max(initial=0))
    nearest = np.full(at.max(initial=0) + 1, np.inf)
    np.minimum.at(nearest, at[found], depth[found])
    return np.asarray(~found & (depth > BEHIND * nearest[at]))


def predicted(camera: FloatArray, T_cam_world: SE3, view: MapView, rows: IntArray) -> Predictions:
    """Which of the points (rows) are visible from a pose, and where. camera (CAMERA,): the image's."""
    return Predictions._make(
        predict(
            camera, T_cam_world.rotation, T_cam_world.translation, view.points, rows, view.templates.of_point,
            view.templates.source, view.templates.basis, view.R_world_cam, view.centres, MARGIN_PX,
        )
    )  # fmt: skip
