"""Focal lengths, centre and distortion of a camera from views of a flat board, and the choice of useful views.

Z. Zhang, "A flexible new technique for camera calibration", 2000, in OpenCV's implementation. radtan is plumb_bob
without k3, which matters only for wide lenses; these need rational or fisheye."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np

from vsx_ros.arrays import FloatArray, Pixels
from vsx_ros.calibration.board import Board
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera, check_calibration
from vsx_ros.geometry.lens import COEFFICIENTS, EQUIDISTANT, PLUMB_BOB, RATIONAL

Fit: TypeAlias = tuple[float, Any, Any, Any, Any, Any]
"""OpenCV's result: rms [px], K, coefficients, rotations of the board, standard errors, rms of each view [px]."""

MODELS = {"radtan": PLUMB_BOB, "rational": RATIONAL, "fisheye": EQUIDISTANT}
# Start of the search, focal length per image width: fields of view of 53 degrees, for wide lenses also 90, and 180.
START_FOCAL_RATIOS = {PLUMB_BOB: (1.0,), RATIONAL: (1.0, 0.5), EQUIDISTANT: (1.0 / math.pi,)}
MIN_VIEWS, GOOD_VIEWS = 4, 10  # three determine a camera (Zhang 2000); ten or more is common advice
OUTLIER_RATIO, OUTLIER_PX = 2.5, 0.5  # a view above both, times the median error and px, is blurred or wrong
GOOD_RMS_PX, USABLE_RMS_PX = 0.5, 1.2  # more is blur or a bent board
GOOD_FOCAL_RATIO, USABLE_FOCAL_RATIO = 0.003, 0.015  # standard deviation: 1 cm and 5 cm in 3 m
COVER_CELLS = (8, 6)  # of the image, columns and rows
GOOD_COVER, GOOD_TILT_RAD = 0.6, math.radians(20.0)  # of the cells; flat views do not determine the focal length
NOVEL, MAX_VIEWS = 0.2, 40  # sum of differences of place, size and tilt (each about 0 to 1); limit to save time
_LEAST = 1e-15  # information, as a share: below it there is none
EDGE, NEAR, FAR, TILT = 0.12, 0.4, 0.35, 0.08  # shares of the image; log ratio of opposite sides of the board


class BoardView(NamedTuple):
    """One image of the board. name: the file or number. pixels: (N, 2), from ``Board.find``."""

    name: str
    pixels: Pixels


class CameraCalibration(NamedTuple):
    """view_rms_px: of each used view, in the given order. left_out: names of views that contradict the others.
    focal_sigma_px, centre_sigma_px: standard errors. cover: share of the image where the board was. tilt: largest angle
    between the board in two views [rad]."""

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
        """The result as lines for the user."""
        left_out = f"; left out, as they contradict the others: {', '.join(self.left_out)}" if self.left_out else ""
        names = {EQUIDISTANT: "k1 k2 k3 k4"}.get(self.camera.model, "k1 k2 p1 p2 k3 k4 k5 k6").split()
        known = "  ".join(f"{k} {value:.4f}" for k, value in zip(names, self.camera.distortion) if value)
        return [
            f"residual      {self.rms_px:.3f} px rms, {max(self.view_rms_px):.3f} px in the worst picture{left_out}",
            f"focal length  {self.camera.fx:.2f} {self.camera.fy:.2f} px, known to {self.focal_sigma_px:.2f} px",
            f"centre        {self.camera.cx:.2f} {self.camera.cy:.2f} px, known to {self.centre_sigma_px:.2f} px",
            f"distortion    {self.camera.model}: {known}",
            f"views         {100 * self.cover:.0f} % of the picture, tilted by up to {math.degrees(self.tilt):.0f} deg",
        ]

    def remark(self) -> str:
        """The result as two lines for a file."""
        count = f"{len(self.view_rms_px)} pictures"
        return f"vsx calibrate camera: {self.rms_px:.3f} px rms over {count}\n{self.verdict}"


def calibrate_camera(
    board: Board, views: Sequence[BoardView], width: int, height: int, model: str = "radtan"
) -> CameraCalibration:
    """The camera of the views, images of width x height px, with one of ``MODELS``. Raises InputError for fewer than
    ``MIN_VIEWS`` views, CalibrationError when they determine no camera."""
    kept, left_out = list(views), []
    while True:
        if len(kept) < MIN_VIEWS:
            raise InputError(
                f"the board {board.columns}x{board.rows} is wholly seen in {len(views)} pictures and {len(kept)} of "
                f"them agree; {MIN_VIEWS} are needed, {GOOD_VIEWS} or more are good: check the number of inner "
                "corners, or show the board to the camera from more sides"
            )
        camera, rms_px, of_views_px, sigmas, normals = _fit(board, kept, width, height, model)
        worst = int(np.argmax(of_views_px))
        if of_views_px[worst] <= max(OUTLIER_PX, OUTLIER_RATIO * float(np.median(of_views_px))):
            break
        left_out.append(kept.pop(worst).name)
    check_calibration(camera, None)
    cover = covered(kept, width, height)
    tilt = math.acos(float(np.clip(normals @ normals.T, -1.0, 1.0).min()))
    focal, centre = float(sigmas[:2].max()), float(sigmas[2:4].max())
    verdict = _verdict(rms_px, focal / camera.fx, len(kept), cover, tilt)
    view_rms_px = tuple(map(float, of_views_px))
    return CameraCalibration(
        camera=camera,
        rms_px=rms_px,
        view_rms_px=view_rms_px,
        left_out=tuple(left_out),
        focal_sigma_px=focal,
        centre_sigma_px=centre,
        cover=cover,
        tilt=tilt,
        verdict=verdict,
    )


def covered(views: Sequence[BoardView], width: int, height: int) -> float:
    """Share of the image's cells in which a view has a point."""
    cells = np.array(COVER_CELLS)
    pixels = np.concatenate([view.pixels for view in views])
    at = np.clip((pixels / [width, height] * cells).astype(int), 0, cells - 1)
    return len(np.unique(at, axis=0)) / float(cells.prod())


def _fit(
    board: Board, views: Sequence[BoardView], width: int, height: int, model: str
) -> tuple[PinholeCamera, float, FloatArray, FloatArray, FloatArray]:
    """The camera; the residual [px rms] of all views and of each; standard errors of fx, fy, cx, cy and more [px]; and
    the board's normal in each view (N, 3)."""
    name = MODELS[model]
    objects, pixels = [board.points()[None]] * len(views), [view.pixels[None] for view in views]
    try:
        fits = [_fitted(name, objects, pixels, (width, height), ratio * width) for ratio in START_FOCAL_RATIOS[name]]
    except cv2.error as error:
        raise CalibrationError(
            f"{len(views)} views of the board determine no camera; show it tilted to all sides and in every corner"
        ) from error
    rms, K, distortion, rotations, sigmas, view_rms = min(fits, key=lambda fit: fit[0])
    coefficients = tuple(distortion.ravel()[: COEFFICIENTS[name]].tolist())
    fx, fy, cx, cy = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
    camera = PinholeCamera(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, distortion=coefficients, model=name)
    normals = np.array([cv2.Rodrigues(rotation)[0][:, 2] for rotation in rotations])
    return camera, float(rms), view_rms.ravel(), sigmas.ravel(), normals


def _fitted(
    name: str, objects: list[FloatArray], pixels: list[FloatArray], size: tuple[int, int], focal_px: float
) -> Fit:
    """OpenCV's fit from a start value of the focal length."""
    start = np.array([[focal_px, 0.0, 0.5 * (size[0] - 1)], [0.0, focal_px, 0.5 * (size[1] - 1)], [0.0, 0.0, 1.0]])
    if name == EQUIDISTANT:
        return _fisheye(objects, pixels, size, start)
    flags = cv2.CALIB_RATIONAL_MODEL if name == RATIONAL else cv2.CALIB_FIX_K3
    corners, seen = ([np.asarray(each[0], np.float32) for each in part] for part in (objects, pixels))
    rms, K, D, rotations, shifts, _, _, view_rms = cv2.calibrateCameraExtended(
        corners, seen, size, start, np.zeros(8), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    posed = zip(corners, rotations, shifts)
    projected = [cv2.projectPoints(points, rotation, shift, K, D)[1] for points, rotation, shift in posed]
    by_view = [np.hstack([J[:, 6 : 10 + COEFFICIENTS[name]], J[:, :6]]) for J in projected]
    return float(rms), K, D, rotations, _sigmas(by_view, view_rms.ravel()), view_rms


def _fisheye(objects: list[FloatArray], pixels: list[FloatArray], size: tuple[int, int], start: FloatArray) -> Fit:
    flags = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW | cv2.fisheye.CALIB_USE_INTRINSIC_GUESS
    rms, K, D, rotations, shifts = cv2.fisheye.calibrate(objects, pixels, size, start, np.zeros((4, 1)), flags=flags)
    by_view, view_rms = list[FloatArray](), list[float]()
    for points, seen, rotation, shift in zip(objects, pixels, rotations, shifts):
        again, J = cv2.fisheye.projectPoints(points, rotation, shift, K, D)
        view_rms.append(math.sqrt(float(((again - seen) ** 2).sum()) / points.shape[1]))
        by_view.append(J[:, :14])
    return float(rms), K, D, rotations, _sigmas(by_view, np.array(view_rms)), np.array(view_rms)


def _sigmas(by_view: Sequence[FloatArray], view_rms_px: FloatArray) -> FloatArray:
    """Standard errors of the lens's L parameters. by_view: of each view's pixels the derivatives (2 N, L + 6) by these
    and by the board's pose. OpenCV leaves out what the views do not determine, and so calls it exact."""
    lens = by_view[0].shape[1] - 6
    size = lens + 6 * len(by_view)
    H = np.zeros((size, size))
    for k, J in enumerate(by_view):
        columns = np.r_[:lens, lens + 6 * k : lens + 6 * k + 6]
        H[np.ix_(columns, columns)] += J.T @ J
    points = np.array([len(J) // 2 for J in by_view])
    noise = float(np.square(view_rms_px) @ points) / max(1, 2 * points.sum() - size)
    unit = 1.0 / np.sqrt(np.maximum(np.diag(H), _LEAST))
    information, axes = np.linalg.eigh(H * unit * unit[:, None])
    return np.asarray(unit * np.sqrt(noise * (axes**2 @ (1.0 / np.maximum(information, _LEAST)))))


def _verdict(rms_px: float, ratio: float, views: int, cover: float, tilt: float) -> Verdict:
    """ratio: the focal length's standard error as a share of it."""
    return Verdict([
        (Grade.of(rms_px <= GOOD_RMS_PX, rms_px <= USABLE_RMS_PX),
         f"the corners are {rms_px:.2f} px off: glue the board to something flat, hold it still"),
        (Grade.of(ratio <= GOOD_FOCAL_RATIO, ratio <= USABLE_FOCAL_RATIO),
         f"the focal length is known to {100 * ratio:.1f} % only: tilt the board more, show it nearer"),
        (Grade.of(views >= GOOD_VIEWS), f"{views} views are few: give {GOOD_VIEWS} or more"),
        (Grade.of(cover >= GOOD_COVER),
         f"the board was in {100 * cover:.0f} % of the image: show it in every corner, too"),
        (Grade.of(tilt >= GOOD_TILT_RAD),
         f"the board was tilted by {math.degrees(tilt):.0f} deg at most: tilt it by 30 or more"),
    ])  # fmt: skip


class ViewChooser:
    """Keeps views that differ in place, size or tilt: many similar views would outweigh the few useful ones."""

    def __init__(self, board: Board, width: int, height: int) -> None:
        self._board, self._size = board, np.array([width, height], float)
        self._features: list[FloatArray] = []
        self.views: list[BoardView] = []

    def offer(self, view: BoardView) -> bool:
        """Keep the view if it differs from all before; returns whether it was kept."""
        feature = self._feature(view)
        alike = any(np.abs(feature - known).sum() < NOVEL for known in self._features)
        if alike or len(self.views) >= MAX_VIEWS:
            return False
        self._features.append(feature)
        self.views.append(view)
        return True

    def missing(self) -> list[str]:
        """Where the board was not shown yet, in words; empty when the views are enough."""
        if not self.views:
            return ["the whole board"]
        pixels = np.concatenate([view.pixels for view in self.views]) / self._size
        _, _, size, across, along = np.array(self._features).T
        wanted = {
            "at the left edge": pixels[:, 0].min() > EDGE,
            "at the right edge": pixels[:, 0].max() < 1.0 - EDGE,
            "at the top": pixels[:, 1].min() > EDGE,
            "at the bottom": pixels[:, 1].max() < 1.0 - EDGE,
            "near, filling nearly half the picture": size.max() < NEAR,
            "farther away": size.min() > FAR,
            "tilted to the left and right": np.ptp(across) < 2.0 * TILT,
            "tilted up and down": np.ptp(along) < 2.0 * TILT,
        }
        more = ["from more sides"] if len(self.views) < GOOD_VIEWS else []
        return [words for words, lacking in wanted.items() if lacking] + more

    def _feature(self, view: BoardView) -> FloatArray:
        """Centre and size as shares of the image, and log ratios of the lengths of opposite sides."""
        grid = view.pixels.reshape(self._board.rows, self._board.columns, 2)
        corners = np.array([grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]])
        top, right, bottom, left = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        x, y = corners[:, 0], corners[:, 1]
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        centre = corners.mean(axis=0) / self._size
        size = math.sqrt(area / float(self._size.prod()))
        return np.array([*centre, size, math.log(left / right), math.log(top / bottom)])
