"""Surface cells as spots tied to the keyframes they were judged in, so that they move with a map that is adjusted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.dense.densify import DenseMap
from vsx_ros.dense.planes import Plane
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.slam.snapshot import MapSnapshot

_QUARTERS = np.array([[-0.25, -0.25], [-0.25, 0.25], [0.25, -0.25], [0.25, 0.25]])


class AnchoredSurface(NamedTuple):
    """points (N, 3): spots, in the camera frame of their keyframe [m]. keyframe (N,): its id. sigma_m (N,)."""

    points: Points3
    keyframe: NDArray[np.int64]
    sigma_m: FloatArray

    @staticmethod
    def of(dense: DenseMap, snapshot: MapSnapshot, cell_m: float) -> AnchoredSurface:
        """The middles of the quarters of all cells of a dense map; snapshot: the one it was made of."""
        spots, sigma = np.zeros((len(dense.cells.plane), 4, 3)), np.zeros(len(dense.cells.plane))
        for plane in dense.planes:
            mine = dense.cells.plane == plane.id
            centres = dense.cells.centre[mine]
            spots[mine] = centres[:, None] + _QUARTERS * cell_m @ plane.axes
            sigma[mine] = _off_plane(plane, centres)
        keyframe = np.repeat(dense.cells.keyframe, 4)
        R, t = _cameras(snapshot)
        in_camera = np.einsum("nji,nj->ni", R[keyframe], spots.reshape(-1, 3) - t[keyframe])
        return AnchoredSurface(in_camera, snapshot.keyframe_ids[keyframe].astype(np.int64), np.repeat(sigma, 4))

    def surfaces(self, snapshot: MapSnapshot) -> Surfaces:
        """Where they are in a snapshot of the same map, later or not; those of keyframes that are gone are left out."""
        if not len(snapshot.keyframe_ids):
            return Surfaces.none()
        index = np.minimum(np.searchsorted(snapshot.keyframe_ids, self.keyframe), len(snapshot.keyframe_ids) - 1)
        living = snapshot.keyframe_ids[index] == self.keyframe
        index, points = index[living], self.points[living]
        R, t = _cameras(snapshot)
        return Surfaces(np.einsum("nij,nj->ni", R[index], points) + t[index], index, self.sigma_m[living])


def _cameras(snapshot: MapSnapshot) -> tuple[FloatArray, FloatArray]:
    """Rotations (K, 3, 3) and positions (K, 3) of the keyframes."""
    R = np.array([T.rotation for T in snapshot.T_world_cams]).reshape(-1, 3, 3)
    return R, np.array([T.translation for T in snapshot.T_world_cams]).reshape(-1, 3)


def _off_plane(plane: Plane, points: Points3) -> FloatArray:
    """(N,) standard deviation [m] of the plane's place along its normal, at points on it."""
    middle = np.array([0.5 * (plane.extent[0] + plane.extent[1]), 0.5 * (plane.extent[2] + plane.extent[3])])
    right, up = (plane.coordinates(points) - middle).T
    lever = np.column_stack([up, -right, np.ones(len(points))])
    sigma: FloatArray = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", lever, plane.covariance, lever), 0.0))
    return sigma
