"""A map of the SLAM on disk, with all data needed to continue it (``.vsxmap``).

A zip file: manifest.json (format, camera, mount), keyframes/<index>.png or .jpg (grey images), arrays/<name>.npy
(``slam_map_arrays.LAYOUT``). Its last 64 bytes are the SHA-256 of all bytes before them."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros import __version__
from vsx_ros.arrays import GrayImage, IntArray, packed
from vsx_ros.errors import MapFileError, explained, reason_of
from vsx_ros.geometry.camera import PinholeCamera, Shutter, kernel_camera
from vsx_ros.geometry.lens import PLUMB_BOB
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.atomic import replacing
from vsx_ros.io.image_file import check_image_size, picture
from vsx_ros.io.sealed_archive import array_bytes, array_of, seal_into, unseal
from vsx_ros.io.slam_map_arrays import LAYOUT, Arrays, arrays_of, check, pixel_counts
from vsx_ros.limits import DAMAGE, DATA_BYTES, MIB, Allowance, file_bytes, json_tree
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.keyframe import FrameData, KeyFrame, MapView, Observations
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.templates import Templates
from vsx_ros.vision.corners import PackedCorners, indexed
from vsx_ros.vision.patch_search import moving
from vsx_ros.vision.pyramid import JPEG, CompressedPyramid, build_pyramid, picture_file, small_image

FORMAT, VERSION = "vsx_ros slam map", 3  # increased when an older vsx_ros cannot read the file
_PNG, _JPG = ".png", ".jpg"
_PIXELS, _PIXELS_PER_BYTE = 64 * MIB, {_PNG: 16, _JPG: 100}
"""With a camera's noise, a byte holds two to three pixels of a .png, six of a .jpg. A black .jpg holds up to 84."""


def save_slam_map(slam_map: SlamMap, path: Path) -> None:
    """Bring the file to the disk in one step; the SLAM may continue meanwhile. Raises MapFileError when that fails."""
    files = ((k.id, picture_file(k.data.image)) for k in slam_map.view.keyframes if k.alive)
    pictures = ((image_name(number, suffix_of(content)), content) for number, content in files)
    with (
        explained(MapFileError, f"map {path} cannot be written", "choose another folder", OSError),
        replacing(path, durable=True) as file,
    ):
        seal_into(file, chain(entries_of(slam_map, arrays_of(slam_map.view)), pictures))


def load_slam_map(path: Path) -> SlamMap:
    """The map of a file from ``save_slam_map``, bit for bit. Raises MapFileError when it is missing, damaged, of
    another kind or from a newer program."""
    with damage_explained(path):
        return slam_map_of(unseal(file_bytes(path, DATA_BYTES)))


def entries_of(slam_map: SlamMap, arrays: Arrays) -> Iterator[tuple[str, bytes]]:
    """The manifest of a map, and these arrays. arrays: all or some of ``arrays_of``."""
    mount = slam_map.T_base_cam
    camera = {name: getattr(slam_map.camera, name) for name in PinholeCamera.__slots__}
    manifest = {"format": FORMAT, "version": VERSION, "written_by": f"vsx_ros {__version__}", "camera": camera}
    T_base_cam = None if mount is None else mount.matrix().tolist()
    manifest |= {"T_base_cam": T_base_cam, "map_version": slam_map.view.version}
    yield "manifest.json", json.dumps(manifest, indent=1).encode()
    for name, array in arrays.items():
        yield array_name(name), array_bytes(array)


def slam_map_of(entries: Mapping[str, bytes]) -> SlamMap:
    """The map of entries: ``entries_of`` all arrays, and an image, ``image_name(index)``, of each keyframe that was not
    culled. Raises one of ``limits.DAMAGE`` for anything else."""
    manifest = _manifest(entries)
    camera, mount = _camera(manifest), _mount(manifest)
    arrays = {name: array_of(entries[array_name(name)]) for name in LAYOUT if name != "scale"}
    scale = entries.get(array_name("scale"))  # older files have none
    arrays["scale"] = np.ones(arrays["stamp_ns"].shape) if scale is None else array_of(scale)
    check(arrays, camera.width, camera.height)
    _check_pictures(entries, int((arrays["anchor"] < 0).sum()), camera)
    return SlamMap(camera, mount, _view(arrays, entries, camera, int(manifest["map_version"])))


@contextmanager
def damage_explained(path: Path) -> Iterator[None]:
    """Errors inside, while the map of a path is read, become a MapFileError."""
    try:
        yield
    except OSError as error:
        raise MapFileError(f"map {path} cannot be read ({error.strerror}); check the path") from error
    except DAMAGE as error:
        reason = f"entry {error} is missing" if isinstance(error, KeyError) else reason_of(error)
        raise MapFileError(f"map {path} cannot be used: {reason}; give a file that this program saved") from error


def _check_pictures(entries: Mapping[str, bytes], count: int, camera: PinholeCamera) -> None:
    """Raises ValueError if the files are too small for this many images with any content."""
    pictures = [content for name, content in entries.items() if name.endswith((_PNG, _JPG))]
    most = sum(_PIXELS_PER_BYTE[suffix_of(content)] * len(content) for content in pictures)
    Allowance(_PIXELS, most, 1).take(count * camera.width * camera.height, f"{count} pictures")


def _manifest(entries: Mapping[str, bytes]) -> dict[str, Any]:
    tree = json_tree(entries["manifest.json"])
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        raise ValueError("its manifest is not that of a SLAM map")
    version = tree.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise ValueError(
            f"it has format version {version}, vsx_ros {__version__} reads up to {VERSION}, update vsx_ros or"
            f" use the program that wrote it ({tree.get('written_by')})"
        )
    return tree


def _camera(manifest: Mapping[str, Any]) -> PinholeCamera:
    tree = manifest["camera"]
    return PinholeCamera(
        width=int(tree["width"]),
        height=int(tree["height"]),
        **{name: float(tree[name]) for name in ("fx", "fy", "cx", "cy")},
        distortion=tuple(float(k) for k in tree["distortion"]),
        model=str(tree.get("model", PLUMB_BOB)),
        shutter=None if tree.get("shutter") is None else Shutter(*(float(t) for t in tree["shutter"])),
    )


def _mount(manifest: Mapping[str, Any]) -> SE3 | None:
    if manifest["T_base_cam"] is None:
        return None
    T = np.array(manifest["T_base_cam"], float)
    rigid = T.shape == (4, 4) and np.isfinite(T).all() and np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)
    if not rigid:
        raise ValueError("T_base_cam in its manifest is no pose")
    return SE3.from_matrix(T)


def _view(arrays: Arrays, entries: Mapping[str, bytes], camera: PinholeCamera, version: int) -> MapView:
    parts = zip(_parts(arrays["observation_count"]), _parts(pixel_counts(arrays)))
    frames = tuple(_keyframe(k, *both, arrays, entries, camera) for k, both in enumerate(parts))
    living, depths = np.flatnonzero(arrays["anchor"] < 0), np.array([k.median_depth or 1.0 for k in frames])
    names = "point_templates", "template_source", "template_basis", "template_offset", "template_patch"
    return MapView(
        version=version,
        keyframes=frames,
        living=living,
        R_world_cam=arrays["rotation"],
        centres=arrays["translation"],
        depths=depths,
        points=arrays["point"],
        alive=arrays["point_alive"],
        source=arrays["point_source"],
        templates=Templates._make(arrays[name] for name in names),
    )


def _parts(counts: IntArray) -> Iterator[slice]:
    """The rows of each keyframe in an array with so many of each."""
    return (slice(*pair) for pair in pairwise([0, *np.cumsum(counts).tolist()]))


def _keyframe(
    k: int, part: slice, pixels: slice, arrays: Arrays, entries: Mapping[str, bytes], camera: PinholeCamera
) -> KeyFrame:
    """part, pixels: its observations, and those with pixels."""
    rows, level = (arrays[f"observation_{name}"][part].astype(np.int64) for name in ("row", "level"))
    observed = Observations(rows, arrays["observation_uv"][pixels], arrays["observation_ideal"][pixels], level)
    anchor = None
    if arrays["anchor"][k] >= 0:
        holder = int(arrays["anchor"][k])
        T = SE3(arrays["anchor_rotation"][k], arrays["anchor_translation"][k])
        anchor, observed = Anchor(holder, T, float(arrays["scale"][holder])), observed.without_pixels()
    T_world_cam = SE3(arrays["rotation"][k], arrays["translation"][k])
    depth, segment, map_id = float(arrays["median_depth"][k]), int(arrays["chain"][k]), int(arrays["map_id"][k])
    return KeyFrame(
        id=k,
        data=packed(_frame_data(k, arrays, entries, camera)),
        T_world_cam=T_world_cam,
        observations=packed(observed),
        median_depth=depth,
        odom_segment=segment,
        anchor=anchor,
        map_id=map_id,
        scale=float(arrays["scale"][k]),
    )


def _frame_data(k: int, arrays: Arrays, entries: Mapping[str, bytes], camera: PinholeCamera) -> FrameData:
    """All data that depends on the image alone is computed again. Corners also depend on earlier images, so they are
    stored."""
    stamp_ns = int(arrays["stamp_ns"][k])
    T_odom_base = SE2(*arrays["odometry"][k].tolist()) if arrays["has_odometry"][k] else None
    if arrays["anchor"][k] >= 0:
        return FrameData.without_image(stamp_ns, T_odom_base)
    content = entries.get(image_name(k, _JPG)) or entries[image_name(k)]
    pyramid = build_pyramid(_decoded(content, k, camera))
    counts = arrays["corner_count"]
    first = int(counts[:k].sum())
    ends = first + np.cumsum(counts[k])
    corners = indexed(np.split(arrays["corner"][first : ends[-1]], ends[:-1] - first), pyramid)
    own = moving(kernel_camera(camera), arrays["readout_motion"][k])
    return FrameData(
        stamp_ns=stamp_ns,
        image=CompressedPyramid(content),
        corners=PackedCorners.of(corners, pyramid.table),
        small=small_image(pyramid),
        T_odom_base=T_odom_base,
        camera=own,
    )


def array_name(name: str) -> str:
    """The entry of an array."""
    return f"arrays/{name}.npy"


def image_name(index: int, suffix: str = _PNG) -> str:
    """The entry of a keyframe's image."""
    return f"keyframes/{index:06d}{suffix}"


def suffix_of(content: bytes) -> str:
    """How the name of a picture file with this content ends."""
    return _JPG if content.startswith(JPEG) else _PNG


def _decoded(content: bytes, index: int, camera: PinholeCamera) -> GrayImage:
    size = f"{camera.width}x{camera.height}"
    try:
        fits = check_image_size(content) == (camera.width, camera.height)
        image: NDArray[Any] | None = picture(content, cv2.IMREAD_UNCHANGED) if fits else None
    except ValueError as error:
        raise ValueError(f"the image of keyframe {index} is no grey picture of {size}: {error}") from error
    if image is None or image.dtype != np.uint8 or image.shape != (camera.height, camera.width):
        raise ValueError(f"the image of keyframe {index} is no grey picture of {size}")
    return image
