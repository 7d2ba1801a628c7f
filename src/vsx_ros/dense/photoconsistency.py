"""Photo-consistency of cells: the second best correlation over several keyframes, compared with that at other depths.

Paper 5.1, after Argiles, Civera, Montesano (IROS 2011). Where the texture runs along the motion, the floor seen through
a gap can correlate as highly as a surface. So the correlation must be higher at the plane's depth than in front of it
and behind it."""

import math
from collections.abc import Set
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, GrayImage, IntArray, Points3, array_bytes, grown
from vsx_ros.config import DenseConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import stacked
from vsx_ros.kernels.dense import surface_cells as kernels
from vsx_ros.kernels.dense.view_choice import Views
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.vision.pyramid import layout, shrunk

_CULLED_KEPT = 300  # images of so many culled keyframes stay: until the surfaces that they show are settled
_UNPACKED = 300  # images that were used last: more than see one place
_STORE_WIDTH_PX = 320  # images are stored at about this width: a cell at 6 m is 4 px wide
_RIVAL_DEPTHS = np.array([0.65, 0.8, 1.2, 1.5])  # times the cell's depth; as good there, a cell is not believed
_ENOUGH_PARALLAX_DEG, _APART_DEG = 8.0, 1.0  # more is no better; views closer than this count as one
_HOPELESS_ZNCC = 0.5  # below this correlation with the first view, no other is computed
_REFUTED_ZNCC, _REFUTED_TEXTURE, _CARVED_VOTES = 0.4, 5.0, 1  # evidence against a cell; grey levels; rays through it


class Judgement(NamedTuple):
    """Arrays over cells, (N,) or (W, H). texture [grey levels]. score, rival: ZNCC at the cell, and at the best of the
    other depths. views: number compared. keyframe: id of the reference, -1 if no keyframe sees the cell."""

    texture: FloatArray
    score: FloatArray
    rival: FloatArray
    views: NDArray[np.int64]
    keyframe: NDArray[np.int64]

    def consistent(self, config: DenseConfig) -> BoolArray:
        """Cells that look alike at the plane's depth and less alike at others, in enough other keyframes."""
        alike = (self.texture >= config.min_texture) & (self.score >= config.accept_zncc)
        return np.asarray(alike & (self.score > self.rival + config.rival_margin) & (self.views >= config.min_views))

    def refuted(self, passing: IntArray) -> BoolArray:
        """Cells that are not on the plane: textured and unlike, or with rays through them. passing: how many keyframes
        look through each."""
        unlike = (self.texture >= _REFUTED_TEXTURE) & (self.views >= 3) & (self.score < _REFUTED_ZNCC)
        return np.asarray(unlike | (passing >= _CARVED_VOTES))


class KeyframeImages:
    """Undistorted image pyramids of the keyframes in the map, from about 320 px width down. Finer levels are never
    needed: at arm's length a cell's samples are about two pixels apart. Those not used for long are packed, without
    loss."""

    def __init__(self, camera: PinholeCamera) -> None:
        shrink = max(0, round(math.log2(camera.width / _STORE_WIDTH_PX)))
        factor = 0.5**shrink
        self._K = np.array(
            [camera.fx, camera.fy, (camera.cx + 0.5) - 0.5 / factor, (camera.cy + 0.5) - 0.5 / factor]
        ) * factor  # fmt: skip
        self._size = camera.width, camera.height
        self._maps = camera.undistortion()
        table, pixels = layout(camera.height >> shrink, camera.width >> shrink)
        self._table, self._store = table[:, :3].copy(), np.zeros((16, pixels), np.uint8)
        self._slot: dict[int, int] = {}  # of those in the store, the last used last
        self._packed: dict[int, bytes] = {}
        self._used = 0

    @property
    def ids(self) -> Set[int]:
        """Keyframes whose images are stored."""
        return self._slot.keys() | self._packed.keys()

    @property
    def nbytes(self) -> int:
        """Size of the part of the store that was ever used, and of what is packed [bytes]."""
        return self._store[: self._used].nbytes + array_bytes(self._packed.values())

    def views(self, snapshot: MapSnapshot, count: int) -> Views:
        """The first ``count`` living keyframes of a snapshot, and the newest of the culled ones before them. To be
        ``loaded`` before their images are read."""
        living, rays = snapshot.keyframe_ids[:count], snapshot.rays
        culled = np.setdiff1d(rays.ids, snapshot.keyframe_ids)
        stored = self.ids
        kept = [number for number in culled.tolist() if number in stored][-_CULLED_KEPT:]
        for gone in stored - {*snapshot.keyframe_ids.tolist(), *kept}:
            self._slot.pop(gone, None)
            self._packed.pop(gone, None)
        for k in [k for k, number in enumerate(living.tolist()) if number not in stored]:
            self._pack()  # a map from a file brings many at once
            self._slot[int(living[k])] = self._stored(cv2.remap(snapshot.images[k], *self._maps, cv2.INTER_LINEAR))
        self._pack()
        before = [number for number in kept if number < living.max(initial=-1)]
        ids = np.union1d(living, np.array(before, np.int64))
        T_world_cams = [rays.T_world_cams[k] for k in np.searchsorted(rays.ids, ids)]
        R, t = stacked([T.inverse() for T in T_world_cams])
        return Views(
            ids,
            R=R,
            t=t,
            centres=stacked(T_world_cams)[1],
            slots=np.array([self._slot.get(number, -1) for number in ids.tolist()], np.int64),
            store=self._store,
            table=self._table,
            K=self._K,
        )

    def loaded(self, views: Views) -> Views:
        """The same views with their images."""
        for number in views.ids.tolist():
            slot = self._slot.pop(number, None)
            self._slot[number] = self._unpacked(number) if slot is None else slot
        return views._replace(slots=np.array([self._slot[n] for n in views.ids.tolist()], np.int64), store=self._store)

    def _stored(self, image: GrayImage) -> int:
        """Where the store now has the levels of an undistorted image."""
        taken = set(self._slot.values())
        slot = next(n for n in range(len(taken) + 1) if n not in taken)
        self._used = max(self._used, slot + 1)
        self._store = grown(self._store, self._used)
        for offset, height, width in self._table.tolist():
            image = shrunk(image, image.shape[1] // width)
            self._store[slot, offset : offset + height * width] = image.ravel()
        return slot

    def _pack(self) -> None:
        """Leave only the images that were used last unpacked."""
        offset, height, width = self._table[0].tolist()
        for number in list(self._slot)[:-_UNPACKED]:
            image = self._store[self._slot.pop(number), offset : offset + height * width]
            self._packed[number] = bytes(cv2.imencode(".png", image.reshape(height, width))[1])

    def _unpacked(self, number: int) -> int:
        packed = np.frombuffer(self._packed.pop(number), np.uint8)
        return self._stored(np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8))


def judge(views: Views, frame: FloatArray, centres: Points3, config: DenseConfig, unit: float) -> Judgement:
    """Judge cells of a plane in the keyframes. frame (3, 3): its right, up and normal. centres (N, 3): world. unit:
    length of a metre in the map."""
    steep, least, most, apart = (
        math.cos(math.radians(angle))
        for angle in (config.max_incidence_deg, config.min_parallax_deg, config.max_parallax_deg, _APART_DEG)
    )
    enough = 1.0 - math.cos(math.radians(_ENOUGH_PARALLAX_DEG))
    limits = (config.min_range_m * unit, config.max_range_m * unit, steep, least, most, apart, enough)
    texture, score, rival, counts, reference = kernels.judge_cells(
        views, frame, centres, 0.5 * config.patch_m * unit, limits, (config.min_texture, _HOPELESS_ZNCC), _RIVAL_DEPTHS
    )
    ids = np.append(views.ids, -1)
    return Judgement(texture=texture, score=score, rival=rival, views=counts, keyframe=ids[reference].astype(np.int64))
