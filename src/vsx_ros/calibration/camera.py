"""Focal lengths, centre and distortion of a camera from views of a flat board.

Z. Zhang, "A flexible new technique for camera calibration", 2000, as OpenCV has it; plumb_bob without k3, which needs
wider lenses than a robot has.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, Pixels
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.verdict import Complaint, Grade, Verdict
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.slam.calibration_check import check_calibration

MIN_VIEWS, GOOD_VIEWS = 4, 10
OUTLIER_RATIO, OUTLIER_PX = 2.5, 0.5
GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 1.2
GOOD_FOCAL_RATIO, USABLE_FOCAL_RATIO = 0.003, 0.015
COVER_CELLS = (8, 6)
GOOD_COVER, GOOD_TILT_RAD = 0.6, math.radians(20.0)


class BoardView(NamedTuple):
    """One picture of the board. name: the file or number. pixels: (N, 2), as ``Board.find`` gives them."""

    name: str
    pixels: Pixels


class CameraCalibration(NamedTuple):
    """view_rms_px: of each view that was used, in the order given. left_out: names of views that contradict the others.
    focal_sigma_px, centre_sigma_px: standard errors. cover: share of the image where the board was. tilt: by how much
    the views turn the board at most [rad]."""

    camera: PinholeCamera
    rms_px: float
    view_rms_px: tuple[float, ...]
    left_out: tuple[str, ...]
    focal_sigma_px: float
    centre_sigma_px: float
    cover: float
    tilt: float
    verdict: Verdict

    def report(self) -> list[str]:
        """The result in lines for people."""
        left_out = f"; left out, as they contradict the others: {', '.join(self.left_out)}" if self.left_out else ""
        k1, k2, p1, p2, _ = self.camera.distortion
        return [
            f"residual      {self.rms_px:.3f} px rms, {max(self.view_rms_px):.3f} px in the worst picture{left_out}",
            f"focal length  {self.camera.fx:.2f} {self.camera.fy:.2f} px, known to {self.focal_sigma_px:.2f} px",
            f"centre        {self.camera.cx:.2f} {self.camera.cy:.2f} px, known to {self.centre_sigma_px:.2f} px",
            f"distortion    k1 {k1:.4f}  k2 {k2:.4f}  p1 {p1:.4f}  p2 {p2:.4f}",
            f"views         {100 * self.cover:.0f} % of the picture, tilted by up to {math.degrees(self.tilt):.0f} deg",
        ]

    def remark(self) -> str:
        """The result in two lines for a file."""
        count = f"{len(self.view_rms_px)} pictures"
        return f"vsx calibrate camera: {self.rms_px:.3f} px rms over {count}\n{self.verdict}"


class _Fit(NamedTuple):
    camera: PinholeCamera
    rms_px: float
    view_rms_px: FloatArray
    sigmas: FloatArray
    normals: FloatArray


def calibrate_camera(board: Board, views: Sequence[BoardView], width: int, height: int) -> CameraCalibration:
    """The camera that made the views, pictures of width x height px.

    Raises InputError for fewer than ``MIN_VIEWS`` views, CalibrationError when they determine no camera.
    """
    kept, left_out = list(views), []
    while True:
        if len(kept) < MIN_VIEWS:
            raise InputError(
                f"the board {board.columns}x{board.rows} is wholly seen in {len(views)} pictures and {len(kept)} of "
                f"them agree; {MIN_VIEWS} are needed, {GOOD_VIEWS} or more are good: check the number of inner "
                "corners, or show the board to the camera from more sides"
            )
        fit = _fit(board, kept, width, height)
        worst = int(np.argmax(fit.view_rms_px))
        bound_px = max(OUTLIER_PX, OUTLIER_RATIO * float(np.median(fit.view_rms_px)))
        if fit.view_rms_px[worst] <= bound_px:
            break
        left_out.append(kept.pop(worst).name)
    check_calibration(fit.camera, None)
    cover = covered(kept, width, height)
    cosines = np.clip(fit.normals @ fit.normals.T, -1.0, 1.0)
    tilt = math.acos(float(cosines.min()))
    focal, centre = float(fit.sigmas[:2].max()), float(fit.sigmas[2:4].max())
    verdict = _verdict(fit, focal, cover, tilt)
    return CameraCalibration(
        fit.camera, fit.rms_px, tuple(map(float, fit.view_rms_px)), tuple(left_out), focal, centre, cover, tilt, verdict
    )


def covered(views: Sequence[BoardView], width: int, height: int) -> float:
    """Share of the image's cells in which a view has a point."""
    cells = np.array(COVER_CELLS)
    pixels = np.concatenate([view.pixels for view in views])
    at = np.clip((pixels / [width, height] * cells).astype(int), 0, cells - 1)
    return len(np.unique(at, axis=0)) / float(cells.prod())


def _fit(board: Board, views: Sequence[BoardView], width: int, height: int) -> _Fit:
    objects = [board.points().astype(np.float32)] * len(views)
    pixels = [view.pixels.astype(np.float32).reshape(-1, 1, 2) for view in views]
    start = np.array([[width, 0.0, 0.5 * (width - 1)], [0.0, width, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    try:
        rms, K, distortion, rotations, _, sigmas, _, view_rms = cv2.calibrateCameraExtended(
            objects, pixels, (width, height), start, np.zeros(5), flags=cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS
        )
    except cv2.error as error:
        raise CalibrationError(
            f"{len(views)} views of the board determine no camera; show it tilted to all sides and in every corner"
        ) from error
    k1, k2, p1, p2, k3 = (float(d) for d in distortion.ravel()[:5])
    fx, fy, cx, cy = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
    camera = PinholeCamera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
    normals = np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation in rotations])
    return _Fit(camera, float(rms), view_rms.ravel(), sigmas.ravel(), normals)


def _verdict(fit: _Fit, focal_sigma_px: float, cover: float, tilt: float) -> Verdict:
    complaints = []

    def complain(grade: Grade, words: str) -> None:
        complaints.append(Complaint(grade, words))

    if fit.rms_px > GOOD_RMS_PX:
        grade = Grade.USABLE if fit.rms_px <= USABLE_RMS_PX else Grade.BAD
        complain(grade, f"the corners are {fit.rms_px:.2f} px off: glue the board to something flat, hold it still")
    ratio = focal_sigma_px / fit.camera.fx
    if ratio > GOOD_FOCAL_RATIO:
        grade = Grade.USABLE if ratio <= USABLE_FOCAL_RATIO else Grade.BAD
        complain(grade, f"the focal length is known to {100 * ratio:.1f} % only: tilt the board more, show it nearer")
    if len(fit.view_rms_px) < GOOD_VIEWS:
        complain(Grade.USABLE, f"{len(fit.view_rms_px)} views are few: give {GOOD_VIEWS} or more")
    if cover < GOOD_COVER:
        complain(Grade.USABLE, f"the board was in {100 * cover:.0f} % of the image: show it in every corner, too")
    if tilt < GOOD_TILT_RAD:
        complain(Grade.USABLE, f"the board was tilted by {math.degrees(tilt):.0f} deg at most: tilt it by 30 or more")
    return Verdict(tuple(complaints))
