"""Starting a map from a straight drive: two frames, their motion from image and wheels, metric scale (paper 3.1)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, GrayImage, IntArray, Pixels, Points3
from vsx_ros.config import InitializationConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.epipolar import epipolar_error, essential_matrix, two_view_motions
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.bundle import START, adjust
from vsx_ros.kernels.floor import no_floor
from vsx_ros.kernels.projection import unproject_pixels
from vsx_ros.kernels.relative_pose import no_factors
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations
from vsx_ros.slam.point_creation import Candidates, TargetMatches, candidates_in, checked_points

TRAILS = 600
STILL_PX = 2.0
START_PX = 10.0
MAX_DIRECTION_ERROR_RAD = math.radians(20.0)
MAX_ROTATION_ERROR_RAD = math.radians(4.0)
RIVAL, DIFFERENT_RAD = 0.92, math.radians(15.0)


class Initialization(NamedTuple):
    """Two frames with poses T_world_cam, and the first one's candidates with their matches in the second."""

    first: FrameData
    second: FrameData
    poses: tuple[SE3, SE3]
    matches: TargetMatches
    candidates: Candidates


class TwoViewMap(NamedTuple):
    """A motion hypothesis refined: T_b_a, support: how well it explains the matches, 1 for perfectly, points_a (N, 3),
    good (N,): usable ones."""

    T_b_a: SE3
    support: float
    points_a: Points3
    good: BoolArray


class Initializer:
    """Feed frames to ``add`` until it returns an Initialization; before that it returns why not yet."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: InitializationConfig) -> None:
        self._camera = camera
        self._T_base_cam = T_base_cam
        self._config = config
        self._reference: FrameData | None = None

    def add(self, data: FrameData) -> Initialization | str:
        """Follow the reference frame's corners into this frame and start the map when the two allow it."""
        if self._reference is None:
            return self._restart(data, "the first frame was taken; drive straight ahead")
        self._follow(data)
        wanted = max(self._config.min_matches, len(self._candidates.uv) // 4)
        if len(self._index) < wanted:
            return self._restart(data, f"sees too little: {len(self._index)} corners followed, {wanted} needed")
        motion = self._wheel_motion(data)
        refusal = self._too_early(data) if motion is None else self._wheels_refuse(data)
        return refusal if refusal else self._attempt(data, motion)

    def _restart(self, data: FrameData, reason: str) -> str:
        keyframe = KeyFrame(0, data, SE3.identity(), Observations.none(), 0.0)
        self._reference = self._last = data
        self._candidates = candidates_in(keyframe, TRAILS)
        self._index: IntArray = np.arange(len(self._candidates.uv))
        self._positions: Pixels = self._candidates.uv.copy()
        return reason

    def _follow(self, data: FrameData) -> None:
        """Extend the trails by one frame, then measure them against the reference patch so that they do not drift."""
        before, now = self._last.pyramid.level(0), data.pyramid.level(0)
        moved, ok = _flow(before, now, self._positions, self._positions)
        self._index, moved = self._index[ok], moved[ok]
        assert self._reference is not None
        start = self._candidates.uv[self._index]
        direct, sure = _flow(self._reference.pyramid.level(0), now, start, moved)
        sure &= np.linalg.norm(direct - moved, axis=1) < 3.0
        self._positions = np.where(sure[:, None], direct, moved)
        self._sure: BoolArray = sure
        self._last = data

    def _wheel_motion(self, data: FrameData) -> SE3 | None:
        """T_second_first of the cameras as the wheels have it."""
        assert self._reference is not None
        if self._T_base_cam is None or data.T_odom_base is None or self._reference.T_odom_base is None:
            return None
        motion = SE3.from_se2(data.T_odom_base.inverse() @ self._reference.T_odom_base)
        return self._T_base_cam.inverse() @ motion @ self._T_base_cam

    def _wheels_refuse(self, data: FrameData) -> str:
        assert self._reference is not None
        assert self._reference.T_odom_base is not None
        assert data.T_odom_base is not None
        driven = self._reference.T_odom_base.distance_to(data.T_odom_base)
        turned = abs(math.degrees(self._reference.T_odom_base.angle_to(data.T_odom_base)))
        config = self._config
        if turned > config.max_turn_deg:
            return self._restart(data, f"turns: {turned:.0f} deg over {driven:.2f} m; drive straight to start")
        if driven > config.baseline_max_m:
            return self._restart(data, f"no start: {driven:.2f} m driven straight in vain; trying again from here")
        if driven < 0.01:
            return "stands still: the wheels have not moved; drive straight ahead to start"
        if driven < config.baseline_m:
            return f"not far enough: has driven {driven:.2f} m of the {config.baseline_m:.2f} m needed to start"
        return ""

    def _too_early(self, data: FrameData) -> str:
        shift = float(np.median(np.linalg.norm(self._positions - self._candidates.uv[self._index], axis=1)))
        if shift < STILL_PX:
            return f"camera stands still: corners moved {shift:.1f} px in all; move it sideways or ahead"
        if shift < START_PX:
            return f"too little motion: corners moved {shift:.1f} px of the {START_PX:.0f} px needed to start"
        return ""

    def _attempt(self, data: FrameData, wheels: SE3 | None) -> Initialization | str:
        """Two-view reconstruction; a reason when it is not good enough yet."""
        assert self._reference is not None
        index = self._index[self._sure]
        if len(index) < self._config.min_matches:
            return f"sees too little: {len(index)} corners match the first frame"
        uv_b = np.ascontiguousarray(self._positions[self._sure])
        rays_a, rays_b = self._candidates.rays[index], unproject_pixels(data.camera, uv_b)
        tolerance = 1.0 / self._camera.fx
        motions = two_view_motions(rays_a, rays_b, tolerance)
        hypotheses = list(motions.T_b_a)
        if wheels is not None:
            size = float(np.linalg.norm(wheels.translation))
            hypotheses.append(SE3(wheels.rotation, wheels.translation / size))
        config = self._config
        parallax = config.min_parallax_without_odometry_deg if wheels is None else config.min_parallax_deg
        maps = [self._refine(T, rays_a, rays_b, tolerance, math.radians(parallax)) for T in hypotheses]
        if not maps:
            return "no rigid motion explains the corners"
        best = self._choose(maps, wheels)
        if isinstance(best, str):
            return best
        scale = self._config.unit_baseline_m if wheels is None else float(np.linalg.norm(wheels.translation))
        return self._initialization(data, best, scale, index, uv_b)

    def _choose(self, maps: list[TwoViewMap], wheels: SE3 | None) -> TwoViewMap | str:
        """The hypothesis that explains the matches best, if it has enough usable points and is not contradicted by the
        wheels or by an equal rival. (Usable points do not rank them: a wrong motion sees parallax everywhere.)"""
        needed = self._config.min_matches
        ranked = sorted(maps, key=lambda m: -m.support)
        if wheels is not None:
            agreeing = [m for m in ranked if _disagreement(m.T_b_a, wheels) == ""]
            if not agreeing:
                return f"odometry disagrees with the images: {_disagreement(ranked[0].T_b_a, wheels)}"
            ranked = agreeing
        best = ranked[0]
        count = int(best.good.sum())
        if count < needed:
            return (
                f"too little parallax: {count} points of the {needed} needed; the camera turns in place or has not "
                "moved far enough"
            )
        for rival in ranked[1:] if wheels is None else ():
            if _differ(best.T_b_a, rival.T_b_a) and rival.support > RIVAL * best.support:
                return "two motions explain this flat scene equally well; move on to another viewpoint"
        return best

    def _refine(
        self, T_b_a: SE3, rays_a: FloatArray, rays_b: FloatArray, tolerance: float, parallax: float
    ) -> TwoViewMap:
        """Capped two-view adjustment of one hypothesis, and the points that stand the checks."""
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
        return TwoViewMap(T_b_a, support, points, good)

    def _adjust(self, T_b_a: SE3, points: Points3, rays_a: FloatArray, rays_b: FloatArray) -> SE3:
        n, f = len(points), self._camera.fx
        R = np.array([np.eye(3), T_b_a.rotation])
        t = np.array([np.zeros(3), T_b_a.translation])
        xy = np.stack([rays_a, rays_b], axis=1).reshape(-1, 2) * f
        R, t, *_ = adjust(
            np.array([f, f, 0.0, 0.0]),
            R,
            t,
            np.array([-1, 0]),
            points,
            np.arange(0, 2 * n + 1, 2),
            np.repeat(np.arange(n), 2),
            np.tile([0, 1], n),
            xy,
            np.ones(2 * n),
            no_factors(),
            no_floor(),
            12,
            0.3,
            START,
        )
        return SE3(R[1], t[1] / max(float(np.linalg.norm(t[1])), 1e-12))

    def _initialization(
        self, data: FrameData, found: TwoViewMap, scale: float, index: IntArray, uv_b: Pixels
    ) -> Initialization:
        assert self._reference is not None
        first = SE3.identity()
        if self._T_base_cam is not None and self._reference.T_odom_base is not None:
            first = SE3.from_se2(self._reference.T_odom_base) @ self._T_base_cam
        T_b_a = SE3(found.T_b_a.rotation, found.T_b_a.translation * scale)
        kept = index[found.good]
        matches = TargetMatches(
            kept, uv_b[found.good], self._candidates.level[kept], first @ (found.points_a[found.good] * scale)
        )
        return Initialization(self._reference, data, (first, first @ T_b_a.inverse()), matches, self._candidates)


def _flow(before: GrayImage, now: GrayImage, start: Pixels, guess: Pixels) -> tuple[Pixels, BoolArray]:
    """Pyramidal Lucas-Kanade with a backward check: (positions (N, 2), kept (N,))."""
    if not len(start):
        return guess, np.zeros(0, np.bool_)
    options: dict[str, Any] = {
        "winSize": (15, 15),
        "maxLevel": 3,
        "criteria": (3, 20, 0.01),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }
    a, b = start.astype(np.float32), guess.astype(np.float32)
    forward, ok, _ = cv2.calcOpticalFlowPyrLK(before, now, a, b.copy(), **options)
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(now, before, forward, a.copy(), **options)
    height, width = now.shape
    inside = (forward >= 4).all(axis=1) & (forward[:, 0] < width - 5) & (forward[:, 1] < height - 5)
    close = np.linalg.norm(back - a, axis=1) < 0.7
    return forward.astype(np.float64), (ok.ravel() > 0) & (ok_back.ravel() > 0) & inside & close


def _differ(a: SE3, b: SE3) -> bool:
    """Whether two motions with unit translation lead to different scenes."""
    angle = math.acos(min(1.0, max(-1.0, float(a.translation @ b.translation))))
    return angle > DIFFERENT_RAD or a.rotation_angle_to(b) > math.radians(2.0)


def _disagreement(T_b_a: SE3, wheels: SE3) -> str:
    """What a visual motion (unit translation) and the wheels disagree about; empty when they agree."""
    rotation = T_b_a.rotation_angle_to(wheels)
    direction = wheels.translation / np.linalg.norm(wheels.translation)
    angle = math.acos(min(1.0, max(-1.0, float(direction @ T_b_a.translation))))
    if rotation > MAX_ROTATION_ERROR_RAD:
        return f"rotation differs by {math.degrees(rotation):.1f} deg; check the odometry and the camera mount"
    if angle > MAX_DIRECTION_ERROR_RAD:
        return f"direction differs by {math.degrees(angle):.0f} deg; check the odometry and the camera mount"
    return ""
