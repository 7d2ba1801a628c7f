"""world.yaml: reading, writing, and making a world out of a map_server map."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import yaml

from vsx_ros.arrays import BoolArray, GrayImage, Points2
from vsx_ros.errors import ConfigError, MapFileError
from vsx_ros.sim.world import Box, Outline, Poster, Table, Wall, World

TOLERANCE_M = 0.06


def save_world(world: World, path: Path) -> None:
    """Write world.yaml. Raises ConfigError when the file cannot be written."""
    text = yaml.safe_dump(msgspec.to_builtins(world), sort_keys=False, default_flow_style=None, width=120)
    try:
        path.write_text("# vsx_ros emulated world; metres, radians\n" + text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"world file {path} cannot be written: {error.strerror}") from error


def load_world(path: Path) -> World:
    """Read world.yaml. Raises ConfigError naming the entry that is wrong."""
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"world file {path} cannot be read: {error}") from error
    try:
        world = msgspec.convert(tree, World)
    except msgspec.ValidationError as error:
        raise ConfigError(
            f"world file {path}: {error}; 'vsx world lab --seed 0 --out FILE' writes a valid one"
        ) from error
    return checked(world, str(path))


def checked(world: World, name: str) -> World:
    """The world itself.

    Raises ConfigError when a part names an unknown material or holds an angle that is not finite.
    """
    edges: list[Outline | Wall] = [*world.outlines, *world.walls]
    things: list[Box | Table | Poster] = [*world.boxes, *world.tables, *world.posters]
    for outline in world.outlines:
        if len(outline.side_materials) != len(outline.points):
            raise ConfigError(
                f"world {name}: an outline of {len(outline.points)} sides names {len(outline.side_materials)} materials; "
                "write one material, or one per side"
            )
    used = {world.floor, world.ceiling} | {part.material for part in [*world.walls, *things, *world.cylinders]}
    used |= {material for outline in world.outlines for material in outline.side_materials}
    used |= {edge.skirting for edge in edges if edge.skirting is not None}
    missing = sorted(used - set(world.materials))
    if missing:
        raise ConfigError(f"world {name}: no material called {missing[0]!r}; add it under 'materials'")
    angles = [thing.yaw_rad for thing in things] + [world.start.theta_rad]
    if not all(math.isfinite(angle) for angle in angles):
        raise ConfigError(f"world {name}: an angle is not finite; write radians")
    return world


def read_map(path: Path) -> tuple[BoolArray, float, float, float]:
    """(free (H, W) with row 0 at the smallest y, resolution, origin_x, origin_y) of a map_server YAML file.

    Free by the file's own thresholds. Raises MapFileError for whatever cannot be used.
    """
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
        resolution = float(entries["resolution"])
        x, y, yaw = (float(v) for v in entries["origin"])
        free_threshold, negate = float(entries.get("free_thresh", 0.196)), int(entries.get("negate", 0))
        picture_path = path.parent / str(entries["image"])
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise MapFileError(f"map {path} is not a map_server YAML file (image, resolution, origin): {error}") from error
    picture: GrayImage | None = cv2.imread(str(picture_path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise MapFileError(f"map {path}: its image {picture_path} is missing or not a picture")
    if not (math.isfinite(resolution) and 0.001 <= resolution <= 1.0 and math.isfinite(x) and math.isfinite(y)):
        raise MapFileError(f"map {path}: resolution {resolution} m must lie in 0.001..1 and the origin be finite")
    if abs(yaw) > 1e-6:
        raise MapFileError(f"map {path}: origin yaw {yaw} rad; only unrotated maps can become a world")
    occupancy = picture / 255.0 if negate else 1.0 - picture / 255.0
    return np.flipud(occupancy < free_threshold), resolution, x, y


def free_space_outlines(free: BoolArray, resolution: float, origin_x: float, origin_y: float) -> list[Points2]:
    """Borders of the largest free region as closed polygons [m], free space to the left, simplified by 6 cm.

    Raises MapFileError when there is no free region of a square metre.
    """
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(free.astype(np.uint8), connectivity=4)
    areas = statistics[1:, cv2.CC_STAT_AREA] * resolution**2
    if count < 2 or float(areas.max()) < 1.0:
        raise MapFileError("the map has no free region of at least 1 m2; is 'negate' or 'free_thresh' wrong?")
    region = (labels == 1 + int(np.argmax(areas))).astype(np.uint8)
    contours, tree = cv2.findContours(region, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    outlines = []
    for contour, links in zip(contours, tree[0]):
        simple = cv2.approxPolyDP(contour, TOLERANCE_M / resolution, True).reshape(-1, 2).astype(float)
        if len(simple) < 3:
            continue
        points = (simple + 0.5) * resolution + np.array([origin_x, origin_y])
        x, y = points[:, 0], points[:, 1]
        signed = float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        is_hole = links[3] >= 0
        outlines.append(points[::-1] if (signed > 0) == is_hole else points)
    return outlines
