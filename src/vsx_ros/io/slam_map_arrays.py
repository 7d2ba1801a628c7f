"""A map of the SLAM as arrays: their names, types and shapes, and the conditions between them.

K keyframes, O observations, S of them with pixels (not those of culled keyframes) and C corners (one keyframe after the
other), P points, T templates."""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import IntArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.lens import MOTION
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.keyframe import MapView
from vsx_ros.slam.templates import VIEWS
from vsx_ros.vision.pyramid import LEVELS

Arrays: TypeAlias = dict[str, NDArray[Any]]
_LIVING = Anchor(-1, SE3.identity())  # of a keyframe that was not culled


def _pose(T: SE2 | None) -> tuple[float, float, float]:
    return (0.0, 0.0, 0.0) if T is None else (T.x, T.y, T.theta)


def _anchors(view: MapView) -> list[Anchor]:
    """The anchor of each keyframe, of the present scale of what holds it, as in a map that is read."""
    carried = [keyframe.anchor or _LIVING for keyframe in view.keyframes]
    sizes = [view.keyframes[anchor.keyframe].scale / anchor.scale for anchor in carried]
    return [a._replace(T_keyframe_this=a.T_keyframe_this.scaled(size)) for a, size in zip(carried, sizes)]


LAYOUT: dict[str, tuple[str, tuple[int | str, ...], Callable[[MapView], Any]]] = {
    "stamp_ns": ("<i8", ("K",), lambda v: [k.data.stamp_ns for k in v.keyframes]),
    "rotation": ("<f8", ("K", 3, 3), lambda v: v.R_world_cam),
    "translation": ("<f8", ("K", 3), lambda v: v.centres),
    "median_depth": ("<f8", ("K",), lambda v: [k.median_depth for k in v.keyframes]),
    "scale": ("<f8", ("K",), lambda v: [k.scale for k in v.keyframes]),
    "chain": ("<i8", ("K",), lambda v: [k.odom_segment for k in v.keyframes]),
    "map_id": ("<i8", ("K",), lambda v: [k.map_id for k in v.keyframes]),
    "has_odometry": ("|b1", ("K",), lambda v: [k.data.T_odom_base is not None for k in v.keyframes]),
    "odometry": ("<f8", ("K", 3), lambda v: [_pose(k.data.T_odom_base) for k in v.keyframes]),
    "readout_motion": ("<f8", ("K", 6), lambda v: [k.data.camera[MOTION : MOTION + 6] for k in v.keyframes]),
    "anchor": ("<i8", ("K",), lambda v: [a.keyframe for a in _anchors(v)]),
    "anchor_rotation": ("<f8", ("K", 3, 3), lambda v: [a.T_keyframe_this.rotation for a in _anchors(v)]),
    "anchor_translation": ("<f8", ("K", 3), lambda v: [a.T_keyframe_this.translation for a in _anchors(v)]),
    "corner_count": ("<i8", ("K", LEVELS), lambda v: [k.data.corners.counts for k in v.keyframes]),
    "corner": ("<i4", ("C", 2), lambda v: np.concatenate([k.data.corners.positions for k in v.keyframes])),
    "observation_count": ("<i8", ("K",), lambda v: [len(k.observations.rows) for k in v.keyframes]),
    "observation_row": ("<i4", ("O",), lambda v: np.concatenate([k.observations.rows for k in v.keyframes])),
    "observation_uv": ("<f8", ("S", 2), lambda v: np.concatenate([k.observations.uv for k in v.keyframes])),
    "observation_ideal": ("<f8", ("S", 2), lambda v: np.concatenate([k.observations.ideal for k in v.keyframes])),
    "observation_level": ("|u1", ("O",), lambda v: np.concatenate([k.observations.level for k in v.keyframes])),
    "point": ("<f8", ("P", 3), lambda v: v.points),
    "point_alive": ("|b1", ("P",), lambda v: v.alive),
    "point_source": ("<i8", ("P",), lambda v: v.source),
    "point_templates": ("<i8", ("P", VIEWS), lambda v: v.templates.of_point),
    "template_source": ("<i8", ("T",), lambda v: v.templates.source),
    "template_basis": ("<f8", ("T", 4), lambda v: v.templates.basis),
    "template_offset": ("<f8", ("T", 2), lambda v: v.templates.offset),
    "template_patch": ("|u1", ("T", PATCH, PATCH), lambda v: v.templates.patches),
}
"""Type and shape of every array, and how it is taken from a view. anchor: -1 for a keyframe that was not culled.
odometry: x, y, theta where there is any. readout_motion: as ``moving`` takes it. chain: the keyframe's odom_segment."""
_EARLIER = {"observation_row": "<i8", "observation_level": "<i8"}  # types in files up to version 2

MAX_KEYFRAMES = 2**16  # many times more than the largest buildings need
_ORTHONORMAL = 1e-6  # rounding of rotations
_LEAST_SCALE, _MOST_SCALE = 1e-6, 1e6  # of what is corrected by some per cent at a time
_MOST = np.iinfo(np.int64).max
_RANGES: dict[str, tuple[float, float | str]] = {
    "anchor": (-1, "K"), "observation_row": (0, "P"), "observation_level": (0, LEVELS), "point_source": (0, "K"),
    "point_templates": (-1, "T"), "template_source": (0, "K"), "median_depth": (0, np.inf), "chain": (0, _MOST),
    "map_id": (0, _MOST), "scale": (_LEAST_SCALE, _MOST_SCALE),
}  # fmt: skip
"""Lowest allowed value of an array, and the exclusive upper limit."""


def arrays_of(view: MapView) -> Arrays:
    """All of a view except the pixels of its keyframes."""
    return {name: np.asarray(of(view), kind) for name, (kind, _, of) in LAYOUT.items()}


def pixel_counts(arrays: Mapping[str, NDArray[Any]]) -> IntArray:
    """(K,) how many observations of each keyframe have pixels. Up to version 2, those of culled ones had zeros."""
    counts, padded = arrays["observation_count"], len(arrays["observation_uv"]) == len(arrays["observation_row"])
    return counts if padded else np.where(arrays["anchor"] < 0, counts, 0)


def check(arrays: Mapping[str, NDArray[Any]], width: int, height: int) -> None:
    """Raise ValueError with the name of an array that is missing or impossible in a map with images of this size."""
    sizes = _check_shapes(arrays)
    for name, array in arrays.items():
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise ValueError(f"{name} holds a number that is not finite")
    for name in ("rotation", "anchor_rotation"):
        R = arrays[name]
        small = np.abs(R).max() <= 1.0 + _ORTHONORMAL  # the product of larger numbers may overflow
        if not small or np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(R).min() < 0:
            raise ValueError(f"{name} holds a matrix that is no rotation")
    for name, (lowest, end) in _RANGES.items():
        _within(name, arrays[name], lowest, sizes[end] if isinstance(end, str) else end)
    _check_counts(arrays, sizes)
    uv = arrays["observation_uv"]
    if ((uv < -1) | (uv > [width, height])).any():
        raise ValueError(f"observation_uv lies outside an image of {width}x{height}")
    _check_corners(arrays, width, height)


def _check_shapes(arrays: Mapping[str, NDArray[Any]]) -> dict[str, int]:
    sizes: dict[str, int] = {}
    for name, (kind, shape, _) in LAYOUT.items():
        if name not in arrays:
            raise ValueError(f"{name} is missing")
        array = arrays[name]
        wanted = tuple(sizes.get(s, s) if isinstance(s, str) else s for s in shape)
        fits = len(array.shape) == len(wanted) and all(
            isinstance(w, str) or w == n for w, n in zip(wanted, array.shape)
        )
        if array.dtype not in (kind, _EARLIER.get(name, kind)) or not fits:
            raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, expected {np.dtype(kind)} of {wanted}")
        sizes |= {s: n for s, n in zip(shape, array.shape) if isinstance(s, str)}
    if not 0 < sizes["K"] <= MAX_KEYFRAMES:
        raise ValueError(f"it holds {sizes['K']} keyframes, a map has 1 to {MAX_KEYFRAMES}")
    return sizes


def _within(name: str, array: NDArray[Any], lowest: float, end: float) -> None:
    if array.size and not lowest <= array.min() <= array.max() < end:
        raise ValueError(f"{name} reaches from {array.min()} to {array.max()}, allowed is {lowest} to below {end}")


def _check_counts(arrays: Mapping[str, NDArray[Any]], sizes: Mapping[str, int]) -> None:
    for name, of in (("observation_count", "O"), ("corner_count", "C")):
        counts = arrays[name]
        if counts.min() < 0 or counts.max() > sizes[of] or counts.sum() != sizes[of]:
            raise ValueError(f"{name} does not add up to {sizes[of]}")
    anchor = arrays["anchor"]
    if arrays["corner_count"][anchor >= 0].any():
        raise ValueError("corner_count is not zero for a culled keyframe")
    if pixel_counts(arrays).sum() != sizes["S"]:
        raise ValueError(f"observation_uv of {sizes['S']} rows does not fit observation_count")
    if anchor[0] >= 0 or (anchor[anchor[anchor >= 0]] >= 0).any():
        raise ValueError("anchor names a culled keyframe, or keyframe 0 has one")


def _check_corners(arrays: Mapping[str, NDArray[Any]], width: int, height: int) -> None:
    """Corners must lie in their level's image, row by row: the search relies on it."""
    counts, corners = arrays["corner_count"].ravel(), arrays["corner"]
    level = np.repeat(np.tile(np.arange(LEVELS), len(counts) // LEVELS), counts)
    inside = (corners >= 0).all(axis=1) & (corners[:, 0] < width >> level) & (corners[:, 1] < height >> level)
    block = np.repeat(np.arange(len(counts)), counts)
    if not inside.all() or ((np.diff(corners[:, 1]) < 0) & (np.diff(block) == 0)).any():
        raise ValueError("corner lies outside its image or out of order")
