"""Exports a map: points as binary PLY, which MeshLab, CloudCompare and Blender read; the whole map as COLMAP's text
model (cameras.txt, images.txt, points3D.txt) with its images, for photogrammetry tools.

Source: COLMAP documentation, "Output Format". There, poses are T_cam_world with quaternions (w, x, y, z), and the
centre of the top-left pixel is (0.5, 0.5)."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, Points3
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.lens import EQUIDISTANT
from vsx_ros.io.atomic import write_bytes, write_text, write_together
from vsx_ros.limits import DATA_BYTES, file_bytes
from vsx_ros.slam.snapshot import MapSnapshot

_HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{properties}end_header\n"
_PLACE = "".join(f"property float {axis}\n" for axis in "xyz")
_COLOURED = _PLACE + "".join(f"property uchar {colour}\n" for colour in ("red", "green", "blue"))
_VERTEX = np.dtype([("at", "<f4", 3), ("colour", "u1", 3)])


def write_ply(path: Path, points: Points3, grey: NDArray[np.uint8] | None = None) -> None:
    """Write (N, 3) points as 32-bit floats, coloured by their grey values (N,) if given."""
    places = np.asarray(points, np.float64).reshape(-1, 3).astype("<f4")
    header = _HEADER.format(count=len(places), properties=_PLACE if grey is None else _COLOURED)
    vertices = np.zeros(len(places), _VERTEX)
    vertices["at"] = places
    if grey is not None:
        vertices["colour"] = grey[:, None]
    write_bytes(path, header.encode("ascii") + (places if grey is None else vertices).tobytes())


def read_ply(path: Path) -> Points3:
    """The (N, 3) points, without colours, of a file from ``write_ply``. Raises InputError for anything else."""
    with explained(InputError, f"point cloud {path} cannot be read", "check the path"):
        header, _, body = file_bytes(path, DATA_BYTES).partition(b"end_header\n")
    wrong = f"point cloud {path} is not a PLY that this program wrote"
    with explained(InputError, wrong, "give one that it wrote", (IndexError, ValueError)):
        count = int(header.split(b"element vertex")[1].split()[0])
        known = {
            _HEADER.format(count=count, properties=p).encode(): size for p, size in ((_PLACE, 12), (_COLOURED, 15))
        }
        size = known.get(header + b"end_header\n")
        if size is None:
            raise ValueError("other properties")
        if len(body) != size * count:
            raise ValueError(f"{len(body)} bytes are not {count} points")
        places = np.frombuffer(body, _VERTEX)["at"] if size == _VERTEX.itemsize else np.frombuffer(body, "<f4")
        return places.reshape(-1, 3).astype(np.float64)


def write_planes(path: Path, facts: Mapping[str, Any]) -> None:
    """Write planes as JSON. facts: from ``FinishedMap.facts``."""
    write_text(path, json.dumps(facts, indent=1, allow_nan=False) + "\n")


_CORNER_PX = 0.5  # the first pixel's corner is COLMAP's origin, its centre is ours
_CAMERA = 1  # COLMAP's number of the only camera
_GREY = "128 128 128"


def write_colmap(folder: Path, camera: PinholeCamera, snapshot: MapSnapshot) -> None:
    """Create and fill the folder. Points are numbered by their ids, images by keyframe id + 1. images.txt, which names
    the rest, is there once all is. Raises InputError when it cannot be written."""
    with explained(InputError, f"folder {folder} cannot be written", "choose another one", OSError):
        (folder / "images").mkdir(parents=True, exist_ok=True)
        (folder / "images.txt").unlink(missing_ok=True)
        for number, image in zip(snapshot.keyframe_ids.tolist(), snapshot.images, strict=True):
            write_bytes(folder / "images" / f"{number:06d}.png", bytes(cv2.imencode(".png", image)[1]))
        lines = {"cameras": [_camera_text(camera)], "points3D": _point_lines(camera, snapshot)}
        lines["images"] = _image_lines(snapshot)
        write_together({folder / f"{name}.txt": "".join(each).encode() for name, each in lines.items()})


def _camera_text(camera: PinholeCamera) -> str:
    """OPENCV has four coefficients, FULL_OPENCV eight, of which the last three divide."""
    model, lens = "OPENCV_FISHEYE", [*camera.distortion]
    if camera.model != EQUIDISTANT:
        model = "FULL_OPENCV" if any(camera.distortion[4:]) else "OPENCV"
        lens = [*camera.distortion, 0.0, 0.0, 0.0][: 8 if model == "FULL_OPENCV" else 4]
    numbers = [camera.fx, camera.fy, camera.cx + _CORNER_PX, camera.cy + _CORNER_PX, *lens]
    text = " ".join(f"{number:.12g}" for number in numbers)
    return f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n{_CAMERA} {model} {camera.width} {camera.height} {text}\n"


def _image_lines(snapshot: MapSnapshot) -> Iterator[str]:
    """Two lines per image: its pose, and its observations of points."""
    yield "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then X Y POINT3D_ID of each observation\n"
    number_of = np.where(_shown(snapshot), snapshot.point_ids, -1)
    for k, (number, T_world_cam) in enumerate(zip(snapshot.keyframe_ids.tolist(), snapshot.T_world_cams, strict=True)):
        T_cam_world = T_world_cam.inverse()
        x, y, z, w = T_cam_world.quaternion()
        pose = " ".join(f"{value:.12g}" for value in (w, x, y, z, *T_cam_world.translation))
        seen = snapshot.obs_keyframe == k
        ids, uv = number_of[snapshot.obs_point[seen]], snapshot.obs_uv[seen] + _CORNER_PX
        observed = " ".join(f"{u:.4f} {v:.4f} {point}" for (u, v), point in zip(uv, ids.tolist(), strict=True))
        yield f"{number + 1} {pose} {_CAMERA} {number:06d}.png\n{observed}\n"


def _point_lines(camera: PinholeCamera, snapshot: MapSnapshot) -> Iterator[str]:
    """One line per point: position, colour, mean reprojection error [px], and its observations."""
    yield "# POINT3D_ID X Y Z R G B ERROR, then IMAGE_ID POINT2D_IDX of each observation\n"
    count = np.bincount(snapshot.obs_keyframe, minlength=len(snapshot.keyframe_ids))
    place = np.arange(len(snapshot.obs_keyframe)) - np.repeat(np.cumsum(count) - count, count)
    error_px = _errors_px(camera, snapshot)
    order = np.argsort(snapshot.obs_point, kind="stable")
    ends = np.searchsorted(snapshot.obs_point[order], np.arange(len(snapshot.point_ids) + 1))
    for p in np.flatnonzero(_shown(snapshot)).tolist():
        number, mine = snapshot.point_ids[p], order[ends[p] : ends[p + 1]]
        images = snapshot.keyframe_ids[snapshot.obs_keyframe[mine]] + 1
        track = " ".join(f"{i} {j}" for i, j in zip(images.tolist(), place[mine].tolist(), strict=True))
        x, y, z = snapshot.points_world[p]
        yield f"{number} {x:.9g} {y:.9g} {z:.9g} {_GREY} {float(error_px[mine].mean()):.4f} {track}\n"


def _shown(snapshot: MapSnapshot) -> BoolArray:
    """(M,) whether a point is seen in two images at least: culled keyframes have none."""
    return np.asarray(np.bincount(snapshot.obs_point, minlength=len(snapshot.point_ids)) >= 2)


def _errors_px(camera: PinholeCamera, snapshot: MapSnapshot) -> FloatArray:
    """(O,) distance of each observation from its point's projection."""
    error_px = np.zeros(len(snapshot.obs_keyframe))
    for k, T_world_cam in enumerate(snapshot.T_world_cams):
        seen = snapshot.obs_keyframe == k
        points_cam = T_world_cam.inverse() @ snapshot.points_world[snapshot.obs_point[seen]]
        error_px[seen] = np.linalg.norm(camera.project(points_cam) - snapshot.obs_uv[seen], axis=1)
    return error_px
