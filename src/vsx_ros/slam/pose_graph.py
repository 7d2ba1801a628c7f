"""Pose graph optimisation, so that a place seen twice becomes one; points move with their keyframes."""

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.slam.pose_graph import Edges, count_shared, optimize_graph
from vsx_ros.slam.map import Map

# Standard deviations of what two keyframes that share points know of one another: a constant and a share of the way.
DISTANCE_M, DISTANCE_RATIO, ANGLE_RAD, ANGLE_RAD_M, SCALE, SCALE_RATIO = 0.002, 0.01, 0.001, 0.005, 0.002, 0.01
LOOSE = 5.0
WEAK_COVISIBILITY, STRONG_COVISIBILITY, NEIGHBOURS = 15, 60, 2
LOOP_SIGMA = np.array([0.004, 0.004, 0.004, 0.002, 0.002, 0.002, 0.003])
ITERATIONS = 12


class LoopClosure(NamedTuple):
    """Keyframe ``newer`` was recognised by ``older``: where it stands by that part of the map, how many times as large
    its own part would have to be, and how many points were found."""

    older: int
    newer: int
    T_older_newer: SE3
    factor: float
    points: int = 0

    def place(self, world: Map) -> SE3:
        """T_world_cam of ``newer`` by ``older``'s part of the map, in the frame of ``older``'s map."""
        return world.keyframes[self.older].T_world_cam @ self.T_older_newer


class _Edge(NamedTuple):
    a: int
    b: int
    T_a_b: SE3
    scale: float
    sigma: FloatArray


def optimize_pose_graph(world: Map, map_id: int, loops: list[LoopClosure], free_scale: bool) -> float:
    """Move all living keyframes of a map but the first so that the loops close, each stretch giving way as far as it is
    uncertain: where successive keyframes share few points, first. free_scale: without odometry the size drifts too.

    Returns how far the last keyframe of the loops moved [m]."""
    nodes = world.living_in(map_id)
    number = {k: n for n, k in enumerate(nodes)}
    before = [world.keyframes[k].T_world_cam for k in nodes]
    edges = [_Edge(number[e.older], number[e.newer], e.T_older_newer, e.factor, LOOP_SIGMA) for e in loops]
    edges += _edges_within(world, nodes, before)
    R, t, s, _ = optimize_graph(
        np.array([T.rotation for T in before]), np.array([T.translation for T in before]), np.ones(len(nodes)),
        np.arange(len(nodes)) == 0,
        Edges(
            np.array([e.a for e in edges], np.int64), np.array([e.b for e in edges], np.int64),
            np.array([e.T_a_b.rotation for e in edges]), np.array([e.T_a_b.translation for e in edges]),
            np.array([e.scale for e in edges]), np.array([np.diag(e.sigma**-2.0) for e in edges]),
        ), free_scale, ITERATIONS,
    )  # fmt: skip
    after = [SE3(R[n], t[n]) for n in range(len(nodes))]
    move_keyframes(world, nodes, after, s)
    last = number[loops[-1].newer]
    return float(np.linalg.norm(after[last].translation - before[last].translation))


def move_keyframes(world: Map, nodes: list[int], poses: list[SE3], factors: FloatArray) -> None:
    """Move keyframes (indices) to new poses, ``factors`` times as large, with the points first seen in them or in
    culled keyframes they carry."""
    before = [world.keyframes[k].T_world_cam for k in nodes]
    holder = carriers(world)[world.source]
    order = np.argsort(holder, kind="stable")
    first, last = (np.searchsorted(holder, nodes, side, order) for side in ("left", "right"))
    for n, (k, old, new, factor) in enumerate(zip(nodes, before, poses, factors)):
        mine = order[first[n] : last[n]]
        world.points[mine] = new @ (factor * (old.inverse() @ world.points[mine]))
        world.resize_keyframe(k, new, float(factor))


def carriers(world: Map) -> IntArray:
    """(K,) for each keyframe the living one that holds it: itself, or what carries it."""
    return np.array([k.id if k.anchor is None else k.anchor.keyframe for k in world.keyframes], np.int64)


def shared_points(world: Map, nodes: list[int]) -> IntArray:
    """(N, N) how many points each two of the keyframes (indices) share."""
    rows = [world.keyframes[k].observations.rows for k in nodes]
    ends = np.cumsum([len(mine) for mine in rows], dtype=np.int64)
    return count_shared(np.concatenate([np.zeros(0, np.int64), *rows]), ends, world.count)


def _edges_within(world: Map, nodes: list[int], poses: list[SE3]) -> list[_Edge]:
    """Successive keyframes, and for each the two earlier ones that share most points with it: as they stand now."""
    shared = shared_points(world, nodes)
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
    metres = DISTANCE_M + DISTANCE_RATIO * distance
    angle = ANGLE_RAD + ANGLE_RAD_M * distance
    scale = SCALE + SCALE_RATIO * distance / depth
    sigma = np.array([metres] * 3 + [angle] * 3 + [scale])
    return _Edge(a, b, T_a_b, 1.0, LOOSE * sigma if loose else sigma)
