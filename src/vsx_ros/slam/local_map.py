"""The map around the camera, and the decision when a frame becomes a keyframe (paper 3.1): rarely in mapped areas,
often enough to survive a turn."""

import math

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.config.maps import KeyframeConfig
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData, MapView
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.vision.pyramid import from_level

# Numbers of keyframes: the nearest; of these, those with most shared points; the nearest ones always used.
NEAREST, COVISIBLE, ALWAYS = 40, 12, 4
FOLLOWED = 8  # keyframes near the camera of which one becomes the reference
LINKED_POINTS, STRANGE_WAY = 15, 8.0  # shared points; path in median depths over which a map may drift
# A frame in doubt makes a good keyframe, too, where new points are needed most: if more than this share of its points
# was found, or if enough points lie where they should. Points with large residuals do not become its observations.
KEYFRAME_RATIO, KEYFRAME_POINTS, KEYFRAME_SIGMA_PX = 0.3, 40, 2.0
PARTS, PART_CORNERS = (15, 20), 3  # rows and columns of an image's parts; corners on level 1 of a textured one
PRESENT_PASS = 10  # so many newest keyframes are of this pass of the camera; older ones nearby, of an earlier one
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
        for k in chosen:
            mark[view.keyframes[k].observations.rows] = True
        self.rows: IntArray = np.flatnonzero(mark & view.alive)

    def _part(self, view: MapView, linked: IntArray) -> MapView:
        """The view within STRANGE_WAY depths of path from the reference or from a keyframe linked with it."""
        way = path_lengths(view)
        known = np.sort(way[np.append(linked, self.reference)])
        after = np.minimum(np.searchsorted(known, way[view.living]), len(known) - 1)
        gap = np.abs(np.stack([known[after], known[np.maximum(after - 1, 0)]]) - way[view.living]).min(axis=0)
        return view._replace(living=view.living[gap <= STRANGE_WAY * view.depths[self.reference]])

    def leave_out(self, hopeless: BoolArray) -> None:
        """Leave out the hopeless ones of ``rows`` (R,) until the map removes them."""
        self.rows = self.rows[~hopeless]

    def follow(self, track: Track) -> int:
        """Of the keyframes nearest to a tracked pose, the one that sees most of the found points; the reference stays
        unless another one is 20 % better. Of all keyframes it could be one that the camera has turned away from."""
        mark = np.zeros(len(self.view.points), np.bool_)
        mark[track.rows] = True
        near = nearest_keyframes(self.linked, track.T_world_cam)[:FOLLOWED].tolist()
        counts = {k: np.count_nonzero(mark[self.view.keyframes[k].observations.rows]) for k in near}
        best = max(near, key=counts.__getitem__)
        return best if counts[best] > 1.2 * counts.get(self.reference, 0) else self.reference


def path_lengths(view: MapView) -> FloatArray:
    """(K,) length [the map's unit] of the path through the keyframes of each one's own map, in the order in which they
    were made, up to it. Between maps there is no way: each has its own frame."""
    way, map_id = np.zeros(len(view.keyframes)), np.array([k.map_id for k in view.keyframes], np.int64)
    for mine in (map_id == m for m in np.unique(map_id)):
        centres = view.centres[mine]
        way[mine] = np.cumsum(np.linalg.norm(np.diff(centres, axis=0, prepend=centres[:1]), axis=1))
    return way


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


def becomes_keyframe(config: KeyframeConfig, view: MapView, track: Track, reference: int, data: FrameData) -> bool:
    """Whether this frame should enter the map.

    Distance and angle are measured to the nearest keyframes of the whole map, so that mapped areas yield few."""
    fits = track.sigma_px <= KEYFRAME_SIGMA_PX and np.count_nonzero(track.settled) >= KEYFRAME_POINTS
    if not (track.state is TrackingState.GOOD or track.ratio > KEYFRAME_RATIO or fits):
        return False
    nearest = nearest_keyframes(view, track.T_world_cam)
    depth = view.keyframes[int(nearest[0])].median_depth or 1.0
    metres, degrees = _nearest_apart(view, nearest, track.T_world_cam)
    few = len(track.rows) < config.overlap_ratio * max(1, len(view.keyframes[reference].observations.rows))
    spacing_m = config.distance_ratio * depth
    if max(metres / spacing_m, degrees / config.angle_deg) <= 1.0 and not (few and metres > 0.2 * spacing_m):
        return False
    metres, degrees = _nearest_apart(view, nearest[nearest < len(view.keyframes) - PRESENT_PASS], track.T_world_cam)
    again = max(metres / spacing_m, degrees / config.angle_deg) <= config.mapped_spacing
    return not (again and is_mapped(config, track, data))


def _nearest_apart(view: MapView, nearest: IntArray, T_world_cam: SE3) -> tuple[float, float]:
    """The least distance [m] and angle [deg] of a pose to the first of these keyframes."""
    near = [view.keyframes[k].T_world_cam for k in nearest[:5].tolist()]
    metres = min((float(np.linalg.norm(pose.translation - T_world_cam.translation)) for pose in near), default=math.inf)
    return metres, math.degrees(min((pose.rotation_angle_to(T_world_cam) for pose in near), default=math.inf))


def is_mapped(config: KeyframeConfig, track: Track, data: FrameData) -> bool:
    """Whether the map already has what this frame shows."""
    if track.state is not TrackingState.GOOD or len(track.rows) < config.mapped_points:
        return False
    return unmapped_share(track.uv, data) <= config.unmapped_ratio


def unmapped_share(uv: Pixels, data: FrameData) -> float:
    """Of the parts of the image with corners, the share in and around which no point (uv (F, 2), px) was found."""
    height, width = data.pyramid.level(0).shape
    first, second = data.corners.counts[:2]
    corners = from_level(data.corners.positions[first : first + second].astype(float), 1)
    textured = _per_part(corners, width, height) >= PART_CORNERS
    mapped = cv2.dilate((_per_part(uv, width, height) > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return int(np.count_nonzero(textured & ~mapped)) / max(1, int(np.count_nonzero(textured)))


def _per_part(uv: Pixels, width: int, height: int) -> IntArray:
    """How many pixels (N, 2) lie in each part of an image."""
    rows, columns = PARTS
    row, column = (uv[:, 1] * rows / height).astype(int), (uv[:, 0] * columns / width).astype(int)
    part = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
    return np.bincount(part, minlength=rows * columns).reshape(PARTS)
