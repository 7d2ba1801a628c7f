"""Obstacles where a map shows only some of their cells: a plain wall is a row of dots to a camera."""

import math

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray

_ROW_CELLS, _ROW_LENGTH_M, _ROW_STEP_RAD = 12, 1.0, math.pi / 90
"""So many obstacle cells in a line so long are a wall; how finely its direction is looked for."""


def walls(
    occupied: BoolArray, resolution: float, narrow_m: float, gap_m: float, share: float = 0.0, thickness: int = 1
) -> BoolArray:
    """(H, W) obstacle cells with their gaps: those narrower than narrow_m [m] anywhere, those shorter than gap_m [m] in
    straight rows. share: at least so much of a row is obstacle; with less, they may as well be things in
    line. thickness: of the rows [cells]; rays slip through the corners of thin ones.
    """
    cells = occupied.astype(np.uint8)
    width = max(1, round(narrow_m / resolution)) | 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    padded = cv2.copyMakeBorder(cells, width, width, width, width, cv2.BORDER_CONSTANT, value=0)
    closed = np.ascontiguousarray(cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[width:-width, width:-width])
    lines = cv2.HoughLinesP(
        255 * cells, 1.0, _ROW_STEP_RAD, _ROW_CELLS,
        minLineLength=_ROW_LENGTH_M / resolution, maxLineGap=gap_m / resolution,
    )  # fmt: skip
    beside = cv2.dilate(cells, np.ones((3, 3), np.uint8))
    for x0, y0, x1, y1 in lines.reshape(-1, 4).tolist() if lines is not None else []:
        n = max(abs(x1 - x0), abs(y1 - y0)) + 1
        rows, columns = np.rint(np.linspace((y0, x0), (y1, x1), n)).astype(int).T
        if beside[rows, columns].mean() >= share:
            cv2.line(closed, (x0, y0), (x1, y1), 1, thickness)
    found: BoolArray = closed > 0
    return found
