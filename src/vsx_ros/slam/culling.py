"""Which keyframes the map can do without: where a place has been passed again and again, the map grows no more (after
Mur-Artal et al., ORB-SLAM, T-RO 2015, VI.E; paper 3.1: fewer keyframes in explored area)."""

import numpy as np

from vsx_ros.arrays import IntArray
from vsx_ros.config import CullingConfig
from vsx_ros.slam.map import Map

# A keyframe with fewer points is held by little else: it stays. So does one whose neighbours in its epoch would be
# left to odometry alone without it.
ASSESSED_POINTS, TIED_POINTS = 40, 40


def cull_redundant(world: Map, among: list[int], config: CullingConfig) -> list[int]:
    """Cull those of the keyframes ``among`` (indices) that are redundant, the oldest first; returns them.

    Never the first two of a map, which hold its frame and its size, nor the newest ones."""
    held = {k for m in {world.keyframes[k].map_id for k in among} for k in world.living_in(m)[:2]}
    newest = set(world.living[-config.keep_newest :])
    culled = []
    for k in sorted(set(among) - held - newest):
        if world.keyframes[k].alive and is_redundant(world, k, config) and not _ties_its_epoch(world, k):
            world.cull_keyframe(k)
            culled.append(k)
    return culled


def is_redundant(world: Map, index: int, config: CullingConfig) -> bool:
    """Whether so large a share of a keyframe's points is seen by so many others from as near or nearer."""
    seen = world.keyframes[index].observations
    if len(seen.rows) < ASSESSED_POINTS:
        return False
    viewers = np.zeros(world.count, np.int64)
    finest: IntArray = np.full(world.count, -1, np.int64)
    finest[seen.rows] = seen.level
    for k in world.observers(seen.rows):
        if k != index:
            other = world.keyframes[k].observations
            viewers[other.rows[other.level <= finest[other.rows]]] += 1
    enough = np.count_nonzero(viewers[seen.rows] >= config.viewers)
    return bool(enough >= config.seen_ratio * len(seen.rows))


def _ties_its_epoch(world: Map, index: int) -> bool:
    """Whether the keyframes before and after it share too little to be held together by images without it."""
    before, after = world.predecessor(index), world.successor(index)
    if before is None or after is None:
        return False
    rows = world.keyframes[before].observations.rows
    return bool(np.isin(world.keyframes[after].observations.rows, rows).sum() < TIED_POINTS)
