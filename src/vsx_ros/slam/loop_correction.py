"""Corrects the map at a place seen twice: closes the loop by a pose graph or merges two maps, then fuses points.

Keyframes search for points that the map knows from elsewhere. A point found at the pixel of an own point is fused with
it."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Pixels
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.kernels.slam.pose_graph import Edges, count_shared, optimize_graph
from vsx_ros.slam.held_points import move_keyframes
from vsx_ros.slam.keyframe import METRIC, KeyFrame, unit_of
from vsx_ros.slam.local_map import nearest_keyframes, path_lengths
from vsx_ros.slam.map import Map
from vsx_ros.slam.map_points import find_unseen, observe_at
from vsx_ros.slam.state import SlamEvent

# Standard deviations between two keyframes that share points: a constant and a share of the distance.
DISTANCE_M, DISTANCE_RATIO, ANGLE_RAD, ANGLE_RAD_M, SCALE, SCALE_RATIO = 0.002, 0.01, 0.001, 0.005, 0.002, 0.01
LOOSE = 5.0
WEAK_COVISIBILITY, STRONG_COVISIBILITY, NEIGHBOURS = 15, 60, 2
LOOP_SIGMA = np.array([0.004, 0.004, 0.004, 0.002, 0.002, 0.002, 0.003])
ITERATIONS = 12
SAME_PX = 2.0
RADIUS_PX = 6.0


class LoopClosure(NamedTuple):
    """Keyframe ``newer`` was recognised by ``older``. T_older_newer: its pose by that part of the map. factor: by how
    much its own part must be scaled. points: how many were found."""

    older: int
    newer: int
    T_older_newer: SE3
    factor: float
    points: int = 0

    def place(self, world: Map) -> SE3:
        """T_world_cam of ``newer`` by ``older``'s part of the map, in the frame of ``older``'s map."""
        return world.keyframes[self.older].T_world_cam @ self.T_older_newer

    def exchanged(self) -> "LoopClosure":
        """The same the other way round: by how much, and to where, the older part must move."""
        T_newer_older, factor = self.T_older_newer.scaled(1.0 / self.factor).inverse(), 1.0 / self.factor
        return LoopClosure(
            older=self.newer, newer=self.older, T_older_newer=T_newer_older, factor=factor, points=self.points
        )


class _Edge(NamedTuple):
    a: int
    b: int
    T_a_b: SE3
    scale: float
    sigma: FloatArray


def optimize_pose_graph(world: Map, map_id: int, loops: list[LoopClosure], free_scale: bool) -> float:
    """Move all living keyframes of a map but the first so that the loops close. Uncertain edges give way most: above
    all those between successive keyframes with few shared points. free_scale: without odometry the scale drifts too.

    Returns how far the last keyframe of the loops moved [the map's unit]."""
    nodes = world.living_in(map_id)
    number = {k: n for n, k in enumerate(nodes)}
    before = [world.keyframes[k].T_world_cam for k in nodes]
    metre = unit_of(world.keyframes, loops[-1].newer, loops[-1].older).metre
    sigma = LOOP_SIGMA * np.repeat([metre, 1.0], [3, 4])
    edges = [
        _Edge(a=number[e.older], b=number[e.newer], T_a_b=e.T_older_newer, scale=e.factor, sigma=sigma) for e in loops
    ]
    edges += _edges_within(world, nodes, before)
    a, b, T_a_b, scale, sigmas = zip(*edges)
    information = np.array([np.diag(s**-2.0) for s in sigmas])
    R, t = stacked(T_a_b)
    graph = Edges(
        a=np.array(a, np.int64), b=np.array(b, np.int64), R=R, t=t, s=np.array(scale), information=information
    )
    fixed = np.arange(len(nodes)) == 0
    R, t, s, _ = optimize_graph(*stacked(before), np.ones(len(nodes)), fixed, graph, free_scale, ITERATIONS)
    after = [SE3(*pose) for pose in zip(R, t)]
    move_keyframes(world, nodes, after, s)
    last = number[loops[-1].newer]
    return float(np.linalg.norm(after[last].translation - before[last].translation))


def _edges_within(world: Map, nodes: list[int], poses: list[SE3]) -> list[_Edge]:
    """Edges at the present poses: between successive keyframes, and to the two earlier ones that share most points."""
    rows = [world.keyframes[k].observations.rows for k in nodes]
    ends = np.cumsum([len(mine) for mine in rows], dtype=np.int64)
    shared = count_shared(np.concatenate([np.zeros(0, np.int64), *rows]), ends, len(world.points))
    edges = []
    for n in range(1, len(nodes)):
        edges.append(_edge(world, nodes, poses, n - 1, n, bool(shared[n, n - 1] < WEAK_COVISIBILITY)))
        earlier = np.argsort(-shared[n, : n - 1], kind="stable")[:NEIGHBOURS]
        edges += [_edge(world, nodes, poses, int(m), n, False) for m in earlier if shared[n, m] >= STRONG_COVISIBILITY]
    return edges


def _edge(world: Map, nodes: list[int], poses: list[SE3], a: int, b: int, loose: bool) -> _Edge:
    T_a_b = poses[a].inverse() @ poses[b]
    distance = float(np.linalg.norm(T_a_b.translation))
    depth = max(world.keyframes[nodes[a]].median_depth, 1e-6)
    metre = unit_of(world.keyframes, nodes[b], nodes[a]).metre
    off = DISTANCE_M * metre + DISTANCE_RATIO * distance
    angle = ANGLE_RAD + ANGLE_RAD_M * distance / metre
    scale = SCALE + SCALE_RATIO * distance / depth
    sigma = np.array([off] * 3 + [angle] * 3 + [scale])
    return _Edge(a=a, b=b, T_a_b=T_a_b, scale=1.0, sigma=LOOSE * sigma if loose else sigma)


def correct_loops(world: Map, closures: list[LoopClosure], around: list[int]) -> SlamEvent:
    """Correct the map by loop closures of the same two parts. around: keyframes that search for the older part's
    points. Returns what was done."""
    last = closures[-1]
    older, newer = world.keyframes[last.older], world.keyframes[last.newer]
    around_older = nearest_keyframes(world.live_view().part(older.map_id), older.T_world_cam)[:8]
    known = world.seen_by([older.id, *around_older.tolist()])
    if older.map_id == newer.map_id:
        way = path_lengths(world.live_view())
        length = way[last.newer] - way[last.older]
        free_scale = not scale_is_observed(world, older, newer)
        moved = optimize_pose_graph(world, newer.map_id, closures, free_scale=free_scale)
        unit = unit_of(world.keyframes, last.newer, last.older).word
        kind, what = "loop closed", f"after {length:.1f} {unit}, {moved:.3f} {unit} off"
    else:
        apart = newer.map_id
        _join(world, last)
        kind, what = "merged", f"map {apart} into map {older.map_id}, {last.factor:.3f} times as large"
    fused = fuse(world, around, known)
    why = f"keyframe {last.newer} shows the place of {last.older}, {last.points} points"
    return SlamEvent(max(older.data.stamp_ns, newer.data.stamp_ns), kind, f"{what}: {why}; {fused} points fused")


def _join(world: Map, closure: LoopClosure) -> None:
    """Move one map as a whole to where the keyframe was recognised."""
    newer, factor = world.keyframes[closure.newer], closure.factor
    nodes = world.living_in(newer.map_id)
    T_old, T_new = newer.T_world_cam.inverse(), closure.place(world)
    poses = [T_new @ (T_old @ world.keyframes[k].T_world_cam).scaled(factor) for k in nodes]
    move_keyframes(world, nodes, poses, np.full(len(nodes), factor))
    world.join(newer.map_id, world.keyframes[closure.older].map_id)


def fuse(world: Map, keyframes: list[int], rows: IntArray) -> int:
    """Search for the points (rows) in keyframes (indices) and add observations. Own points of a keyframe at the same
    pixels are replaced by them. Returns the number of points fused."""
    votes: dict[tuple[int, int], int] = {}
    view = world.live_view()
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
        unseen = world.alive[predictions.rows] & ~np.isin(predictions.rows, world.keyframes[k].observations.rows)
        observe_at(world, k, predictions.rows[unseen], uv[unseen], predictions.level[unseen])
    return len(old)


def same_points(keyframe: KeyFrame, rows: IntArray, uv: Pixels, level: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of points (mine, known): seen by a keyframe, and found in it (rows) at the same place (uv, level)."""
    observed = keyframe.observations
    if not len(rows) or not len(observed.rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    apart = np.linalg.norm(uv[:, None] - observed.uv[None], axis=2)
    near = apart.argmin(axis=1)
    tolerance = SAME_PX * 2.0 ** np.maximum(level, observed.level[near])
    same: BoolArray = (apart[np.arange(len(rows)), near] < tolerance) & (np.abs(level - observed.level[near]) <= 1)
    same &= observed.rows[near] != rows
    return observed.rows[near[same]], rows[same]


def scale_is_observed(world: Map, *keyframes: KeyFrame) -> bool:
    """Whether odometry determines the scale of the map around the keyframes."""
    return all(unit_of(world.keyframes, keyframe.id) == METRIC for keyframe in keyframes)
