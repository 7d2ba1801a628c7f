"""Pictures of a board as a known camera sees it, ray by ray."""

import math

import cv2
import numpy as np

from vsx_ros.calibration.board import Board
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3, so3_exp

CAMERA = PinholeCamera(480, 360, 400.0, 402.0, 243.0, 176.0, (-0.12, 0.05, 0.001, -0.0008, 0.0))
BOARD = Board("checkerboard", 8, 6, 0.03)
_DOTS_PER_SPACING, _FINER = 40, 2


def printed(board: Board) -> np.ndarray:
    """The board on paper, the first corner (or circle) two spacings from the edge."""
    d = _DOTS_PER_SPACING
    paper = np.full(((board.rows + 3) * d, (board.columns + 3) * d), 235, np.uint8)
    if board.pattern == "circles":
        for row in range(board.rows):
            for column in range(board.columns):
                cv2.circle(paper, ((column + 2) * d, (row + 2) * d), d // 4, 20, -1)
        return paper
    for row in range(-1, board.rows):
        for column in range(-1, board.columns):
            if (row + column) % 2 == 0:
                paper[(row + 2) * d : (row + 3) * d, (column + 2) * d : (column + 3) * d] = 20
    return paper


class Photographer:
    """Takes the pictures; rays are computed once."""

    def __init__(self, camera: PinholeCamera = CAMERA, board: Board = BOARD) -> None:
        self.camera, self.board, self._paper = camera, board, printed(board)
        steps = (np.arange(_FINER) + 0.5) / _FINER - 0.5
        u = (np.arange(camera.width)[:, None] + steps).ravel()
        v = (np.arange(camera.height)[:, None] + steps).ravel()
        self._rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        self._rng = np.random.default_rng(0)

    def picture(self, T_cam_board: SE3) -> np.ndarray:
        """(height, width) uint8 with a little noise."""
        T_board_cam = T_cam_board.inverse()
        rays = self._rays @ T_board_cam.rotation.T
        origin = T_board_cam.translation
        ratio = -origin[2] / rays[:, 2]
        at = (origin[:2] + ratio[:, None] * rays[:, :2]) / self.board.spacing + 2.0
        maps = (
            (at * _DOTS_PER_SPACING - 0.5)
            .astype(np.float32)
            .reshape(self.camera.height * _FINER, self.camera.width * _FINER, 2)
        )
        fine = cv2.remap(self._paper, maps, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120)
        small = cv2.resize(fine, (self.camera.width, self.camera.height), interpolation=cv2.INTER_AREA)
        return np.clip(small + self._rng.normal(0.0, 1.5, small.shape), 0, 255).astype(np.uint8)


def pose(across: float, down: float, away: float, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> SE3:
    """T_cam_board with the board's centre at (across, down, away) [m], tilted."""
    R = so3_exp(np.radians([pitch_deg, 0.0, 0.0])) @ so3_exp(np.radians([0.0, yaw_deg, 0.0]))
    middle = BOARD.points().mean(axis=0)
    return SE3(R, np.array([across, down, away]) - R @ middle)


def poses(count: int, away: float = 0.45) -> list[SE3]:
    """Views as an operator shows them: round the picture, near and far, tilted to all sides."""
    found = []
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        far = away * (1.0, 1.35, 0.85)[k % 3]
        x, y = 0.17 * far * math.cos(angle), 0.12 * far * math.sin(angle)
        tilt = ((30, 0), (-30, 0), (0, 30), (0, -30), (20, 20))[k % 5]
        found.append(pose(x, y, far, *tilt))
    return found
