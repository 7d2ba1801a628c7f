"""What the emulator asks of a world, however it was made: drawn by a generator (``World``) or read from a Gazebo file
(``MeshWorld``)."""

from collections.abc import Iterator
from typing import Protocol, TypeVar

from vsx_ros.arrays import FloatArray, Points2
from vsx_ros.geometry.se2 import SE2
from vsx_ros.sim.world import Point, Start

W = TypeVar("W", bound="EmulatedWorld")


class EmulatedWorld(Protocol):
    """A building with its floor at z = 0, and where the robot starts. The docstrings of ``World`` say more."""

    @property
    def name(self) -> str: ...  # noqa: D102 (see World)

    @property
    def hard(self) -> dict[str, float]: ...  # noqa: D102 (see World)

    @property
    def start(self) -> Start: ...  # noqa: D102 (see World)

    @property
    def start_pose(self) -> SE2: ...  # noqa: D102 (see World)

    @property
    def bounds(self) -> tuple[float, float, float, float]: ...  # noqa: D102 (see World)

    @property
    def sights(self) -> list[Point]: ...  # noqa: D102 (see World)

    def starting_at(self: W, start: Start) -> W: ...  # noqa: D102 (see World)

    def plan(self, z_min: float, z_max: float) -> Iterator[tuple[Points2, bool]]: ...  # noqa: D102 (see World)

    def obstacle_segments(self, z_min: float, z_max: float) -> FloatArray: ...  # noqa: D102 (see World)
