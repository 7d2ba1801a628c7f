"""Poses stored relative to a keyframe, so that they follow the map."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from vsx_ros.geometry.se3 import SE3


class Holder(Protocol):
    """The present state of a keyframe."""

    @property
    def T_world_cam(self) -> SE3:
        """Its camera's pose."""
        ...

    @property
    def scale(self) -> float:
        """The present length of what had length 1 when it was made."""
        ...


class Anchor(NamedTuple):
    """A pose relative to a keyframe: index, pose in its camera, and its scale at that time. The keyframe is a living
    one for a culled keyframe, and the reference keyframe for a frame."""

    keyframe: int
    T_keyframe_this: SE3
    scale: float = 1.0

    def pose(self, keyframes: Sequence[Holder]) -> SE3:
        """T_world_this, by the keyframe's present state."""
        holder = keyframes[self.keyframe]
        return holder.T_world_cam @ self.T_keyframe_this.scaled(holder.scale / self.scale)
