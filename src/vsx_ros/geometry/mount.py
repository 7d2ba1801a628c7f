"""Where a camera sits on a robot."""

import math

import numpy as np

from vsx_ros.config import MountConfig
from vsx_ros.geometry.se3 import SE3


def mount_pose(forward: float, left: float, height: float, pitch: float, yaw: float = 0.0) -> SE3:
    """T_base_cam of a camera on a robot: position [m] in the base frame, pitch down and yaw left positive [rad].

    Base: x forward, z up. Camera (optical): z forward, x right, y down (REP 103)."""
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    Rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    Ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return SE3(Rz @ Ry @ optical, np.array([forward, left, height]))


def mounted(mount: MountConfig) -> SE3:
    """T_base_cam of a camera that sits on the base as configured."""
    return mount_pose(mount.forward_m, mount.left_m, mount.height_m, mount.pitch_down_rad, mount.yaw_left_rad)
