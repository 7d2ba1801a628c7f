"""Corrects a map made with a wrong wheel calibration: its size, and the odometry between its keyframes."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.held_points import move_keyframes
from vsx_ros.slam.map import Map


class Recount(NamedTuple):
    """T_odom_base: pose of the base at the middle of the frames, by stamp, all in one frame. factor: scale to apply to
    the maps that it measured. stamp_ns, reason: when and why, in words."""

    T_odom_base: Mapping[int, SE2]
    factor: float
    stamp_ns: int
    reason: str


def recount(world: Map, wanted: Recount) -> None:
    """Replace the odometry of keyframes, also where it was ignored, aligned to the newest keyframe that used it; that
    of keyframes before them follows in one piece. Then scale the first map, and others with such keyframes, about their
    first cameras, so that the floor lies at the mount's height below them."""
    known = [k for k in range(len(world.keyframes)) if world.keyframes[k].data.stamp_ns in wanted.T_odom_base]
    held = [k for k in known if world.keyframes[k].data.T_odom_base is not None]
    if held:
        newest = world.keyframes[held[-1]].data
        assert newest.T_odom_base is not None
        T = newest.T_odom_base @ wanted.T_odom_base[newest.stamp_ns].inverse()
        oldest = world.keyframes[held[0]].data
        assert oldest.T_odom_base is not None
        before = T @ wanted.T_odom_base[oldest.stamp_ns] @ oldest.T_odom_base.inverse()
        for k in range(known[0]):
            if (T_odom_base := world.keyframes[k].data.T_odom_base) is not None:
                _count(world, k, before @ T_odom_base)
        for k in known:
            _count(world, k, T @ wanted.T_odom_base[world.keyframes[k].data.stamp_ns])
    if wanted.factor == 1.0 or not world.keyframes:  # none after a wrong start
        return
    measured = {world.keyframes[k].map_id for k in known}
    for map_id in sorted({0, *filter(world.is_metric, measured)}):
        nodes = world.living_in(map_id)
        old = [world.keyframes[k].T_world_cam for k in nodes]
        centre = old[0].translation
        poses = [SE3(T.rotation, centre + wanted.factor * (T.translation - centre)) for T in old]
        move_keyframes(world, nodes, poses, np.full(len(nodes), wanted.factor))


def _count(world: Map, index: int, T_odom_base: SE2) -> None:
    keyframe = world.keyframes[index]
    world.keyframes[index] = replace(keyframe, data=keyframe.data._replace(T_odom_base=T_odom_base))
