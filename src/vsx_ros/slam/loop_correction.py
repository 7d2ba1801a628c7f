"""Correcting a place seen twice: close the loop or merge two maps, then make one point of two.

Two points become one where keyframes look for points that the map knows from elsewhere and find them at spots where
they have seen points of their own.
"""

import numpy as np

from vsx_ros.arrays import IntArray
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.local_map import nearest_keyframes
from vsx_ros.slam.loop_closing import is_metric, path_lengths, same_points
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_points import find_unseen
from vsx_ros.slam.point_creation import observations_at
from vsx_ros.slam.pose_graph import LoopClosure, move_keyframes, optimize_pose_graph
from vsx_ros.slam.state import SlamEvent


def correct_loops(world: Map, closures: list[LoopClosure], around: list[int]) -> SlamEvent:
    """Change the map by loop closures of the same two parts; around: keyframes that shall look for the older part's
    points. Returns what was done."""
    last = closures[-1]
    older, newer = world.keyframes[last.older], world.keyframes[last.newer]
    around_older = nearest_keyframes(world.view().part(older.map_id), older.T_world_cam)[:8]
    known = world.seen_by([older.id, *around_older.tolist()])
    if older.map_id == newer.map_id:
        way = path_lengths(world)
        length = way[last.newer] - way[last.older]
        moved = optimize_pose_graph(world, newer.map_id, closures, free_scale=not is_metric(world, older, newer))
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


RADIUS_PX = 6.0


def fuse(world: Map, keyframes: list[int], rows: IntArray) -> int:
    """Let keyframes (indices) see the points (rows) where they appear in them; their own points at the same spots
    become these. Returns the number of points fused."""
    votes: dict[tuple[int, int], int] = {}
    view = world.view()
    found_in = {k: find_unseen(world.keyframes[k], view, rows, RADIUS_PX) for k in keyframes}
    for k, (predictions, uv) in found_in.items():
        mine_and_known = same_points(world.keyframes[k], predictions.rows, uv, predictions.level)
        for mine, known in zip(*(rows.tolist() for rows in mine_and_known)):
            votes[mine, known] = votes.get((mine, known), 0) + 1
    becomes: dict[int, int] = {}
    for (mine, known), _ in sorted(votes.items(), key=lambda item: (-item[1], item[0])):
        if mine not in becomes and mine not in becomes.values() and known not in becomes:
            becomes[mine] = known
    old = np.array(sorted(becomes), np.int64)
    world.replace_points(old, np.array([becomes[int(k)] for k in old], np.int64))
    for k, (predictions, uv) in found_in.items():
        unseen = ~np.isin(predictions.rows, world.keyframes[k].observations.rows)
        seen = predictions.rows[unseen], uv[unseen], predictions.level[unseen]
        keyframe = world.keyframes[k]
        world.observe(k, observations_at(keyframe.data, keyframe.T_world_cam, world.points, *seen))
    return len(old)
