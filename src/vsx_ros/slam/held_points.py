"""A keyframe holds the points that were first seen in it, and in culled keyframes that are anchored to it. Where no
adjustment determines a point, it moves with the keyframe that holds it."""

from collections.abc import Mapping

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.slam.map import Map


def _holders(world: Map) -> IntArray:
    """(P,) index of the living keyframe that holds each point."""
    holders = [k.id if k.anchor is None else k.anchor.keyframe for k in world.keyframes]
    return np.array(holders, np.int64)[world.source]


def move_keyframes(world: Map, nodes: list[int], poses: list[SE3], factors: FloatArray) -> None:
    """Move keyframes (indices) to new poses and scale them by ``factors``, with all points that they hold."""
    before = [world.keyframes[k].T_world_cam for k in nodes]
    holder = _holders(world)
    order = np.argsort(holder, kind="stable")
    first, last = (np.searchsorted(holder, nodes, side, order) for side in ("left", "right"))
    for n, (k, old, new, factor) in enumerate(zip(nodes, before, poses, factors)):
        mine = order[first[n] : last[n]]
        world.points[mine] = new @ (factor * (old.inverse() @ world.points[mine]))
        world.resize_keyframe(k, new, float(factor))


def carry_points(world: Map, before: Mapping[int, SE3], adjusted: IntArray) -> None:
    """Move points with keyframes that an adjustment has moved (before: index and former pose of each), if fewer than
    two living keyframes see them: no adjustment determines those. adjusted: rows of the points that it determined."""
    holder, moved = _holders(world), np.zeros(len(world.keyframes), np.bool_)
    moved[list(before)] = True
    held = world.alive & moved[holder]
    held[adjusted] = False
    rows = np.flatnonzero(held)
    rows = rows[world.seen(rows)[rows] < 2]
    T = {k: world.keyframes[k].T_world_cam @ old.inverse() for k, old in sorted(before.items())}
    (R, t), by = stacked(list(T.values())), np.searchsorted(list(T), holder[rows])
    world.points[rows] = np.einsum("nij,nj->ni", R[by], world.points[rows]) + t[by]
