"""The surfaces and the ground map of a map that will not change any more: from a recording or a file."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.levelling import Level, level_of
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.dense.planes import Plane
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.slam.snapshot import MapSnapshot

_ALL_CELLS = 10**9


class Cloud(NamedTuple):
    """points (N, 3) of surface, and their grey values in the keyframes, (N,) uint8."""

    points: Points3
    grey: NDArray[np.uint8]


class FinishedMap:
    """planes: None if the configuration has no dense map, or nothing was mapped. cloud: the spots of its surfaces.
    note: the unit of length and how the floor was found; empty for a map made with odometry."""

    def __init__(
        self, snapshot: MapSnapshot, camera: PinholeCamera, T_base_cam: SE3 | None, config: Config, seed: int = 0
    ) -> None:
        """T_base_cam: the camera's mount; None for a map made without odometry."""
        self._snapshot, self._T_base_cam = snapshot, T_base_cam
        self._ground_map = GroundMap(config.ground_map, config.robot)
        self._ground_map.look_with(camera)
        densifier = Densifier(camera, T_base_cam, config.dense, seed)
        self._surfaces = Surfaces.none()
        self.planes: tuple[Plane, ...] | None = None
        self.cloud: Cloud | None = None
        if config.dense.enabled and len(snapshot.points_world):
            dense = densifier.update(snapshot, _ALL_CELLS, settled=True)
            self.planes = dense.planes
            self._surfaces = _surfaces(dense, snapshot, config.dense.cell_m * densifier.unit)
            self.cloud = Cloud(self._surfaces.points, _grey(self._surfaces, snapshot, camera))
        self.level: Level | None = None
        self.note = "" if T_base_cam is not None else self._levelled(densifier.unit)

    def _levelled(self, unit: float) -> str:
        """Find the floor; returns the note."""
        without = "made without odometry, lengths are in the map's own unit"
        self.level = level_of(self.planes or (), self._snapshot, unit) if len(self._snapshot.points_world) else None
        if self.level is None:
            return f"{without}; no level plane below the cameras was found to be the floor, so there is no ground map"
        return f"{without}, of which {unit:.3g} were taken for a metre; the floor is the largest level plane"

    def grid(self, trail: Sequence[SE3]) -> OccupancyGrid | None:
        """The ground map. trail: T_world_cams of the base's way, which is free. For a map made without odometry it is
        in the map's own unit, on the plane of ``level``, without the trail; None if no level was found."""
        if self._T_base_cam is None:
            return self._grid_of_level(self.level) if self.level is not None else None
        T_cam_base = self._T_base_cam.inverse()
        return self._built(self._snapshot, self._surfaces, [(T @ T_cam_base).to_se2() for T in trail])

    def _grid_of_level(self, level: Level) -> OccupancyGrid:
        unit, surfaces = level.unit, self._surfaces
        standing = level.T_level_world @ surfaces.points / unit
        surfaces = surfaces._replace(points=standing, sigma_m=surfaces.sigma_m / unit)
        grid = self._built(level.of(self._snapshot), surfaces, [])
        return replace(
            grid, resolution=grid.resolution * unit, origin_x=grid.origin_x * unit, origin_y=grid.origin_y * unit
        )

    def _built(self, snapshot: MapSnapshot, surfaces: Surfaces, trail: list[SE2]) -> OccupancyGrid:
        points, rays = snapshot.points_world, snapshot.rays
        return self._ground_map.build(
            rays.T_world_cams, points, rays.keyframe, rays.point, DriveHistory(trail), surfaces, rays.level
        )

    def facts(self) -> dict[str, Any]:
        """The planes, for a file. Points x of a plane have normal . x = offset. extent: along its axes right and up.
        sigma: of its tilts about these axes and of its offset. supporters: number of its points."""
        tree: dict[str, Any] = {"unit": "metre" if self._T_base_cam is not None else "map", "note": self.note or None}
        if self.level is not None:
            tree["T_level_world"] = self.level.T_level_world.matrix().tolist()
        return {**tree, "planes": [_facts(plane) for plane in self.planes or ()]}


def _facts(plane: Plane) -> dict[str, Any]:
    tilt_right, tilt_up, offset = np.sqrt(np.diag(plane.covariance)).tolist()
    return {
        "id": plane.id,
        "kind": plane.kind.value,
        "normal": plane.normal.tolist(),
        "offset": plane.offset,
        "right": plane.axes[0].tolist(),
        "up": plane.axes[1].tolist(),
        "extent": dict(zip(("right_min", "right_max", "up_min", "up_max"), plane.extent.tolist())),
        "supporters": len(plane.points),
        "sigma": {"tilt_right_rad": tilt_right, "tilt_up_rad": tilt_up, "offset": offset},
    }


def _surfaces(dense: DenseMap, snapshot: MapSnapshot, cell: float) -> Surfaces:
    return AnchoredSurface.of(dense, snapshot, cell).surfaces(snapshot)


def _grey(surfaces: Surfaces, snapshot: MapSnapshot, camera: PinholeCamera) -> NDArray[np.uint8]:
    """(N,) grey value of each spot in its keyframe, which is a living one: all were judged in the snapshot's images."""
    grey, keyframe = np.zeros(len(surfaces.points), np.uint8), snapshot.rays.ids[surfaces.keyframe]
    for k, number in enumerate(snapshot.keyframe_ids.tolist()):
        mine = keyframe == number
        uv = camera.project(snapshot.T_world_cams[k].inverse() @ surfaces.points[mine])
        column, row = np.rint(np.clip(np.nan_to_num(uv), 0.0, [camera.width - 1, camera.height - 1])).astype(int).T
        grey[mine] = snapshot.images[k][row, column]
    return grey
