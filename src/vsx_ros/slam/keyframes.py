"""When a tracked frame becomes a keyframe (paper 3.1): rarely where the map is known, often enough to survive a
turn."""

from __future__ import annotations

import math

import numpy as np

from vsx_ros.config import KeyframeConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.map import MapView
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.tracker import Track, nearest_keyframes

# Few points found nearly all still make a good keyframe: it is where new points are needed most.
SURE_RATIO = 0.5


def keyframe_reason(config: KeyframeConfig, view: MapView, track: Track, reference: int, frames_since: int) -> str:
    """Why this frame should enter the map; empty when it should not.

    Distance and angle are measured to the nearest keyframe of the whole map, so that explored area yields none.
    """
    sure = track.state is TrackingState.GOOD or track.ratio > SURE_RATIO
    if frames_since < config.min_gap_frames or not sure:
        return ""
    pose = track.T_world_cam
    nearest = [view.keyframes[int(k)] for k in nearest_keyframes(view, pose)[:5]]
    depth = nearest[0].median_depth or 1.0
    distance = min(float(np.linalg.norm(k.T_world_cam.translation - pose.translation)) for k in nearest)
    angle = min(_view_angle(k.T_world_cam, pose) for k in nearest)
    if distance > config.distance_ratio * depth:
        return f"{distance:.2f} m from the nearest keyframe"
    if angle > math.radians(config.angle_deg):
        return f"{math.degrees(angle):.0f} deg from the nearest keyframe"
    seen = max(1, len(view.keyframes[reference].observations.rows))
    if len(track.rows) < config.overlap_ratio * seen and distance > 0.2 * config.distance_ratio * depth:
        return f"only {len(track.rows)} of {seen} points of the reference keyframe left"
    return ""


def _view_angle(a: SE3, b: SE3) -> float:
    return a.rotation_angle_to(b)
