"""What carries a pose wherever the map goes."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from vsx_ros.geometry.se3 import SE3


class Holder(Protocol):
    """A keyframe as it stands now."""

    @property
    def T_world_cam(self) -> SE3:
        """Its camera's pose."""
        ...

    @property
    def scale(self) -> float:
        """The length now of what was 1 when it was made."""
        ...


class Anchor(NamedTuple):
    """A keyframe (index), the pose in its camera, and its scale then. A culled keyframe is carried by a living one, a
    frame by the one it was tracked from."""

    keyframe: int
    T_keyframe_this: SE3
    scale: float = 1.0

    def pose(self, keyframes: Sequence[Holder]) -> SE3:
        """T_world_this, now that the keyframes stand as they do."""
        holder = keyframes[self.keyframe]
        return holder.T_world_cam @ self.T_keyframe_this.scaled(holder.scale / self.scale)
