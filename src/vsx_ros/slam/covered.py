"""Whether something that is not in the map stands before the camera: it hides map points that should be seen.

One camera cannot measure how far away a thing is that moves. But a person who is near hides most of what the map has in
the middle of the image, and a person who is far hides little of it."""

import numpy as np

from vsx_ros.arrays import BoolArray, IntArray, Points3
from vsx_ros.slam.track import Track

HALF_SLOPE = 0.19  # of the window to each side: as wide as a person 1.2 m away
LEAST_POINTS = 15  # in the window; fewer say nothing
COVERED = (1.5, 0.45), (0.8, 0.4)
"""Of the points farther than so many metres, the share that is not found. The first range notices a person 1.5 m away:
two thirds are hidden then, at 1.75 m one third, and without anybody at most 0.30. Where nothing is so far, the second
notices one 1.2 m away; without anybody it misses at most 0.23."""
MORE_THAN_BESIDE = 0.2  # more of the points is missed ahead than beside; dim or blurred images miss as many everywhere
LEAST_IMAGES = 3  # in a row
LATELY_S = 2.0  # what was not found for so long is not hidden by something new: a wall may have come before it


def covered_ahead(points_cam: Points3, found: BoolArray, telling: BoolArray) -> str:
    """How much of the map ahead is hidden, in words; empty if little is, or too few points could tell. points_cam
    (S, 3): the searched points in the camera's frame [m]; telling (S,): those of which nothing known hides them."""
    x, depth = points_cam[:, 0], points_cam[:, 2]
    ahead = abs(x) < HALF_SLOPE * depth
    for beyond_m, share in COVERED:
        far = telling & (depth > beyond_m)
        beside = far & ~ahead
        searched, missed = int((far & ahead).sum()), int((far & ahead & ~found).sum())
        usual = float((beside & ~found).sum()) / max(int(beside.sum()), LEAST_POINTS)
        if searched >= LEAST_POINTS and missed > max(share, usual + MORE_THAN_BESIDE) * searched:
            return f"something hides {missed} of {searched} points ahead"
    return ""


class CoverWatch:
    """Asks, of each image of one map, the points that were found lately, and believes several images in a row."""

    def __init__(self) -> None:
        self._images, self._since_ns = 0, 0
        self._found_ns = np.zeros(0, np.int64)  # of each row of the map: when it was found last

    def ahead(self, stamp_ns: int, track: Track, points: Points3) -> str:
        """What hides the map ahead, after this image, in words. points (N, 3): of the map's rows [m]."""
        if len(points) > len(self._found_ns):
            more = np.full(len(points) - len(self._found_ns), -(2**62), np.int64)
            self._found_ns = np.append(self._found_ns, more)
        said = "" if track.blurred else self._said(stamp_ns, track, points)
        self._since_ns = self._since_ns if self._images else stamp_ns
        self._images = self._images + 1 if said else 0
        self._found_ns[track.rows] = stamp_ns
        return said if self._images >= LEAST_IMAGES else ""

    def _said(self, stamp_ns: int, track: Track, points: Points3) -> str:
        searched = track.searched_rows
        since_ns = self._since_ns if self._images else stamp_ns
        lately = since_ns - self._found_ns[searched] <= LATELY_S * 1e9
        found, concealed = (_among(rows, len(points))[searched] for rows in (track.rows, track.hidden_rows))
        return covered_ahead(track.T_world_cam.inverse() @ points[searched], found, lately & ~concealed)


def _among(rows: IntArray, count: int) -> BoolArray:
    """(count,) whether each row of the map is one of these."""
    mask = np.zeros(count, np.bool_)
    mask[rows] = True
    return mask
