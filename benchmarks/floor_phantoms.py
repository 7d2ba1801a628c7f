"""Finds phantom obstacles of a ground map that come from corners that are truly on the floor."""

from collections.abc import Sequence

import numpy as np
from planes import Face, faces_of

from vsx_ros.evaluation.map_quality import TOLERANCE_M, metres_to, on_truth
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.sim.world import World
from vsx_ros.slam.snapshot import MapSnapshot

FLOOR_M = 0.01
PATCH_PX = 8


def first_hits(faces: list[Face], eyes: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(N, 3) where rays (N, 3) from eyes (N, 3) hit the first face; infinite if none."""
    least = np.full(len(rays), np.inf)
    for face in faces:
        slope = rays @ face.normal
        with np.errstate(all="ignore"):
            far = (face.offset - eyes @ face.normal) / slope
            away = face.distances(eyes + far[:, None] * rays, -rays)
        nearer = (slope < 0.0) & (far > 0.0) & (far < least) & (away < 1e-6)
        least[nearer] = far[nearer]
    return eyes + least[:, None] * rays


def on_floor(world: World, snapshot: MapSnapshot, poses: Sequence[SE3], camera: PinholeCamera) -> np.ndarray:
    """(M,) whether most observations of each point show only floor, without an edge of something in front: their rays
    and those of their patches' corners all hit the floor. poses: the keyframes' true ones."""
    T_start_world = SE3.from_se2(world.start_pose).inverse()
    cameras = [T_start_world @ pose for pose in poses]
    R, t = np.array([T.rotation for T in cameras]), np.array([T.translation for T in cameras])
    faces, on = faces_of(world), np.ones(len(snapshot.obs_uv), np.bool_)
    half_px = 0.5 * PATCH_PX * np.exp2(snapshot.obs_level[:, None], dtype=np.float64)
    for corner in ((0.0, 0.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
        rays = camera.unproject(snapshot.obs_uv + np.array(corner) * half_px)
        turned = np.einsum("nij,nj->ni", R[snapshot.obs_keyframe], rays)
        on &= first_hits(faces, t[snapshot.obs_keyframe], turned)[:, 2] < FLOOR_M
    n = len(snapshot.points_world)
    return np.bincount(snapshot.obs_point, on, n) > 0.5 * np.bincount(snapshot.obs_point, minlength=n)


def floor_phantom_m2(
    grid: OccupancyGrid, truth: OccupancyGrid, world: World, snapshot: MapSnapshot, poses: Sequence[SE3],
    camera: PinholeCamera,
) -> float:  # fmt: skip
    """Area [m2] of phantom cells from floor: over 10 cm from any obstacle, and more than half of the obstacle points in
    and beside them are floor."""
    wrong = (on_truth(grid, truth, world.start_pose) == OCCUPIED) & (truth.data == FREE)
    wrong &= metres_to(truth.data == OCCUPIED, truth) > TOLERANCE_M
    high = snapshot.points_world[:, 2] > 0.06
    cells = truth.cells(world.start_pose @ snapshot.points_world[high, :2])
    floor = on_floor(world, snapshot, poses, camera)[high]
    shares = [floor[np.abs(cells - cell).max(axis=1) <= 1] for cell in np.argwhere(wrong)]
    return sum(bool(len(share) and share.mean() > 0.5) for share in shares) * truth.resolution**2
