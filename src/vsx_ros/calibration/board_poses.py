"""Where the camera is as seen from a board, picture after picture."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vsx_ros.arrays import Pixels
from vsx_ros.calibration.board import Board
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3


def board_poses(board: Board, camera: PinholeCamera, views: Sequence[Pixels | None]) -> list[SE3 | None]:
    """T_board_cam of each view [m], None where there is none.

    A board that looks the same upside down is taken the way up that is nearer to the pose before.
    """
    poses: list[SE3 | None] = []
    latest: SE3 | None = None
    for pixels in views:
        if pixels is None:
            poses.append(None)
            continue
        found = [_pose(board, camera, either) for either in (pixels, pixels[::-1])]
        before = latest or found[0]
        latest = min(found, key=lambda T: float(np.linalg.norm((before.inverse() @ T).log())))
        poses.append(latest)
    return poses


def _pose(board: Board, camera: PinholeCamera, pixels: Pixels) -> SE3:
    """The better of the two poses from which a plane looks alike, refined."""
    plane = np.ascontiguousarray(camera.unproject(pixels)[:, :2])
    _, rotation, translation = cv2.solvePnP(board.points(), plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    rotation, translation = cv2.solvePnPRefineLM(board.points(), plane, np.eye(3), None, rotation, translation)
    T_cam_board = SE3(cv2.Rodrigues(rotation)[0], translation.ravel())
    return T_cam_board.inverse()
