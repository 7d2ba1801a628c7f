"""Maps in map_server's format: an image and a YAML beside it, which every ROS navigation stack can load."""

from codecs import BOM_UTF8
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from vsx_ros.errors import MapFileError, explained, reason_of
from vsx_ros.io.atomic import write_together
from vsx_ros.io.image_file import picture
from vsx_ros.limits import DAMAGE, LOG_BYTES, TEXT_BYTES, file_bytes, file_text, yaml_tree
from vsx_ros.occupancy.grid import FREE, MAX_CELLS, MAX_EXTENT_M, OCCUPIED, UNKNOWN, OccupancyGrid

_GRAY_OF_FREE, _GRAY_OF_OCCUPIED, _GRAY_OF_UNKNOWN = 254, 0, 205  # as map_server's map_saver writes them
_DARKEST_FREE = 206
_OCCUPIED_THRESHOLD, _FREE_THRESHOLD = 0.65, 0.196  # map_saver's, too
_USUAL_THRESHOLDS = _FREE_THRESHOLD, _OCCUPIED_THRESHOLD
_FINEST_M = 1e-3  # per cell; finer is a wrong unit
_STRAIGHT_RAD = 1e-6  # an angle that programs leave by rounding
_DIGITS = 9  # of the origin [m]: it is counted in cells, which leaves errors of rounding
_ROWS_AT_ONCE = 64  # to save memory
_LONGEST_NAME = 1000  # of a file; longer is invalid


def save_map(grid: OccupancyGrid, path: Path) -> None:
    """Write ``path`` with the endings .pgm and .yaml, as map_server's map_saver does; free cells are the darker the
    more probable an obstacle is, but always free by the thresholds. Raises MapFileError for another
    ending, and when they cannot be written."""
    if path.suffix not in ("", ".pgm", ".yaml", ".yml"):
        raise MapFileError(f"map {path} would be written to other files' names; let its name end in .pgm or .yaml")
    doubt = np.zeros(grid.shape) if grid.probability is None else np.nan_to_num(grid.probability)
    free = np.clip(np.rint(255.0 * (1.0 - doubt)), _DARKEST_FREE, _GRAY_OF_FREE)
    rows, columns = grid.shape
    image, text = path.with_suffix(".pgm"), path.with_suffix(".yaml")
    origin = [round(grid.origin_x, _DIGITS), round(grid.origin_y, _DIGITS), 0.0]
    tree = {"image": image.name, "resolution": grid.resolution, "origin": origin, "negate": 0}
    tree |= {"occupied_thresh": _OCCUPIED_THRESHOLD, "free_thresh": _FREE_THRESHOLD}
    with explained(MapFileError, f"map {path} cannot be written", "choose another folder", OSError):
        picture_of = f"P5\n{columns} {rows}\n255\n".encode() + _gray(grid, free).tobytes()
        yaml_of = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None)
        write_together({image: picture_of, text: yaml_of.encode()})


def map_png(grid: OccupancyGrid) -> bytes:
    """The grid as a small PNG, north up: free, occupied and unknown in map_server's greys."""
    return bytes(cv2.imencode(".png", _gray(grid, np.full(grid.shape, _GRAY_OF_FREE)))[1])


def map_of_png(content: bytes, name: str, resolution: float, origin: tuple[float, float]) -> OccupancyGrid:
    """The grid of ``map_png``. name: for messages. origin: its lower left corner [m]. Raises MapFileError when it is
    not such a picture."""
    with explained(MapFileError, f"{name} is no map", "delete the file"):
        image = picture(content, cv2.IMREAD_UNCHANGED, MAX_CELLS)
    cells = _cells(image, name, _USUAL_THRESHOLDS, negate=False, raw=False)
    return OccupancyGrid(cells[::-1], resolution, origin[0], origin[1])


def load_map(path: Path) -> OccupancyGrid:
    """The grid of a map YAML (or of an image with its YAML beside it). Values between free and occupied are unknown.
    PGM and PNG of 8 or 16 bits, grey or colour; fully transparent pixels are unknown. Raises MapFileError with the
    missing or wrong entry."""
    text = path if path.suffix in (".yaml", ".yml") else path.with_suffix(".yaml")
    if text != path and not text.exists():
        raise MapFileError(f"{path} is no map_server YAML, and there is no {text.name} beside it; give a map.yaml")
    with explained(MapFileError, f"map {text} cannot be read", "give a map_server YAML"):
        tree = yaml_tree(file_text(text))
    try:
        resolution = float(tree["resolution"])
        x, y, yaw = (float(value) for value in tree["origin"])
        thresholds = float(tree["free_thresh"]), float(tree["occupied_thresh"])
        negate, name = bool(int(tree.get("negate", 0))), str(tree["image"])
        raw = str(tree.get("mode", "trinary")) == "raw"
        if len(name) > _LONGEST_NAME:
            raise ValueError(f"image of {len(name)} characters")
    except DAMAGE as error:
        raise MapFileError(
            f"map {text}: entry {reason_of(error)} is missing or malformed; map_server needs image, resolution, "
            "origin [x, y, yaw], negate, occupied_thresh, free_thresh"
        ) from error
    if not abs(yaw) < _STRAIGHT_RAD:
        raise MapFileError(f"map {text} is turned by {yaw} rad, only 0 is supported; turn the image instead")
    if not (
        _FINEST_M <= resolution < 10
        and all(abs(metres) < MAX_EXTENT_M for metres in (x, y))
        and 0 <= thresholds[0] <= thresholds[1] <= 1
    ):
        raise MapFileError(
            f"map {text}: resolution {resolution}, origin {x}, {y} or thresholds {thresholds} are impossible; "
            "correct it"
        )
    cells = _cells(*_picture_of(text.parent / name), thresholds, negate=negate, raw=raw)
    return OccupancyGrid(cells[::-1], resolution, x, y)


def is_map_file(path: Path) -> bool:
    """Whether a YAML belongs to a map. Raises MapFileError when it cannot be read."""
    with explained(MapFileError, f"map {path} cannot be read", "give a map_server YAML"):
        lines = file_bytes(path, TEXT_BYTES).removeprefix(BOM_UTF8).splitlines()
        return any(line.startswith(b"image:") for line in lines)


def map_image(text: Path) -> Path:
    """The picture that a map's YAML names. Raises MapFileError when it cannot be read or names none."""
    with explained(MapFileError, f"map {text} cannot be read", "give a map_server YAML", DAMAGE):
        return text.parent / str(yaml_tree(file_text(text))["image"])


def load_plan(path: Path) -> OccupancyGrid:
    """The grid of an image without a YAML, 5 cm per pixel: bright is free, dark occupied, grey unknown, as map_saver
    draws them. Raises MapFileError when it is not an image."""
    return OccupancyGrid(_cells(*_picture_of(path), _USUAL_THRESHOLDS, negate=False, raw=False)[::-1], 0.05, 0.0, 0.0)


def _gray(grid: OccupancyGrid, free: NDArray[Any]) -> NDArray[np.uint8]:
    """(H, W), top row first. free: (H, W) grey of the free cells."""
    known = [free, np.full(grid.shape, _GRAY_OF_OCCUPIED)]
    gray = np.select([grid.data == FREE, grid.data == OCCUPIED], known, _GRAY_OF_UNKNOWN)
    return np.ascontiguousarray(gray[::-1], np.uint8)


def _picture_of(path: Path) -> tuple[NDArray[Any] | None, str]:
    """The picture of a file, None if damaged, and its name for messages."""
    name = f"map image {path}"
    with explained(MapFileError, f"{name} is missing or no map", "give a PGM or PNG"):
        return picture(file_bytes(path, LOG_BYTES), cv2.IMREAD_UNCHANGED, MAX_CELLS), name


def _cells(
    image: NDArray[Any] | None, name: str, thresholds: tuple[float, float], *, negate: bool, raw: bool
) -> NDArray[np.int8]:
    """(H, W) cells, top row first. Works on bands of rows: the probabilities need many times the image's memory."""
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise MapFileError(f"{name} is no 8 or 16 bit picture; give a PGM or PNG")
    cells = np.full(image.shape[:2], UNKNOWN, np.int8)
    for top in range(0, len(cells), _ROWS_AT_ONCE):
        band = slice(top, top + _ROWS_AT_ONCE)
        occupancy = _occupancy(image[band], negate=negate, raw=raw)
        cells[band][occupancy < thresholds[0]] = FREE
        cells[band][occupancy > thresholds[1]] = OCCUPIED
    return cells


def _occupancy(image: NDArray[Any], *, negate: bool, raw: bool) -> NDArray[np.float64]:
    """(H, W) probability of an obstacle, NaN where unknown."""
    depth = float(np.iinfo(image.dtype).max)
    channels = image.reshape(*image.shape[:2], -1).astype(np.float64)
    colours = channels[..., : 1 if channels.shape[2] < 3 else 3].mean(axis=2)
    occupancy: NDArray[np.float64] = colours / depth if negate else 1.0 - colours / depth
    if raw:
        occupancy = np.where(colours <= 100, colours / 100.0, np.nan)
    if channels.shape[2] in (2, 4):
        occupancy[channels[..., -1] == 0] = np.nan
    return occupancy
