"""What the report of a run is made from."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.evaluation.events import Event
from vsx_ros.evaluation.run_time import Part, elapsed_s, parts
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.rooms import Room


class MapPicture(NamedTuple):
    """The ground map of a moment. png: north up. origin: its lower left corner [m]. size: width and height [m]."""

    stamp_ns: int
    png: bytes
    origin: tuple[float, float]
    size: tuple[float, float]
    known_area_m2: float


class ProgressRow(NamedTuple):
    """How far a run had come at a moment. elapsed_s: without interruptions. driven_m: by odometry. coverage_correct: as
    of ``MapQuality``; None if the map was not compared with the truth."""

    stamp_ns: int
    elapsed_s: float
    driven_m: float
    known_area_m2: float
    coverage_correct: float | None


class Goal(NamedTuple):
    """A view that was chosen. words: why it; figures: the same in numbers. left: why it was left; empty if it was
    not."""

    stamp_ns: int
    pose: SE2
    words: str
    figures: str
    left: str


@dataclass(frozen=True)
class ReportData:
    """The data of a run folder. world_is_level: z is up, so the map is drawn along z; else the first camera's x and z.
    good_ratio, lost_ratio: shares of found points above and below which tracking is good and lost. events: (stamp_ns,
    source, state, reason). frames: (stamp_ns, value of the state, searched, found, keyframe_added, track_ms, U2 so
    far). picture_png: what the camera saw last; empty if unknown. pictures: (stamp_ns, JPEG) of what it saw about once
    a second. maps: of the same moments, as far as they changed. moments_trouble: why there are neither; empty if they
    were not to be kept. rooms: of the ground map. progress: by time; empty without maps of the moments or without
    odometry. goals: in the order in which they were driven to."""

    summary: Mapping[str, Any]
    facts: Mapping[str, Any]
    config_yaml: str
    events: Sequence[Event]
    frames: Sequence[tuple[int, str, int, int, bool, float | None, float | None]]
    estimate: Sequence[StampedPose]
    truth: Sequence[StampedPose]
    grid: OccupancyGrid | None
    points_world: Points3 = field(default_factory=lambda: np.zeros((0, 3)))
    world_is_level: bool = True
    good_ratio: float = 0.3
    lost_ratio: float = 0.13
    picture_png: bytes = b""
    pictures: Sequence[tuple[int, bytes]] = ()
    maps: Sequence[MapPicture] = ()
    moments_trouble: str = ""
    T_base_cam: SE3 = field(default_factory=SE3.identity)
    robot_radius_m: float = 0.0
    rooms: Sequence[Room] = ()
    progress: Sequence[ProgressRow] = ()
    goals: Sequence[Goal] = ()

    @cached_property
    def during(self) -> Sequence[Part]:
        """The parts of the run between its interruptions."""
        lists: list[Sequence[tuple[Any, ...]]] = [self.frames, self.estimate, self.pictures, self.maps, self.events]
        return parts(row[0] for rows in lists for row in rows)

    def lasted_s(self, stamps_ns: Iterable[int]) -> FloatArray:
        """(N,) how long the run had lasted at each stamp [s], without interruptions: the clock of the whole report."""
        return elapsed_s(stamps_ns, self.during)
