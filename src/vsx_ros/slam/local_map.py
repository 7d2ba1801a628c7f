"""The map around the camera, and the decision when a frame becomes a keyframe (paper 3.1): rarely in mapped areas,
often enough to survive a turn."""

import math

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points3
from vsx_ros.config.maps import KeyframeConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import MapView
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track

# Numbers of keyframes: the nearest; of these, those with most shared points; the nearest ones always used.
NEAREST, COVISIBLE, ALWAYS = 40, 12, 4
LINKED_POINTS, STRANGE_WAY = 15, 8.0  # shared points; path in median depths over which a map may drift
# A frame in doubt makes a good keyframe, too, where new points are needed most: if more than this share of its points
# was found, or if enough points lie where they should. Points with large residuals do not become its observations.
KEYFRAME_RATIO, KEYFRAME_POINTS, KEYFRAME_SIGMA_PX = 0.3, 40, 2.0
HURRY_RATIO, HURRY_FRAMES = 0.45, 2  # below this share of found points, the map is about to get out of view


class LocalMap:
    """The points worth projecting: those of keyframes that share points with the reference keyframe or are near it.
    Their number does not grow with the map. near (N,): keyframes around it, nearest first; shared (N,): number of
    points each shares with it.

    linked: the view restricted to keyframes connected to the reference by shared points or a short path. Nearby
    keyframes connected only around a loop are left out: the map may have drifted in between, and they would be a second
    copy that contradicts the first. LoopDetector joins them."""

    def __init__(self, view: MapView, reference: int) -> None:
        """The map around a reference keyframe."""
        self.view, self.reference = view, reference
        near = nearest_keyframes(view, view.keyframes[reference].T_world_cam)[:NEAREST]
        mark = np.zeros(len(view.points), np.bool_)
        mark[view.keyframes[reference].observations.rows] = True
        shared = np.array([np.count_nonzero(mark[view.keyframes[k].observations.rows]) for k in near])
        self.linked = self._part(view, near[shared >= LINKED_POINTS])
        tied = np.isin(near, self.linked.living)
        self.near, self.shared = near, shared = near[tied], shared[tied]
        chosen = [int(k) for k in near[np.argsort(-shared, kind="stable")[:COVISIBLE]]]
        chosen += [int(k) for k in near[:ALWAYS] if int(k) not in chosen]
        if reference not in chosen:
            chosen.append(reference)
        self.keyframes = chosen
        seen = [view.keyframes[k].observations.rows for k in chosen]
        self._seen = np.concatenate(seen)
        self._observer = np.repeat(np.arange(len(chosen)), [len(rows) for rows in seen])
        mark[self._seen] = True
        self.rows: IntArray = np.flatnonzero(mark & view.alive)

    def _part(self, view: MapView, linked: IntArray) -> MapView:
        """The view within STRANGE_WAY depths of path from the reference or from a keyframe linked with it."""
        way = path_lengths(view.centres)
        known = np.sort(way[np.append(linked, self.reference)])
        after = np.minimum(np.searchsorted(known, way[view.living]), len(known) - 1)
        gap = np.abs(np.stack([known[after], known[np.maximum(after - 1, 0)]]) - way[view.living]).min(axis=0)
        return view._replace(living=view.living[gap <= STRANGE_WAY * view.depths[self.reference]])

    def leave_out(self, hopeless: BoolArray) -> None:
        """Leave out the hopeless ones of ``rows`` (R,) until the map removes them."""
        self.rows = self.rows[~hopeless]

    def follow(self, found: IntArray) -> int:
        """The keyframe that sees most of the found points; the reference stays unless another one is 20 % better."""
        mark = np.zeros(len(self.view.points), np.bool_)
        mark[found] = True
        counts = np.bincount(self._observer[mark[self._seen]], minlength=len(self.keyframes))
        best = max(range(len(counts)), key=lambda i: (counts[i], -self.keyframes[i]))
        current = counts[self.keyframes.index(self.reference)]
        return self.keyframes[best] if counts[best] > 1.2 * current else self.reference


def path_lengths(centres: Points3) -> FloatArray:
    """(K,) length [m] of the path through the keyframes, in the order in which they were made, up to each."""
    return np.cumsum(np.linalg.norm(np.diff(centres, axis=0, prepend=centres[:1]), axis=1))


def nearest_keyframes(view: MapView, T_world_cam: SE3) -> IntArray:
    """Indices of the living keyframes, sorted by distance and viewing direction (1 rad counts as the median depth)."""
    living = view.living
    offset = np.linalg.norm(view.centres[living] - T_world_cam.translation, axis=1)
    cosine = view.R_world_cam[living, :, 2] @ T_world_cam.rotation[:, 2]
    return living[np.argsort(offset / view.depths[living] + np.arccos(np.clip(cosine, -1.0, 1.0)), kind="stable")]


def may_grow(config: KeyframeConfig, view: MapView, track: Track, frames: int, seconds: float) -> bool:
    """Whether the newest keyframe is old enough for the next. The third need not wait: what two near views show of the
    scene is little, and is soon out of sight. Nor does one that fewer and fewer points support."""
    hurry = frames >= HURRY_FRAMES and track.ratio < HURRY_RATIO
    return len(view.keyframes) == 2 or hurry or frames >= config.min_gap_frames or seconds >= config.min_gap_s


def becomes_keyframe(config: KeyframeConfig, view: MapView, track: Track, reference: int) -> bool:
    """Whether this frame should enter the map.

    Distance and angle are measured to the nearest keyframes of the whole map, so that mapped areas yield none."""
    fits = track.sigma_px <= KEYFRAME_SIGMA_PX and np.count_nonzero(track.settled) >= KEYFRAME_POINTS
    if not (track.state is TrackingState.GOOD or track.ratio > KEYFRAME_RATIO or fits):
        return False
    pose = track.T_world_cam
    nearest = [view.keyframes[int(k)] for k in nearest_keyframes(view, pose)[:5]]
    depth = nearest[0].median_depth or 1.0
    distance = min(float(np.linalg.norm(k.T_world_cam.translation - pose.translation)) for k in nearest)
    angle = min(k.T_world_cam.rotation_angle_to(pose) for k in nearest)
    few = len(track.rows) < config.overlap_ratio * max(1, len(view.keyframes[reference].observations.rows))
    far = distance > config.distance_ratio * depth or angle > math.radians(config.angle_deg)
    return far or (few and distance > 0.2 * config.distance_ratio * depth)
