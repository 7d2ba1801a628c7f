"""Corrects a map made with a wrong wheel calibration: its size, and the odometry between its keyframes."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.held_points import move_keyframes
from vsx_ros.slam.map import Map


def _as_it_was(T_before_now: SE2, seconds: float) -> SE2:
    return T_before_now


class Recount(NamedTuple):
    """T_odom_base: pose of the base at the middle of the frames, by stamp, all in one frame. factor: scale to apply to
    the maps that it measured. stamp_ns, reason: when and why, in words. older: what (T_before_now, seconds) by odometry
    becomes where T_odom_base is not known any more: in an earlier epoch, or long ago."""

    T_odom_base: Mapping[int, SE2]
    factor: float
    stamp_ns: int
    reason: str
    older: Callable[[SE2, float], SE2] = _as_it_was


def recount(world: Map, wanted: Recount, loaded: int = 0) -> None:
    """Replace the odometry of keyframes, also where it was ignored, aligned to the newest keyframe that used it, and
    that of the older ones. loaded: so many first keyframes were made in another drive; their odometry follows in one
    piece. Then scale the first map, and others that this drive's odometry measured, about their first cameras, so that
    the floor lies at the mount's height below them."""
    known = [k for k in range(len(world.keyframes)) if world.keyframes[k].data.stamp_ns in wanted.T_odom_base]
    counted = _counted(world, known, wanted, loaded)
    for k, T_odom_base in counted.items():
        keyframe = world.keyframes[k]
        world.keyframes[k] = replace(keyframe, data=keyframe.data._replace(T_odom_base=T_odom_base))
    if wanted.factor == 1.0 or not world.keyframes:  # none after a wrong start
        return
    measured = {keyframe.map_id for keyframe in world.keyframes[loaded : max(counted, default=-1) + 1]}
    for map_id in sorted({0, *filter(world.is_metric, measured)}):
        nodes = world.living_in(map_id)
        old = [world.keyframes[k].T_world_cam for k in nodes]
        centre = old[0].translation
        poses = [SE3(T.rotation, centre + wanted.factor * (T.translation - centre)) for T in old]
        move_keyframes(world, nodes, poses, np.full(len(nodes), wanted.factor))


def _counted(world: Map, known: list[int], wanted: Recount, loaded: int) -> dict[int, SE2]:
    """T_odom_base of the known keyframes and of those before them. If none is known, the newest one keeps its own."""
    stamps_ns = [keyframe.data.stamp_ns for keyframe in world.keyframes]
    read = {k.id: k.data.T_odom_base for k in world.keyframes if k.data.T_odom_base is not None}
    held = [k for k in known if k in read] or list(read)[-1:]
    if not held:
        return {}
    newest, after = held[-1], held[0]
    counted = {newest: read[newest]}
    if newest in known:
        T = read[newest] @ wanted.T_odom_base[stamps_ns[newest]].inverse()
        counted = {k: T @ wanted.T_odom_base[stamps_ns[k]] for k in known}
    for k in sorted((k for k in read if k < min(counted)), reverse=True):
        step = read[k].inverse() @ read[after]
        if k >= loaded:
            step = wanted.older(step, (stamps_ns[after] - stamps_ns[k]) * 1e-9)
        counted[k], after = counted[after] @ step.inverse(), k
    return counted
