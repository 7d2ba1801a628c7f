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
    the first map. stamp_ns, reason: when and why, in words."""

    T_odom_base: Mapping[int, SE2]
    factor: float
    stamp_ns: int
    reason: str


def recount(world: Map, wanted: Recount) -> None:
    """Replace the odometry of keyframes, also where it was ignored, aligned to the newest keyframe that used it. Then
    scale the first map about its first camera, so that the floor lies at the mount's height below it."""
    known = [k for k in range(len(world.keyframes)) if world.keyframes[k].data.stamp_ns in wanted.T_odom_base]
    held = [k for k in known if world.keyframes[k].data.T_odom_base is not None]
    if held:
        newest = world.keyframes[held[-1]].data
        assert newest.T_odom_base is not None
        T = newest.T_odom_base @ wanted.T_odom_base[newest.stamp_ns].inverse()
        for k in known:
            data = world.keyframes[k].data
            counted = T @ wanted.T_odom_base[data.stamp_ns]
            world.keyframes[k] = replace(world.keyframes[k], data=data._replace(T_odom_base=counted))
    if wanted.factor == 1.0 or not world.keyframes:  # none after a wrong start
        return
    nodes, centre = world.living_in(0), world.keyframes[0].T_world_cam.translation
    old = [world.keyframes[k].T_world_cam for k in nodes]
    poses = [SE3(T.rotation, centre + wanted.factor * (T.translation - centre)) for T in old]
    move_keyframes(world, nodes, poses, np.full(len(nodes), wanted.factor))
