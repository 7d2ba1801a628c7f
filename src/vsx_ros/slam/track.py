"""The result of searching one image for a map's points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.state import TrackingState


class Track(NamedTuple):
    """Outcome for one frame. rows, uv, level (F,): points found where the pose predicts them; searched_rows: all
    searched points. information (6, 6): inverse covariance of the pose in the camera's tangent. hidden_rows: searched
    points that were not found and lie behind found ones. blurred: the image is blurred; points not found may be
    visible. settled (F,): which found points are near enough to their predictions to become observations. sigma_px:
    robust standard deviation of their residuals, px of their level. ahead: what hides the map there, in words."""

    T_world_cam: SE3
    state: TrackingState
    rows: IntArray
    uv: Pixels
    level: IntArray
    searched_rows: IntArray
    information: FloatArray
    reason: str
    hidden_rows: IntArray = np.zeros(0, np.int64)
    blurred: bool = False
    settled: BoolArray = np.zeros(0, np.bool_)
    sigma_px: float = 0.0
    ahead: str = ""

    @property
    def ratio(self) -> float:
        """Found over searched."""
        return len(self.rows) / max(1, len(self.searched_rows))

    @property
    def visible_ratio(self) -> float:
        """Found over the searched points that no found point hides."""
        return len(self.rows) / max(1, len(self.searched_rows) - len(self.hidden_rows))


def nothing_tracked(reason: str, T_world_cam: SE3 | None = None) -> Track:
    """The track of a frame without a search; its pose is the one given, or meaningless."""
    none, pose = np.zeros(0, np.int64), T_world_cam or SE3.identity()
    return Track(
        T_world_cam=pose,
        state=TrackingState.LOST,
        rows=none,
        uv=np.zeros((0, 2)),
        level=none,
        searched_rows=none,
        information=np.zeros((6, 6)),
        reason=reason,
    )
