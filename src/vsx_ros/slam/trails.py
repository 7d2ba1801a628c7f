"""Corners followed from frame to frame while there is no map, and where they were in some earlier frames.

A hand sways: from the frame where it happens to begin, it may come no further for seconds, but between its turning
points it moves much more. So several earlier frames serve as references at once, for the price of one flow."""

from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, GrayImage, IntArray, Pixels, Points2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.slam.keyframe import FrameData, KeyFrame, Observations
from vsx_ros.slam.point_creation import Candidates, candidates_in
from vsx_ros.vision.patch_search import cast_rays, cut_patches
from vsx_ros.vision.pyramid import LEVELS, from_level, to_level

TRAILS = 600  # followed at once: several times min_matches, because many get lost
FEW_TRAILS = 400  # with fewer, a new reference begins others
REFERENCES = 5
SPACING_NS, SPACING_PX = 100_000_000, 2.0  # from the newest reference to the next
_BORDER_PX = 14  # of the level, around a corner


class Reference(NamedTuple):
    """An earlier frame: positions uv (N, 2) and rays (N, 2) of all present trails, NaN for those that began later.
    began: the number of its trails at first. tried: how often it was proposed for a map."""

    data: FrameData
    uv: Pixels
    rays: Points2
    began: int
    tried: int = 0

    @property
    def rows(self) -> IntArray:
        """The trails that are in this frame, too."""
        return np.flatnonzero(np.isfinite(self.uv[:, 0]))


class Trails:
    """positions: (N, 2) pixels of the trails in the newest frame; references: earlier frames, oldest first."""

    def __init__(self, data: FrameData) -> None:
        self.positions: Pixels = np.zeros((0, 2))
        self.references: list[Reference] = []
        self._level: IntArray = np.zeros(0, np.int64)
        self._newest = data
        self._refer(data)

    def follow(self, data: FrameData) -> None:
        """Follow the trails into the next frame; those that get lost end in all references."""
        moved, ok = _flow(self._newest.pyramid.level(0), data.pyramid.level(0), self.positions, self.positions)
        self.positions, self._level, self._newest = moved[ok], self._level[ok], data
        self.references = [r._replace(uv=r.uv[ok], rays=r.rays[ok]) for r in self.references]

    def straighten(self, reference: Reference) -> IntArray:
        """Match the newest frame with a reference, so that its trails do not drift; returns those that match."""
        rows, now = reference.rows, self._newest.pyramid.level(0)
        direct, sure = _flow(reference.data.pyramid.level(0), now, reference.uv[rows], self.positions[rows])
        sure &= np.linalg.norm(direct - self.positions[rows], axis=1) < 3.0
        self.positions[rows[sure]] = direct[sure]
        return rows[sure]

    def shift_px(self, reference: Reference) -> float:
        """Median motion of the trails since a reference."""
        rows = reference.rows
        return float(np.median(np.linalg.norm(self.positions[rows] - reference.uv[rows], axis=1)))

    def extend(self) -> None:
        """Make the newest frame a reference when the image has moved enough since the last one. Of too many, the one
        goes that leaves the shortest gap in time."""
        last, now = self.references[-1], self._newest
        if now.stamp_ns - last.data.stamp_ns < SPACING_NS or self.shift_px(last) < SPACING_PX:
            return
        if len(self.references) == REFERENCES:
            stamps = np.array([reference.data.stamp_ns for reference in self.references[1:]] + [now.stamp_ns])
            del self.references[1 + int(np.argmin(stamps[1:] - np.r_[self.references[0].data.stamp_ns, stamps[:-2]]))]
        self._refer(now)

    def _refer(self, data: FrameData) -> None:
        """Make the newest frame a reference, with new trails between those that are left."""
        if len(self.positions) < FEW_TRAILS:
            rows = np.arange(len(self.positions))
            followed = Observations(rows, self.positions, self.positions, self._level)
            keyframe = KeyFrame(id=0, data=data, T_world_cam=SE3.identity(), observations=followed, median_depth=0.0)
            fresh = candidates_in(keyframe, TRAILS - len(rows))
            self.positions = np.vstack([self.positions, fresh.uv])
            self._level = np.concatenate([self._level, fresh.level])
            absent = np.full((len(fresh.uv), 2), np.nan)
            self.references = [
                r._replace(uv=np.vstack([r.uv, absent]), rays=np.vstack([r.rays, absent])) for r in self.references
            ]
        rays = unproject_pixels(data.camera, np.ascontiguousarray(self.positions))
        self.references.append(Reference(data, self.positions.copy(), rays, began=len(self.positions)))

    def corners(self, reference: Reference, rows: IntArray) -> tuple[Candidates, Pixels]:
        """Trails as corners of a reference, at whole pixels of their levels, and their pixels in the newest frame."""
        parts, pyramid = list[tuple[Any, ...]](), reference.data.pyramid
        for level in range(LEVELS):
            here = rows[self._level[rows] == level]
            height, width = pyramid.level(level).shape
            at = np.rint(to_level(reference.uv[here], level)).astype(np.int32)
            inside = ((at >= _BORDER_PX) & (at < [width - _BORDER_PX, height - _BORDER_PX])).all(axis=1)
            at, here = at[inside], here[inside]
            uv, levels = from_level(at.astype(float), level), np.full(len(at), level, np.int64)
            rays, basis = cast_rays(reference.data.camera, at, level)
            moved = self.positions[here] + uv - reference.uv[here]
            parts.append((uv, levels, rays, basis, cut_patches(pyramid, at, level), moved))
        *columns, moved = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Candidates._make(columns), np.ascontiguousarray(moved)


def _flow(before: GrayImage, now: GrayImage, start: Pixels, guess: Pixels) -> tuple[Pixels, BoolArray]:
    """Pyramidal Lucas-Kanade with a backward check: (positions (N, 2), kept (N,))."""
    if not len(start):
        return guess, np.zeros(0, np.bool_)
    enough, flags = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 20, 0.01), cv2.OPTFLOW_USE_INITIAL_FLOW
    flow = partial(cv2.calcOpticalFlowPyrLK, winSize=(15, 15), maxLevel=3, criteria=enough, flags=flags)
    a, b = start.astype(np.float32), guess.astype(np.float32)
    forward, ok, _ = flow(before, now, a, b.copy())
    back, ok_back, _ = flow(now, before, forward, a.copy())
    height, width = now.shape
    inside = (forward >= 4).all(axis=1) & (forward[:, 0] < width - 5) & (forward[:, 1] < height - 5)
    close = np.linalg.norm(back - a, axis=1) < 0.7
    return forward.astype(np.float64), (ok.ravel() > 0) & (ok_back.ravel() > 0) & inside & close
