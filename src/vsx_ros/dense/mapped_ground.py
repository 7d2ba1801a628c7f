"""The ground map of one run, from points, trail, bumps and surfaces in the current map. Surface cells are spots tied to
the keyframes they were judged in, so they move when the map is adjusted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.config import Config
from vsx_ros.dense.densify import DenseMap
from vsx_ros.dense.planes import Plane
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.anchored_poses import BUMP_STEP_M, BUMP_STEP_RAD, NEAREST, TRAIL_STEP_M, AnchoredPoses
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import MAX_EXTENT_M, OccupancyGrid
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.occupancy.suspected_obstacles import SuspectedObstacles
from vsx_ros.occupancy.zoned_grid import with_zones
from vsx_ros.occupancy.zones import AnchoredZones, Zone
from vsx_ros.slam.snapshot import MapSnapshot

_AT_DOCK_M = 0.3  # between the seat of the base and where a try ended beside it
_QUARTERS = np.array([[-0.25, -0.25], [-0.25, 0.25], [0.25, -0.25], [0.25, 0.25]])  # [cells]


class AnchoredSurface(NamedTuple):
    """points (N, 3): spots, in the camera frame of their keyframe [m]. keyframe (N,): its id. sigma_m (N,). shown (S,):
    rows of spots at the foot of a wall; witness (S,): ids of the keyframes that show each."""

    points: Points3
    keyframe: NDArray[np.int64]
    sigma_m: FloatArray
    shown: NDArray[np.int64]
    witness: NDArray[np.int64]

    @staticmethod
    def of(dense: DenseMap, snapshot: MapSnapshot, cell_m: float) -> AnchoredSurface:
        """The centres of the quarters of all cells of a dense map. snapshot: the one it was made of."""
        spots, sigma = np.zeros((len(dense.cells.plane), 4, 3)), np.zeros(len(dense.cells.plane))
        for plane in dense.planes:
            mine = dense.cells.plane == plane.id
            centres = dense.cells.centre[mine]
            spots[mine] = centres[:, None] + _QUARTERS * cell_m @ plane.axes
            sigma[mine] = _off_plane(plane, centres)
        keyframe, rays = np.repeat(dense.cells.keyframe, 4), snapshot.rays
        R, t = stacked(rays.T_world_cams)
        in_camera = np.einsum("nji,nj->ni", R[keyframe], spots.reshape(-1, 3) - t[keyframe])
        ids = rays.ids.astype(np.int64)
        cell, slot = np.nonzero(dense.cells.witnesses >= 0)
        shown, witness = (4 * cell[:, None] + np.arange(4)).ravel(), ids[dense.cells.witnesses[cell, slot]].repeat(4)
        return AnchoredSurface(
            points=in_camera, keyframe=ids[keyframe], sigma_m=np.repeat(sigma, 4), shown=shown, witness=witness
        )

    def surfaces(self, snapshot: MapSnapshot) -> Surfaces:
        """The spots in any snapshot of the same map. Spots whose keyframe it does not hold are left out."""
        rays = snapshot.rays
        if not len(rays.ids):
            return Surfaces.none()
        index, known = _rows_of(rays.ids, self.keyframe)
        witness, there = _rows_of(rays.ids, self.witness)
        there &= known[self.shown]
        shown = (np.cumsum(known) - 1)[self.shown[there]]
        index, points = index[known], self.points[known]
        R, t = stacked(rays.T_world_cams)
        in_world = np.einsum("nij,nj->ni", R[index], points) + t[index]
        return Surfaces(
            points=in_world, keyframe=index, sigma_m=self.sigma_m[known], shown=shown, witness=witness[there]
        )


def _rows_of(keyframe_ids: IntArray, wanted: IntArray) -> tuple[IntArray, BoolArray]:
    """(N,) rows of the wanted ids among those given, and which are there."""
    index = np.minimum(np.searchsorted(keyframe_ids, wanted), len(keyframe_ids) - 1)
    return index, keyframe_ids[index] == wanted


def _every(snapshot: MapSnapshot) -> tuple[IntArray, tuple[SE3, ...]]:
    """Ids and poses of all keyframes, also of culled ones: what was tied to one stays where that was."""
    rays = snapshot.rays
    return rays.ids, rays.T_world_cams


def _off_plane(plane: Plane, points: Points3) -> FloatArray:
    """(N,) standard deviation [m] of the plane's position along its normal, at points on it."""
    right, up = plane.coordinates(points - plane.middle).T
    lever = np.column_stack([up, -right, np.ones(len(points))])
    return np.asarray(np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", lever, plane.covariance, lever), 0.0)))


class MappedGround:
    """Any thread may call ``moved``, ``bumped``, ``pushed``, ``docked`` and ``corrected`` when they happen, and ask for
    the ``dock``; none of these waits while a grid is built. One thread sets ``dense`` when there are new surfaces, and
    then calls ``grid``."""

    def __init__(self, config: Config) -> None:
        self._ground_map = GroundMap(config.ground_map, config.robot)
        self._trail, self._bumps = AnchoredPoses(TRAIL_STEP_M), AnchoredPoses(BUMP_STEP_M, BUMP_STEP_RAD)
        self._suspected, self._now_ns, self._beside = SuspectedObstacles(), 0, NEAREST
        self._news: deque[tuple[int | None, Callable[[], None]]] = deque()
        self.start = SE2()
        self.dense: AnchoredSurface | None = None
        self.zones, self._docked = AnchoredZones(), AnchoredPoses(0.0)
        self._zone_margin_m, self._radius_m = config.planner.zone_margin_m, config.robot.radius_m

    def look_with(self, camera: PinholeCamera) -> None:
        """The camera that sees the points; until then a Kinect."""
        self._ground_map.look_with(camera)

    def moved(self, pose: SE2, now_ns: int, beside: int = NEAREST) -> None:
        """The base stands here [m], so the ground is free. beside: id of the keyframe by which the pose was found."""
        self._news += [(now_ns, partial(self._stand, pose, beside)), (now_ns, partial(self._suspected.moved, pose))]

    def _stand(self, pose: SE2, beside: int) -> None:
        self._beside = beside
        self._trail.add(pose, beside)

    def bumped(self, pose: SE2) -> None:
        """The bumper is pressed here [m]: a permanent obstacle."""
        self._news.append((None, lambda: self._bumps.add(pose, self._beside)))

    def corrected(self) -> None:
        """The map was corrected: later poses are in another one than those before."""
        self._news += [(None, self._trail.settle), (None, self._bumps.settle)]

    def docked(self, pose: SE2) -> None:
        """The base charges here [m]: the dock was last seen before it."""
        docked = AnchoredPoses(0.0)
        docked.add(pose)
        self._docked = docked

    def dock(self, snapshot: MapSnapshot) -> SE2 | None:
        """Where the base stands when it charges, in the map of a snapshot; None if it never charged in this map. Who
        saves the map asks beside the thread that calls ``grid``, so nothing is taken over here."""
        return next(iter(self._docked.poses(*_every(snapshot))), None)

    def pushed(self, pose: SE2, now_ns: int) -> None:
        """The wheels turn here [m] without moving the base: an obstacle is suspected ahead, for some time."""
        self._news.append((now_ns, partial(self._suspected.pushed, pose, now_ns)))

    def _take_over(self) -> None:
        while self._news:
            now_ns, take = self._news.popleft()
            take()
            self._now_ns = self._now_ns if now_ns is None else now_ns

    def state(self) -> dict[str, NDArray[Any]]:
        """Start, trail, bumps, dock and zones, for ``restore``. Surfaces are found again from the map; pushes are
        forgotten."""
        self._take_over()
        driven = {"start": self.start.as_array(), "trail": self._trail.state(), "bumps": self._bumps.state()}
        driven["dock"] = self._docked.state()
        return {**driven, **self.zones.state()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a ``state``. Raises InputError for anything else."""
        try:
            self.start = SE2(*(float(x) for x in state["start"]))
            if not (np.abs(self.start.as_array()) <= MAX_EXTENT_M).all():
                raise ValueError(f"it starts at {self.start}")
            self._trail.restore(state["trail"])
            self._bumps.restore(state["bumps"])
            self._docked.restore(state.get("dock", np.zeros((0, 8))))  # sessions of older versions had none
            self.zones.restore(state)
        except InputError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the ground map to go on with is damaged ({error}); start a new run") from error

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of poses ever driven, bumps and active pushes. Where they and the snapshot are the same, so is the
        grid."""
        self._take_over()
        return self._trail.added, len(self._bumps), self._suspected.count(self._now_ns)

    def trail(self, snapshot: MapSnapshot) -> list[SE2]:
        """The driven poses, in the map of a snapshot."""
        self._take_over()
        return self._trail.poses(*_every(snapshot))

    def zones_in(self, snapshot: MapSnapshot) -> tuple[Zone, ...]:
        """The zones, in the map of a snapshot."""
        return self.zones.zones(*_every(snapshot))

    def zoned(self, grid: OccupancyGrid, snapshot: MapSnapshot) -> OccupancyGrid:
        """The ground map of a snapshot with the zones laid over it."""
        zones, version = self.zones_in(snapshot), self.zones.version
        return with_zones(grid, zones, self._zone_margin_m, self._radius_m, version)

    def grid(self, snapshot: MapSnapshot, with_surfaces: bool = True) -> OccupancyGrid:
        """The ground map of a snapshot; without surfaces, the sparse one of the paper."""
        self._take_over()
        keyframes = _every(snapshot)
        dock, bumps = self.dock(snapshot), self._bumps.poses(*keyframes)
        if dock is not None:  # the dock is touched on purpose
            bumps = [bump for bump in bumps if bump.distance_to(dock) > _AT_DOCK_M]
        touched, rays = bumps + self._suspected.poses(self._now_ns, *keyframes), snapshot.rays
        trail = self.trail(snapshot)
        passed = np.searchsorted(rays.ids, self._trail.newest, side="right") - 1
        return self._ground_map.build(
            rays.T_world_cams,
            snapshot.points_world,
            rays.keyframe,
            rays.point,
            DriveHistory(trail, touched, self.start, passed),
            surfaces=self.dense.surfaces(snapshot) if self.dense is not None and with_surfaces else None,
            obs_level=rays.level,
        )
