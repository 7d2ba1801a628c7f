"""Bundle adjustment of a part of the map: the n nearest keyframes (paper 3.1) or all of it, with odometry and
floor factors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.config import WheelConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.bundle import adjust
from vsx_ros.kernels.floor import Floor, no_floor
from vsx_ros.kernels.pose import TUKEY
from vsx_ros.slam.map import Map

SIGMA_MIN_PX = 0.4


class Adjustment(NamedTuple):
    """sigma_px: robust residual scale reached. outliers: observations removed. dead: points removed."""

    sigma_px: float
    outliers: int
    dead: int


class OdometryFactor(NamedTuple):
    """Measured T_a_b between two cameras and its information (6, 6) in the tangent of ``bundle.relative_residual``."""

    T_a_b: SE3
    information: FloatArray


def adjoint(T: SE3) -> FloatArray:
    """(6, 6) matrix that moves a tangent vector (rho, omega) from the right of T to its left."""
    R, (x, y, z) = T.rotation, T.translation
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R
    out[:3, 3:] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ R
    return out


def odometry_factor(motion: SE2, T_base_cam: SE3, wheels: WheelConfig) -> OdometryFactor:
    """Factor of a wheel-measured base motion between two images."""
    T_a_b = T_base_cam.inverse() @ SE3.from_se2(motion) @ T_base_cam
    distance, turn = float(np.hypot(motion.x, motion.y)), abs(motion.theta)
    along = wheels.distance_sigma_m + wheels.distance_sigma_ratio * distance
    across = wheels.distance_sigma_m + wheels.sideways_sigma_ratio * distance
    yaw = wheels.turn_sigma_rad + wheels.turn_sigma_ratio * turn
    tilt = wheels.tilt_sigma_rad + wheels.turn_sigma_ratio * turn
    sigma = np.array([along, across, across, tilt, tilt, yaw])
    to_base = adjoint(T_base_cam)
    return OdometryFactor(T_a_b, to_base.T @ np.diag(1.0 / sigma**2) @ to_base)


class BundleAdjuster:
    """Selects keyframes, points and factors, solves, writes back and removes what does not fit."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, wheels: WheelConfig) -> None:
        self._K = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._T_base_cam = T_base_cam
        self._wheels = wheels

    def adjust(self, world: Map, free: list[int], iterations: int) -> Adjustment:
        """Move the keyframes ``free`` (indices) and all points they see; every other keyframe that sees these points
        holds them in place. Keyframe 0 never moves, but that it is levelled where the world's floor is known: its
        first tilt is the mount's, which is wrong by a little, and would lean the world."""
        free = [k for k in free if world.keyframes[k].alive]
        free = sorted(set(free) if self._knows_floor(world) else set(free) - {0})
        seen = np.zeros(world.count, np.bool_)
        for index in free:
            seen[world.keyframes[index].observations.rows] = True
        frames = [
            k for k, keyframe in enumerate(world.keyframes) if k in free or seen[keyframe.observations.rows].any()
        ]
        point, frame, xy, weight = self._observations(world, frames, seen)
        counts = np.bincount(point, minlength=world.count)
        keep = counts[point] >= 2
        point, frame, xy, weight = point[keep], frame[keep], xy[keep], weight[keep]
        if not free or len(point) < 12:
            return Adjustment(0.0, 0, 0)
        rows, local = np.unique(point, return_inverse=True)
        order = np.lexsort((frame, local))
        local, frame = local[order], frame[order]
        number = {k: i for i, k in enumerate(free)}
        T_cam_world = [world.keyframes[k].T_world_cam.inverse() for k in frames]
        R, t, points, squared, sigma, _ = adjust(
            self._K,
            np.array([T.rotation for T in T_cam_world]),
            np.array([T.translation for T in T_cam_world]),
            np.array([number.get(k, -1) for k in frames], np.int64),
            world.points[rows],
            np.searchsorted(local, np.arange(len(rows) + 1)),
            local,
            frame,
            xy[order],
            weight[order],
            *self._factors(world, frames, set(free)),
            self._floor(world, frames),
            iterations,
            SIGMA_MIN_PX,
        )
        for position, k in enumerate(frames):
            if k in number:
                world.move_keyframe(k, SE3(R[position], t[position]).inverse())
        world.points[rows] = points
        bad = squared > (TUKEY * sigma) ** 2
        dead = self._discard(world, np.array(frames)[frame[bad]], rows[local[bad]])
        for k in free:
            world.update_depth(k)
        return Adjustment(float(sigma), int(bad.sum()), dead)

    def _observations(
        self, world: Map, frames: list[int], seen: BoolArray
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        parts = []
        for position, k in enumerate(frames):
            observed = world.keyframes[k].observations
            mask = seen[observed.rows]
            rows = observed.rows[mask]
            parts.append((rows, np.full(len(rows), position), observed.ideal[mask], 0.5 ** observed.level[mask]))
        if not parts:
            return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0)
        point, frame, xy, weight = (np.concatenate(column) for column in zip(*parts))
        return point, frame, xy, weight.astype(float)

    def by_wheels(self, world: Map, index: int) -> OdometryFactor | None:
        """The odometry factor between a keyframe and its predecessor, None without odometry."""
        previous = world.predecessor(index)
        before = None if previous is None else world.keyframes[previous].data.T_odom_base
        now = world.keyframes[index].data.T_odom_base
        if self._T_base_cam is None or before is None or now is None:
            return None
        return odometry_factor(before.inverse() @ now, self._T_base_cam, self._wheels)

    def _factors(
        self, world: Map, frames: list[int], free: set[int]
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Arrays of the odometry factors between successive keyframes of which at least one moves."""
        where = {k: i for i, k in enumerate(frames)}
        found: list[tuple[int, int, OdometryFactor]] = []
        for k in frames:
            factor, previous = self.by_wheels(world, k), world.predecessor(k)
            if factor is not None and previous in where and (k in free or previous in free):
                found.append((where[previous], where[k], factor))
        n = len(found)
        a, b = np.array([f[0] for f in found], np.int64), np.array([f[1] for f in found], np.int64)
        R = np.array([f[2].T_a_b.rotation for f in found]).reshape(n, 3, 3)
        t = np.array([f[2].T_a_b.translation for f in found]).reshape(n, 3)
        return a, b, R, t, np.array([f[2].information for f in found]).reshape(n, 6, 6)

    def _knows_floor(self, world: Map) -> bool:
        return self._T_base_cam is not None and world.keyframes[0].data.T_odom_base is not None

    def _floor(self, world: Map, frames: list[int]) -> Floor:
        """The floor under all keyframes with odometry, when the world's frame has been made by it."""
        if self._T_base_cam is None or not self._knows_floor(world):
            return no_floor()
        standing = [i for i, k in enumerate(frames) if world.keyframes[k].data.T_odom_base is not None]
        tilt = self._wheels.floor_tilt_sigma_rad
        return Floor(
            np.array(standing, np.int64),
            np.array(self._T_base_cam.rotation),
            np.array(self._T_base_cam.inverse().translation),
            np.array([self._wheels.floor_height_sigma_m, tilt, tilt]),
            frames.index(0) if 0 in frames else -1,
        )

    def _discard(self, world: Map, frames: IntArray, rows: IntArray) -> int:
        """Forget the given observations; remove points left with fewer than two or without their source."""
        marked = np.zeros(world.count, np.bool_)
        for k in np.unique(frames):
            marked[:] = False
            marked[rows[frames == k]] = True
            world.forget(int(k), marked[world.keyframes[k].observations.rows])
        touched = np.unique(rows)
        left = np.zeros(world.count, np.int64)
        for keyframe in world.keyframes:
            left[keyframe.observations.rows] += 1
        lost_source = rows[frames == world.source[rows]]
        dead = np.union1d(touched[left[touched] < 2], lost_source)
        world.remove_points(dead)
        return len(dead)
