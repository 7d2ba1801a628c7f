"""Correcting a place seen twice: close the loop or merge two maps, then make one point of two."""

from __future__ import annotations

import numpy as np

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.fusion import fuse
from vsx_ros.slam.loop_closing import LoopClosure, is_metric, neighbourhood, path_lengths
from vsx_ros.slam.map import Map
from vsx_ros.slam.pose_graph import Loop, move_keyframes, optimize_pose_graph
from vsx_ros.slam.state import SlamEvent


def correct_loops(world: Map, closures: list[LoopClosure], around: list[int]) -> SlamEvent:
    """Change the map by loop closures of the same two parts; around: keyframes that shall look for the older part's
    points. Returns what was done."""
    last = closures[-1]
    older, newer = world.keyframes[last.older], world.keyframes[last.newer]
    known = neighbourhood(world, world.view(), older)
    if older.map_id == newer.map_id:
        way = path_lengths(world)
        length = way[last.newer] - way[last.older]
        loops = [Loop(r.older, r.newer, r.T_older_newer, r.factor) for r in closures]
        moved = optimize_pose_graph(world, newer.map_id, loops, free_scale=not is_metric(world, older, newer))
        kind, what = "loop closed", f"after {length:.1f} m, {moved:.3f} m off"
    else:
        apart = newer.map_id
        _join(world, last)
        kind, what = "merged", f"map {apart} into map {older.map_id}, {last.factor:.3f} times as large"
    fused = fuse(world, around, known)
    why = f"keyframe {last.newer} shows the place of {last.older}, {last.points} points"
    return SlamEvent(newer.data.stamp_ns, kind, f"{what}: {why}; {fused} points fused")


def _join(world: Map, closure: LoopClosure) -> None:
    """Carry one map as a whole to where the keyframe was recognised."""
    newer, factor = world.keyframes[closure.newer], closure.factor
    nodes = world.living_in(newer.map_id)
    T_old, T_new = newer.T_world_cam.inverse(), closure.place(world)
    steps = [T_old @ world.keyframes[k].T_world_cam for k in nodes]
    poses = [T_new @ SE3(T.rotation, factor * T.translation) for T in steps]
    move_keyframes(world, nodes, poses, np.full(len(nodes), factor))
    world.join(newer.map_id, world.keyframes[closure.older].map_id)
