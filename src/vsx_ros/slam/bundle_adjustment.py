"""Bundle adjustment of the n nearest keyframes (paper 3.1) or of the whole map, with odometry and floor factors."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.config.maps import OdometryNoiseConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, skew, stacked
from vsx_ros.kernels.slam.bundle import START, adjust
from vsx_ros.kernels.slam.factors import Factors, Floor, no_floor
from vsx_ros.kernels.slam.pose import TUKEY
from vsx_ros.kernels.slam.schur import BundleObservations
from vsx_ros.slam.gauge import size_kept
from vsx_ros.slam.held_points import carry_points
from vsx_ros.slam.keyframe import Observations
from vsx_ros.slam.map import Map

SIGMA_MIN_PX = 0.4  # px at level 0, as in the tracker: precision of the patch search
# Depth of a point in its source keyframe, in median depths there: beyond three times what new points may have, the
# point has run away along its rays.
DEPTH_RATIOS = (0.05, 24.0)
SLICE_OBSERVATIONS = 160_000  # times steps in one call; the mapper can be interrupted between calls


class OdometryFactor(NamedTuple):
    """Measured T_a_b between two cameras and its information (6, 6) in the tangent of ``bundle.relative_residual``."""

    T_a_b: SE3
    information: FloatArray


def adjoint(T: SE3) -> FloatArray:
    """(6, 6) matrix that moves a tangent vector (rho, omega) from the right of T to its left."""
    return np.block([[T.rotation, skew(T.translation) @ T.rotation], [np.zeros((3, 3)), T.rotation]])


def odometry_factor(motion: SE2, T_base_cam: SE3, noise: OdometryNoiseConfig) -> OdometryFactor:
    """Factor for the base motion that odometry measured between two images."""
    T_a_b = T_base_cam.inverse() @ SE3.from_se2(motion) @ T_base_cam
    distance, turn = float(np.hypot(motion.x, motion.y)), abs(motion.wrapped().theta)
    along = noise.distance_sigma_m + noise.distance_sigma_ratio * distance
    across = noise.distance_sigma_m + noise.sideways_sigma_ratio * distance
    yaw = noise.turn_sigma_rad + noise.turn_sigma_ratio * turn
    tilt = noise.tilt_sigma_rad + noise.turn_sigma_ratio * turn
    sigma = np.array([along, across, across, tilt, tilt, yaw])
    to_base = adjoint(T_base_cam)
    return OdometryFactor(T_a_b, to_base.T @ np.diag(1.0 / sigma**2) @ to_base)


class BundleAdjuster:
    """Selects keyframes, points and factors, solves, writes the result back and removes outliers."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, noise: OdometryNoiseConfig) -> None:
        self._K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._T_base_cam = T_base_cam
        self._noise = noise
        self._made: dict[tuple[SE2, SE2], OdometryFactor] = {}

    def adjust(
        self, world: Map, free: list[int], iterations: int, interrupted: Callable[[], bool] = lambda: False
    ) -> bool:
        """Adjust the keyframes ``free`` (indices) and all points they see. Other keyframes that see these points stay
        fixed; a point that fewer than two see moves with the keyframe that holds it. Keyframe 0 never moves; where the
        floor is known it is only levelled. (Its first tilt comes from the mount, which is slightly wrong and would tilt
        the world.)

        ``interrupted`` is called between slices of the work: a few iterations of a small problem, one of a large one.
        Returns whether the adjustment finished. If not, the map holds the progress so far and no outlier is removed."""
        free = [k for k in free if world.keyframes[k].alive]
        free = sorted(set(free) if self._knows_floor(world) else set(free) - {0})
        seen = world.sees(free)
        frames = sorted(set(world.observers(np.flatnonzero(seen))) | set(free))
        frames = [k for k in frames if k in free or seen[world.keyframes[k].observations.rows].any()]
        rows, observed = _observed(world, frames, seen)
        if not free or len(observed.frame) < 12:
            return True
        R, t, points, bad, finished = self._solve(world, frames, free, rows, observed, iterations, interrupted)
        if self._floats(world, frames, free):
            R, t, points = _resized(world, frames, free, R, t, points)
        before = {k: world.keyframes[k].T_world_cam for k in free}
        for k, pose in zip(frames, zip(R, t)):
            if k in free:
                world.move_keyframe(k, SE3(*pose).inverse())
        world.points[rows] = points
        carry_points(world, before, rows)
        if finished:
            _discard(world, np.array(frames)[observed.frame[bad]], rows[observed.point[bad]])
            world.remove_points(_ran_away(world, rows[world.alive[rows]]))
        for k in free:
            world.update_depth(k)
        return finished

    def _floats(self, world: Map, frames: list[int], free: list[int]) -> bool:
        """Whether nothing fixes the scale: at most one keyframe is fixed, and there is no odometry."""
        measured = any(world.keyframes[k].data.T_odom_base is not None for k in frames)
        return len(frames) - len(free) < 2 and not (self._T_base_cam is not None and measured)

    def _solve(
        self,
        world: Map,
        frames: list[int],
        free: list[int],
        rows: IntArray,
        observed: BundleObservations,
        iterations: int,
        interrupted: Callable[[], bool],
    ) -> tuple[FloatArray, FloatArray, Points3, BoolArray, bool]:
        """T_cam_world of the frames (R, t), the points (rows), which observations (O,) are outliers, and whether the
        adjustment finished."""
        number = {k: i for i, k in enumerate(free)}
        moving = np.array([number.get(k, -1) for k in frames], np.int64)
        R, t = stacked([world.keyframes[k].T_world_cam.inverse() for k in frames])
        factors, floor = self._factors(world, frames, set(free)), self._floor(world, frames)
        points, squared, sigma, progress, done = world.points[rows], np.zeros(0), 0.0, START, 0
        while done < iterations and not progress.done:
            trials = min(max(1, SLICE_OBSERVATIONS // len(observed.frame)), iterations - done)
            R, t, points, squared, sigma, _, progress = adjust(
                self._K, R, t, moving, points, observed, factors, floor, trials, SIGMA_MIN_PX, progress
            )
            done += trials
            if interrupted():
                break
        return R, t, points, squared > (TUKEY * sigma) ** 2, progress.done or done >= iterations

    def by_odometry(self, world: Map, index: int) -> OdometryFactor | None:
        """The factor between a keyframe and its predecessor; None without odometry or in a map that is not metric."""
        previous = world.predecessor(index)
        before = None if previous is None else world.keyframes[previous].data.T_odom_base
        now = world.keyframes[index].data.T_odom_base
        if self._T_base_cam is None or before is None or now is None:
            return None
        if not world.is_metric(world.keyframes[index].map_id):
            return None
        if (before, now) not in self._made:
            self._made[before, now] = odometry_factor(before.inverse() @ now, self._T_base_cam, self._noise)
        return self._made[before, now]

    def _factors(self, world: Map, frames: list[int], free: set[int]) -> Factors:
        """The odometry factors between successive keyframes, if at least one of the two moves."""
        where = {k: i for i, k in enumerate(frames)}
        found: list[tuple[int, int, OdometryFactor]] = []
        for k in frames:
            previous = world.predecessor(k)
            if previous in where and (k in free or previous in free):
                factor = self.by_odometry(world, k)
                if factor is not None:
                    found.append((where[previous], where[k], factor))
        n = len(found)
        pairs = np.array([(a, b) for a, b, _ in found], np.int64).reshape(n, 2)
        information = np.array([factor.information for _, _, factor in found]).reshape(n, 6, 6)
        R, t = stacked([factor.T_a_b for _, _, factor in found])
        return Factors(a=pairs[:, 0].copy(), b=pairs[:, 1].copy(), R=R, t=t, information=information)

    def _knows_floor(self, world: Map) -> bool:
        return self._T_base_cam is not None and world.is_metric(0)

    def _floor(self, world: Map, frames: list[int]) -> Floor:
        """The floor under all keyframes with odometry in metric maps."""
        if self._T_base_cam is None or not self._knows_floor(world):
            return no_floor()
        level = {map_id: world.is_metric(map_id) for map_id in {world.keyframes[k].map_id for k in frames}}
        keyframes = [world.keyframes[k] for k in frames]
        with_odometry = [k.data.T_odom_base is not None and level[k.map_id] for k in keyframes]
        tilt = self._noise.floor_tilt_sigma_rad
        return Floor(
            frames=np.flatnonzero(with_odometry),
            R_base_cam=np.array(self._T_base_cam.rotation),
            base_in_cam=np.array(self._T_base_cam.inverse().translation),
            sigma=np.array([self._noise.floor_height_sigma_m, tilt, tilt]),
            anchor=frames.index(0) if 0 in frames else -1,
        )


def _resized(
    world: Map, frames: list[int], free: list[int], R: FloatArray, t: FloatArray, points: Points3
) -> tuple[FloatArray, FloatArray, Points3]:
    """Adjusted keyframes (T_cam_world) and points, scaled about the fixed keyframe to their former size."""
    held = next((i for i, k in enumerate(frames) if k not in free), 0)
    before = np.array([world.keyframes[k].T_world_cam.translation for k in frames])
    after = -np.einsum("kji,kj->ki", R, t)
    factor, centre = size_kept(before, after, held), after[held]
    t = -np.einsum("kij,kj->ki", R, centre + factor * (after - centre))
    return R, t, centre + factor * (points - centre)


def _observed(world: Map, frames: list[int], seen: BoolArray) -> tuple[IntArray, BundleObservations]:
    """Rows (M,) of the points in ``seen`` (P,) that two or more keyframes of ``frames`` see, and the observations."""
    parts = [world.keyframes[k].observations for k in frames]
    every, frame = (
        Observations.concatenated(parts),
        np.repeat(np.arange(len(frames)), [len(part.rows) for part in parts]),
    )
    counts = np.bincount(every.rows, minlength=len(world.points))
    wanted = np.flatnonzero(seen & (counts >= 2))
    number = np.full(len(world.points), -1)
    number[wanted] = np.arange(len(wanted))
    local = number[every.rows]
    order = np.argsort(local, kind="stable")
    order = order[np.count_nonzero(local < 0) :]
    start = np.concatenate([[0], np.cumsum(counts[wanted])])
    scale: FloatArray = np.power(0.5, every.level[order])
    return wanted, BundleObservations(
        start=start, point=local[order], frame=frame[order], xy=every.ideal[order], weight=scale
    )


def _discard(world: Map, frames: IntArray, rows: IntArray) -> None:
    """Remove the given observations, then points left with fewer than two or without that of their source."""
    marked = np.zeros(len(world.points), np.bool_)
    for k in np.unique(frames):
        here = rows[frames == k]
        marked[here] = True
        world.forget(int(k), marked[world.keyframes[k].observations.rows])
        marked[here] = False
    touched = np.unique(rows)
    left = world.seen(touched)
    lost_source = rows[frames == world.source[rows]]
    world.remove_points(np.union1d(touched[left[touched] < 2], lost_source))


def _ran_away(world: Map, rows: IntArray) -> IntArray:
    """The points among ``rows`` behind their source keyframe, or at a depth there that no new point can have."""
    view, source, (least, most) = world.live_view(), world.source[rows], DEPTH_RATIOS
    depth = np.einsum("pi,pi->p", world.points[rows] - view.centres[source], view.R_world_cam[source, :, 2])
    usual = view.depths[source]
    away = (depth <= least * usual) | ((depth > most * usual) & (usual > 0.0))
    return np.asarray(rows[away])
