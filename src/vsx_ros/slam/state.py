"""Results of the SLAM: per frame, per event, per run."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.anchor import Anchor


class TrackingState(Enum):
    """How far a pose can be trusted. The value is for files, the word for people."""

    NOT_INITIALISED = "not initialised"
    GOOD = "good"
    DUBIOUS = "dubious"
    LOST = "lost"

    @property
    def tracked(self) -> bool:
        """Whether the pose was found in the image."""
        return self in (TrackingState.GOOD, TrackingState.DUBIOUS)

    @property
    def word(self) -> str:
        """The name for users, on topics and screens and in reports."""
        return {"GOOD": "TRACKING", "DUBIOUS": "POOR"}.get(self.name, self.name)


class TrackingResult(NamedTuple):
    """One frame. searched, found: map points expected in the image, and those found where the pose predicts them.

    T_world_cam is None while there is no map, while the camera is lost without odometry, until it is recognised in a
    loaded map, and in a map not yet joined with the first one. In state LOST with odometry it is the predicted pose.
    reason: why the state is not GOOD, in words. map_id: the map the camera is tracked in; 0 is the first one, whose
    frame is the world. In another map the state is LOST, because the pose in the world is unknown, and T_map_cam is the
    pose in that map's own frame. corrected: the map moved since the frame before (a loop was closed, maps were joined):
    a jump is the map's, not the camera's. covariance (6, 6): of the pose, see slam/uncertainty.py; None without a pose.
    anchor: the pose relative to a keyframe, which moves with the map. ahead: how much of the map in the middle of the
    image is hidden by something that is not in it, in words; empty if little is. frozen: the image is an earlier one to
    the bit though the base has moved since: driving on would be driving blind."""

    stamp_ns: int
    state: TrackingState
    T_world_cam: SE3 | None = None
    searched: int = 0
    found: int = 0
    keyframe_added: bool = False
    reason: str = ""
    map_id: int = 0
    T_map_cam: SE3 | None = None
    corrected: bool = False
    covariance: FloatArray | None = None
    anchor: Anchor | None = None
    ahead: str = ""
    frozen: bool = False

    def placed(self, T_map_cam: SE3) -> TrackingResult:
        """The same result with a pose in its map; outside the first map it has no pose in the world."""
        result = self._replace(T_world_cam=T_map_cam, T_map_cam=T_map_cam)
        if self.map_id == 0:
            return result
        reason = f"in map {self.map_id}, not yet joined with the first one"
        return result._replace(state=TrackingState.LOST, T_world_cam=None, reason=reason)

    def seen_from(self, T_cam_there: SE3) -> TrackingResult:
        """The same result with poses of another moment; T_cam_there: the camera then, seen from the camera now."""
        there = None if self.T_map_cam is None else self.T_map_cam @ T_cam_there
        return self._replace(T_world_cam=None if self.T_world_cam is None else there, T_map_cam=there)


class SlamEvent(NamedTuple):
    """A change of state. kind: refused, initialised, restarted (the map's start was wrong: it begins again), lost,
    bridged (a keyframe placed by odometry alone), carried (the image changed though the base stood still), relocalised,
    second map (begun where the first is out of sight), loop closed, merged (a second map was joined with the first),
    calibrated (wheels or gyro were found wrong), gap."""

    stamp_ns: int
    kind: str
    reason: str


class SlamStatistics(NamedTuple):
    """A run so far; names as in summary.json. The start is the frame that begins the map or is recognised in a loaded
    one. u1: found / searched averaged over all frames since the start, a lost frame counts 0 (paper 5.3). u2: how long
    a point is tracked, averaged over points in at least three frames. visible_ratio: u1 of the sharp tracked frames,
    without points hidden by nearer ones: the performance of the tracker itself."""

    frames: int
    frames_tracked: int
    frames_lost: int
    relocalizations: int
    u1: float | None
    u2_frames: float | None
    u2_seconds: float | None
    u2_metres: float | None
    keyframes: int
    map_points: int
    initialized_at_s: float | None
    visible_ratio: float | None = None
