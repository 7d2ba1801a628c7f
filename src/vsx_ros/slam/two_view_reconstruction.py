"""A map from two views: motion from images and odometry, metric scale (paper 3.1). It takes longer than a frame, so the
mapper does it."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Pixels, Points3
from vsx_ros.config.maps import InitializationConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.epipolar import epipolar_error, essential_matrix, two_view_motions
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.geometry.two_view_certainty import certainty, every_motion, pure_rotation
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.kernels.slam.bundle import START, adjust
from vsx_ros.kernels.slam.factors import no_factors, no_floor
from vsx_ros.kernels.slam.schur import BundleObservations
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.slam.point_creation import Candidates, TargetMatches, checked_points

MAX_DIRECTION_ERROR_RAD = math.radians(20.0)  # from odometry; at a short baseline images measure it poorly
MAX_ROTATION_ERROR_RAD = math.radians(4.0)  # images measure rotation far better than direction
# Two different motions explain the images equally: least share of the best one's support, and least angle.
RIVAL, DIFFERENT_RAD = 0.92, math.radians(15.0)


TRAIL_SIGMA_PX = 0.2  # least error of followed corners, with that of lens and shutter


class InitialPair(NamedTuple):
    """Two frames to make a map from. T_world_first: pose that the first shall have; odometry: T_second_first of the
    cameras by odometry, None without. candidates: N corners of the first, uv (N, 2): their pixels in the second.
    odom_segment: that of the new keyframes."""

    first: FrameData
    second: FrameData
    T_world_first: SE3
    odometry: SE3 | None
    candidates: Candidates
    uv: Pixels
    odom_segment: int = 0


class InitialMap(NamedTuple):
    """The poses T_world_cam of a pair's frames, and the first one's candidates found in the second."""

    pair: InitialPair
    poses: tuple[SE3, SE3]
    matches: TargetMatches


class MotionHypothesis(NamedTuple):
    """T_b_a refined; support: how well it explains the matches, 1 for perfectly; points_a (N, 3), good (N,): usable."""

    T_b_a: SE3
    support: float
    points_a: Points3
    good: BoolArray


class TwoViewReconstruction:
    """Makes the first two keyframes of a map, or says why the images do not allow it yet."""

    def __init__(self, camera: PinholeCamera, config: InitializationConfig) -> None:
        self._camera, self._config = camera, config

    def reconstruct(self, pair: InitialPair) -> InitialMap | str:
        """Limited work: a handful of hypotheses, each adjusted in few iterations."""
        config, odometry = self._config, pair.odometry
        rays_a, rays_b = pair.candidates.rays, unproject_pixels(pair.second.camera, pair.uv)
        tolerance = 1.0 / min(self._camera.focal_px)
        hypotheses = two_view_motions(rays_a, rays_b, tolerance)
        scale, parallax = config.unit_baseline_m, config.min_parallax_without_odometry_deg
        if odometry is not None:
            scale, parallax = float(np.linalg.norm(odometry.translation)), config.min_parallax_deg
            hypotheses.append(SE3(odometry.rotation, odometry.translation / scale))
        else:
            hypotheses += every_motion(pure_rotation(rays_a, rays_b)[0], rays_a, rays_b, TRAIL_SIGMA_PX * tolerance)
        maps = [self._refine(T, rays_a, rays_b, tolerance, math.radians(parallax)) for T in hypotheses]
        if not maps:
            return "no rigid motion explains the corners"
        best = self._choose(maps, odometry)
        if isinstance(best, str):
            return best
        if odometry is None and (doubt := self._doubt(best, rays_a, rays_b)):
            return doubt
        kept, T_world_a = np.flatnonzero(best.good), pair.T_world_first
        points = T_world_a @ (best.points_a[best.good] * scale)
        matches = TargetMatches(kept, pair.uv[best.good], pair.candidates.level[kept], points)
        return InitialMap(pair, (T_world_a, T_world_a @ best.T_b_a.scaled(scale).inverse()), matches)

    def _choose(self, maps: list[MotionHypothesis], odometry: SE3 | None) -> MotionHypothesis | str:
        """The hypothesis that explains the matches best, or a reason if it has too few usable points, contradicts
        odometry or has an equal rival. (Usable points do not rank them: a wrong motion sees parallax everywhere.)"""
        needed = self._config.min_matches
        ranked = sorted(maps, key=lambda m: -m.support)
        if odometry is not None:
            agreeing = [m for m in ranked if _disagreement(m.T_b_a, odometry) == ""]
            if not agreeing:
                return f"odometry disagrees with the images: {_disagreement(ranked[0].T_b_a, odometry)}"
            ranked = agreeing
        best, *rivals = ranked
        if (count := int(best.good.sum())) < needed:
            few = f"too little parallax: {count} points of the {needed} needed"
            return f"{few}; the camera turns in place or has not moved far enough"
        strong = [rival for rival in rivals if odometry is None and rival.support > RIVAL * best.support]
        if any(_differ(best.T_b_a, rival.T_b_a) for rival in strong):
            return "two motions explain this flat scene equally well; move on to another viewpoint"
        return best

    def _doubt(self, best: MotionHypothesis, rays_a: FloatArray, rays_b: FloatArray) -> str:
        """Why the images do not determine this motion and its depths, empty when they do."""
        config, focal = self._config, min(self._camera.focal_px)
        found = certainty(best.T_b_a, rays_a[best.good], rays_b[best.good], TRAIL_SIGMA_PX / focal)
        flow = float(np.median(pure_rotation(rays_a, rays_b)[1]))
        if flow < config.min_flow_sigmas * found.noise:
            told = f"{focal * flow:.1f} px beyond a rotation, with noise of {focal * found.noise:.1f} px"
            return f"too little motion: corners moved {told}; move the camera on sideways"
        direction_deg, depth = math.degrees(found.direction_rad), float(np.median(found.log_depth))
        if direction_deg <= config.max_direction_sigma_deg and depth <= config.max_depth_sigma_ratio:
            return ""
        told = f"the direction of motion within {direction_deg:.1f} deg, depths within {100.0 * depth:.0f} %"
        return f"too uncertain: the images tell {told}; move the camera on sideways"

    def _refine(
        self, T_b_a: SE3, rays_a: FloatArray, rays_b: FloatArray, tolerance: float, parallax: float
    ) -> MotionHypothesis:
        """Two-view adjustment of one hypothesis in few iterations, and the points that pass the checks."""
        E_error = epipolar_error(essential_matrix(T_b_a), rays_a, rays_b).max(axis=1)
        strict, loose, anywhere = 2.0 * tolerance, 6.0 * tolerance, (0.0, 1e6)
        points, keep = checked_points(T_b_a, rays_a, rays_b, (loose, loose), anywhere, math.radians(0.2))
        keep &= E_error < loose**2
        if int(keep.sum()) >= 12:
            T_b_a = self._adjust(T_b_a, points[keep], rays_a[keep], rays_b[keep])
        points, good = checked_points(T_b_a, rays_a, rays_b, (strict, strict), anywhere, parallax)
        _, possible = checked_points(T_b_a, rays_a, rays_b, (strict, strict), anywhere, 0.0)
        error = epipolar_error(essential_matrix(T_b_a), rays_a, rays_b).max(axis=1) / tolerance**2
        support = float(np.where(possible, np.maximum(0.0, 1.0 - error), 0.0).mean())
        return MotionHypothesis(T_b_a, support, points, good)

    def _adjust(self, T_b_a: SE3, points: Points3, rays_a: FloatArray, rays_b: FloatArray) -> SE3:
        n, f = len(points), min(self._camera.focal_px)
        R, t = stacked([SE3.identity(), T_b_a])
        xy = np.stack([rays_a, rays_b], axis=1).reshape(-1, 2) * f
        start, point, frame = np.arange(0, 2 * n + 1, 2), np.repeat(np.arange(n), 2), np.tile([0, 1], n)
        observed = BundleObservations(start=start, point=point, frame=frame, xy=xy, weight=np.ones(2 * n))
        K, free = np.array([f, f, 0.0, 0.0]), np.array([-1, 0])
        R, t, *_ = adjust(K, R, t, free, points, observed, no_factors(), no_floor(), 12, 0.3, START)
        return SE3(R[1], t[1] / max(float(np.linalg.norm(t[1])), 1e-12))


def _differ(a: SE3, b: SE3) -> bool:
    """Whether two motions with unit translation lead to different scenes."""
    return _angle(a.translation, b.translation) > DIFFERENT_RAD or a.rotation_angle_to(b) > math.radians(2.0)


def _angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between unit vectors (3,) [rad]."""
    return math.acos(min(1.0, max(-1.0, float(a @ b))))


def _disagreement(T_b_a: SE3, odometry: SE3) -> str:
    """How a visual motion (unit translation) and odometry disagree, in words; empty when they agree."""
    rotation = T_b_a.rotation_angle_to(odometry)
    angle = _angle(odometry.translation / np.linalg.norm(odometry.translation), T_b_a.translation)
    if rotation > MAX_ROTATION_ERROR_RAD:
        return f"rotation differs by {math.degrees(rotation):.1f} deg; check the odometry and the camera mount"
    if angle > MAX_DIRECTION_ERROR_RAD:
        return f"direction differs by {math.degrees(angle):.0f} deg; check the odometry and the camera mount"
    return ""
