"""Finds keyframes that show the same place as an image, and the image's pose, also in another light. Steps: similarity
of small images without their local mean, binary descriptors of the keyframe's points and its neighbours', pose
from the matches, patch search of all points in view."""

from typing import NamedTuple
from weakref import ref

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, IntArray, Points2, Points3, array_bytes
from vsx_ros.config.maps import RecognitionConfig
from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.geometry import unproject_pixels
from vsx_ros.slam.keyframe import FrameData, KeyFrame, MapView
from vsx_ros.slam.local_map import LocalMap
from vsx_ros.slam.track import Track
from vsx_ros.slam.tracker import Tracker
from vsx_ros.vision.corners import Features, describe, match
from vsx_ros.vision.pyramid import SmallImage

REMEMBERED = 400  # keyframes whose descriptors are kept; the least recently used are dropped
FAR = 20.0  # times the median distance: what lies farther away fixes no position, and ruins a linear solution
MIN_MATCHES, PNP_ERROR_PX = 12, 6.0  # three matches fix a pose, more rule out chance; px at level 0
PNP_TRIALS = 400  # 7 ms at most; enough for a pose that a quarter of the matches supports
SEARCH_RADIUS_PX = 12.0  # about twice the error of the pose by descriptors
SHIFT_X, SHIFT_Y = 6, 1  # px of the 20 x 15 image: a turn of 17 deg to each side, a tilt of 3 deg
CELLS = 4  # per row and per column
NEIGHBOURS = 2  # keyframes whose points are matched, too
LOCAL_PX = 3.0  # px of the small image: reach of the local mean


class Recognition(NamedTuple):
    """An image located in the map by one keyframe. matches: descriptor matches behind the first guess; track: what
    patch search then found around the keyframe, with the pose; cells: number of 4 x 4 image parts with found points."""

    keyframe: int
    track: Track
    matches: int
    cells: int

    def is_sure(self, config: RecognitionConfig) -> bool:
        """Whether this is the place, if other evidence supports it. A poster or chair that exists twice matches its own
        points but not those around it, and fills only a part of the image."""
        found, ratio = len(self.track.rows), self.track.ratio
        return found >= config.sure_found and ratio >= config.sure_ratio and self.cells >= config.sure_cells

    def is_certain(self, config: RecognitionConfig) -> bool:
        """Whether this is the place, even without other evidence."""
        found, ratio = len(self.track.rows), self.track.ratio
        return found >= config.certain_found and ratio >= config.certain_ratio and self.cells >= config.certain_cells


class _Described(NamedTuple):
    """Descriptors of a keyframe. rows: those of its observations then; others replace them. kept (n,): observations
    that are not too near to the border; bits (n, 32): of each."""

    rows: ref[IntArray]
    kept: NDArray[np.int32]
    bits: NDArray[np.uint8]


class PlaceRecognizer:
    """``ranked`` sorts keyframes by similarity, ``recognise`` tests whether one shows the place. Keeps the descriptors
    of the keyframes compared last."""

    def __init__(self, camera: PinholeCamera, tracker: Tracker) -> None:
        self._camera, self._array, self._tracker = camera, kernel_camera(camera), tracker
        self._described: dict[int, _Described] = {}
        self._tiny: dict[int, SmallImage] = {}

    @property
    def nbytes(self) -> int:
        """Size of what is kept of the keyframes [bytes]."""
        return array_bytes([*self._described.copy().values(), *self._tiny.copy().values()])

    def ranked(self, small: SmallImage, view: MapView, among: IntArray) -> IntArray:
        """The keyframes ``among`` (indices), those most similar to a small image first."""
        if not len(among):
            return among
        self._tiny = {k: tiny for k, tiny in self._tiny.items() if view.keyframes[k].alive}
        places = np.stack([self._shrunk(view.keyframes[int(k)]) for k in among])
        return among[np.argsort(-likeness(structure(small), places), kind="stable")]

    def recognise(self, data: FrameData, features: Features, view: MapView, index: int) -> Recognition | None:
        """The image located by keyframe ``index``; None when too few of its points match one consistent pose."""
        guess = self._guess(features, view, index)
        if guess is None:
            return None
        pose, matches = guess
        return self.verify(data, view, index, pose, SEARCH_RADIUS_PX, matches)

    def verify(
        self, data: FrameData, view: MapView, index: int, pose: SE3, radius_px: float, matches: int = 0
    ) -> Recognition:
        """The image located by keyframe ``index`` and its neighbours, from a guess of T_world_cam."""
        view = view.part(view.keyframes[index].map_id)
        track = self._tracker.track(data, view, pose, LocalMap(view, index).rows, radius_px)
        return Recognition(index, track, matches, occupied_cells(track.uv, self._camera))

    def _guess(self, features: Features, view: MapView, index: int) -> tuple[SE3, int] | None:
        """T_world_cam from descriptor matches with the points of a keyframe and its neighbours (perspective three-point
        and consensus)."""
        rows, here = self._matches(features, view, index)
        if len(rows) < MIN_MATCHES:
            return None
        centre = view.centres[index]
        plane = unproject_pixels(self._array, np.ascontiguousarray(features.uv[here]))
        error = PNP_ERROR_PX / min(self._camera.focal_px)
        found = pose_from_matches(np.ascontiguousarray(view.points[rows] - centre), plane, error)
        return None if found is None else (SE3(np.eye(3), centre) @ found[0].inverse(), found[1])

    def _matches(self, features: Features, view: MapView, index: int) -> tuple[IntArray, IntArray]:
        """Rows of points and indices of features that match, each pair once."""
        local = LocalMap(view.part(view.keyframes[index].map_id), index)
        covisible = [int(k) for k in local.near[np.argsort(-local.shared, kind="stable")] if k != index]
        pairs = []
        for k in [index, *covisible[:NEIGHBOURS]]:
            seen, known = self.described(view.keyframes[k])
            there, here = match(known, features)
            pairs.append(np.column_stack([seen[there], here]))
        rows, here = np.unique(np.concatenate(pairs), axis=0).T
        alive = view.alive[rows]
        return rows[alive], here[alive]

    def described(self, keyframe: KeyFrame) -> tuple[IntArray, Features]:
        """(rows of the points, features) of what a keyframe observes."""
        observed = keyframe.observations
        known = self._described.pop(keyframe.id, None)
        if known is None or known.rows() is not observed.rows:
            index, features = describe(keyframe.data.pyramid, observed.uv, observed.level)
            known = _Described(ref(observed.rows), index.astype(np.int32), features.bits)
        self._described[keyframe.id] = known
        if len(self._described) > REMEMBERED:
            del self._described[next(iter(self._described))]
        _, kept, bits = known
        return observed.rows[kept], Features(observed.uv[kept], observed.level[kept], bits)

    def _shrunk(self, keyframe: KeyFrame) -> SmallImage:
        if keyframe.id not in self._tiny:
            self._tiny[keyframe.id] = structure(keyframe.data.small)
        return self._tiny[keyframe.id]


def pose_from_matches(points: Points3, plane: Points2, error: float) -> tuple[SE3, int] | None:
    """T_cam_points by consensus of three-point poses, and how many points agree; None if too few do.

    points (N, 3): seen from about the origin. plane (N, 2): where the camera sees them at z = 1; error: what may differ
    there. OpenCV's own last step (EPnP) is ruined by a few points far away."""
    ok, _, _, inliers = cv2.solvePnPRansac(
        points, plane, np.eye(3), None, iterationsCount=PNP_TRIALS, reprojectionError=error, confidence=0.999,
        flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not ok or inliers is None or len(inliers) < MIN_MATCHES:
        return None
    agree = inliers.ravel()
    distance = np.linalg.norm(points[agree], axis=1)
    near = agree[distance <= FAR * np.median(distance)]
    ok, *pose = cv2.solvePnP(points[near], plane[near], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    if not ok:
        return None
    rotation, translation = cv2.solvePnPRefineLM(points[near], plane[near], np.eye(3), None, *pose)
    return SE3(np.asarray(cv2.Rodrigues(rotation)[0]), np.asarray(translation, float).ravel()), len(agree)


def occupied_cells(uv: NDArray[np.float64], camera: PinholeCamera) -> int:
    """How many of the 4 x 4 image parts hold at least two of the pixels (n, 2)."""
    column = np.clip((uv[:, 0] * CELLS / camera.width).astype(int), 0, CELLS - 1)
    row = np.clip((uv[:, 1] * CELLS / camera.height).astype(int), 0, CELLS - 1)
    return int(np.count_nonzero(np.bincount(row * CELLS + column, minlength=CELLS * CELLS) >= 2))


def structure(small: SmallImage) -> SmallImage:
    """A small image at half its size (20 x 15 for VGA), without its local mean, which lamps and sunlight change."""
    detail = small - cv2.GaussianBlur(small, (0, 0), LOCAL_PX)
    height, width = small.shape
    return np.asarray(cv2.resize(detail, (width // 2, height // 2), interpolation=cv2.INTER_AREA))


def likeness(query: SmallImage, places: NDArray[np.float32]) -> FloatArray:
    """(K,) best correlation of a halved small image (h, w) with each of K places (K, h, w), over shifts as from a turn
    of up to 17 deg to each side or a small tilt, or half the image if that is less; 1 for the same image."""
    count, height, width = places.shape
    most_y, most_x = min(SHIFT_Y, height // 2), min(SHIFT_X, width // 2)
    shifts = [(dy, dx) for dy in range(-most_y, most_y + 1) for dx in range(-most_x, most_x + 1)]
    shifted = np.zeros((len(shifts), height, width))
    inside = np.zeros((len(shifts), height, width))
    for n, (dy, dx) in enumerate(shifts):
        to = slice(max(0, dy), height + min(0, dy)), slice(max(0, dx), width + min(0, dx))
        of = slice(max(0, -dy), height - max(0, dy)), slice(max(0, -dx), width - max(0, dx))
        shifted[n][to] = query[of]
        inside[n][to] = 1.0
    flat, there = shifted.reshape(len(shifts), -1), places.reshape(count, -1).astype(float)
    power = np.sqrt((flat**2).sum(axis=1)[:, None] * (inside.reshape(len(shifts), -1) @ (there**2).T))
    return np.asarray(np.max((flat @ there.T) / (power + 1e-6), axis=0))
