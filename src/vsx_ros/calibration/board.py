"""Flat patterns of known size: finding them in an image, and the camera's pose relative to them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, GrayImage, Pixels, Points3
from vsx_ros.errors import ConfigError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3

REFINE_SHARE, MAX_REFINE_PX = 0.3, 6  # of a square's side in px; a larger window sees the next corner


@dataclass(frozen=True)
class Board:
    """columns x rows inner corners of a checkerboard, or circles in a square grid, spacing [m] apart."""

    pattern: str
    columns: int
    rows: int
    spacing: float

    @classmethod
    def parse(cls, text: str, pattern: str = "checkerboard") -> Board:
        """The board of a text like 8x6x0.025. Raises ConfigError for anything else."""
        match = re.fullmatch(r"(\d+)x(\d+)x(\d*\.?\d+)", text.strip())
        columns, rows, spacing = (int(match[1]), int(match[2]), float(match[3])) if match else (0, 0, 0.0)
        if not (3 <= columns <= 50 and 3 <= rows <= 50 and 0.001 <= spacing <= 1.0):
            raise ConfigError(
                f"board {text!r}: give columns x rows x spacing, counting inner corners (or circles) from 3 to 50, and "
                "the spacing in metres, e.g. 8x6x0.025"
            )
        return cls(pattern, columns, rows, spacing)

    def points(self) -> Points3:
        """(columns * rows, 3) points on the board, row by row, z = 0 [m]."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return self.spacing * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)

    def find(self, image: GrayImage, *, quick: bool = False) -> Pixels | None:
        """(columns * rows, 2) pixels of ``points``, or None if the board is not completely in view. A board that looks
        the same upside down may be found upside down. quick: reject images without squares in a twentieth of the time;
        for videos, where a missed image does not matter."""
        size = (self.columns, self.rows)
        if quick and self.pattern == "checkerboard" and not cv2.checkChessboard(image, size):
            return None
        if self.pattern == "circles":
            found, pixels = cv2.findCirclesGrid(image, size, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
        else:
            found, pixels = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not found:
            return None
        if self.pattern == "checkerboard":
            pixels = _refined(image, pixels, self.columns)
        return np.asarray(pixels, float).reshape(-1, 2)


def _refined(image: GrayImage, corners: FloatArray, columns: int) -> FloatArray:
    """The corners refined to where their edges meet: more exact than the search, mainly near the pattern's border."""
    along = np.linalg.norm(np.diff(corners.reshape(-1, columns, 2), axis=1), axis=2).min()
    radius = int(np.clip(REFINE_SHARE * along, 2, MAX_REFINE_PX))
    enough = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 0.01)
    return np.asarray(cv2.cornerSubPix(image, corners, (radius, radius), (-1, -1), enough), float)


def board_poses(board: Board, camera: PinholeCamera, views: Sequence[Pixels | None]) -> list[SE3 | None]:
    """T_board_cam of each view [m], None where there is none. If a board looks the same upside down, the pose nearer to
    the one before is taken."""
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
    """The better of the two poses from which a plane looks the same, refined."""
    plane = np.ascontiguousarray(camera.unproject(pixels)[:, :2])
    _, rotation, translation = cv2.solvePnP(board.points(), plane, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    rotation, translation = cv2.solvePnPRefineLM(board.points(), plane, np.eye(3), None, rotation, translation)
    T_cam_board = SE3(cv2.Rodrigues(rotation)[0], translation.ravel())
    return T_cam_board.inverse()
