"""The ground map of one run: what is seen, driven, bumped and known to be surface, in the map as it is now."""

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.dense.anchored_surface import AnchoredSurface
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.anchored_poses import BUMP_STEP_M, BUMP_STEP_RAD, TRAIL_STEP_M, AnchoredPoses
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.ground_map import DriveHistory, GroundMap
from vsx_ros.occupancy.suspected_obstacles import SuspectedObstacles
from vsx_ros.slam.snapshot import MapSnapshot


class MappedGround:
    """``moved``, ``bumped`` and ``pushed`` as it happens, from any thread, which never waits for a map to be built;
    ``dense`` when surfaces are known anew, then ``grid``, from one."""

    def __init__(self, config: Config) -> None:
        self._ground_map = GroundMap(config.ground_map, config.robot)
        self._trail, self._bumps = AnchoredPoses(TRAIL_STEP_M), AnchoredPoses(BUMP_STEP_M, BUMP_STEP_RAD)
        self._suspected, self._now_ns = SuspectedObstacles(), 0
        self._news: deque[tuple[int | None, Callable[[], None]]] = deque()
        self.start = SE2()
        self.dense: AnchoredSurface | None = None

    def moved(self, pose: SE2, now_ns: int) -> None:
        """The base stands here [m], so the ground is free."""
        self._news += [(now_ns, partial(self._trail.add, pose)), (now_ns, partial(self._suspected.moved, pose))]

    def bumped(self, pose: SE2) -> None:
        """The bumper is pressed here [m]: there is something, for good."""
        self._news.append((None, partial(self._bumps.add, pose)))

    def pushed(self, pose: SE2, now_ns: int) -> None:
        """The wheels turn here [m] in vain: there may be something ahead, for a while."""
        self._news.append((now_ns, partial(self._suspected.pushed, pose, now_ns)))

    def _take_over(self) -> None:
        while self._news:
            now_ns, take = self._news.popleft()
            take()
            self._now_ns = self._now_ns if now_ns is None else now_ns

    def state(self) -> dict[str, FloatArray]:
        """What was driven and bumped, for ``restore``; surfaces are found again from the map, and pushes forgotten."""
        self._take_over()
        return {"start": self.start.as_array(), "trail": self._trail.state(), "bumps": self._bumps.state()}

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Go on from what ``state`` gave. Raises InputError for anything else."""
        try:
            self.start = SE2(*(float(x) for x in state["start"]))
            self._trail.restore(state["trail"])
            self._bumps.restore(state["bumps"])
        except (KeyError, TypeError) as error:
            raise InputError(f"the ground map to go on with is damaged ({error}); start a new run") from error

    @property
    def counts(self) -> tuple[int, int, int]:
        """How many poses were driven through, bumped and pushed at; with the snapshot they say whether the grid has
        changed."""
        self._take_over()
        return len(self._trail), len(self._bumps), self._suspected.count(self._now_ns)

    def trail(self, snapshot: MapSnapshot) -> list[SE2]:
        """The poses driven through, in the map of a snapshot."""
        self._take_over()
        return self._trail.poses(snapshot.keyframe_ids, snapshot.T_world_cams)

    def grid(self, snapshot: MapSnapshot, with_surfaces: bool = True) -> OccupancyGrid:
        """The map of a snapshot; without surfaces it is the paper's sparse one."""
        self._take_over()
        keyframes = snapshot.keyframe_ids, snapshot.T_world_cams
        touched = self._bumps.poses(*keyframes) + self._suspected.poses(self._now_ns, *keyframes)
        return self._ground_map.build(
            snapshot.T_world_cams,
            snapshot.points_world,
            snapshot.obs_keyframe,
            snapshot.obs_point,
            DriveHistory(self.trail(snapshot), touched, self.start),
            surfaces=self.dense.surfaces(snapshot) if self.dense is not None and with_surfaces else None,
            obs_level=snapshot.obs_level,
        )
