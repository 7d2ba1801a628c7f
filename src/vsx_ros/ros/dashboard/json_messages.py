"""Messages as the little JSON that the page draws. Pure functions; what cannot be used raises InputError."""

import base64
import json
import math
import re
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.errors import InputError
from vsx_ros.limits import json_tree
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN
from vsx_ros.ros import convert, frames, topics

_FREE_BGRA, _OCCUPIED_BGRA = (92, 70, 52, 255), (236, 232, 228, 255)
_UTILITY = re.compile(r"\bU ([0-9.]+)")
_PLAN_POINTS = 200


def text(value: Any) -> str:
    """One line of JSON. Raises InputError for a number that JSON cannot say."""
    try:
        return json.dumps(value, allow_nan=False, separators=(",", ":"))
    except ValueError as error:
        raise InputError(f"message with a number that is not finite: {error}") from error


def parsed(msg: String) -> dict[str, Any]:
    """The object in a String of JSON. Raises InputError for anything else."""
    try:
        value = json_tree(msg.data)
    except ValueError as error:
        raise InputError(f"{msg.data[:80]!r} is not JSON: {error}") from error
    if not isinstance(value, dict):
        raise InputError(f"{msg.data[:80]!r} is not a JSON object")
    return value


def pose(msg: PoseWithCovarianceStamped) -> list[float]:
    """x, y [m], heading [rad]."""
    found = convert.se2(msg.pose.pose)
    return [round(found.x, 3), round(found.y, 3), round(found.theta, 3)]


def grid(msg: OccupancyGridMsg) -> dict[str, Any]:
    """A PNG of what is known, top row first, unknown transparent; resolution and lower left corner [m], area [m2]."""
    found = convert.grid(msg)
    rows, columns = (np.flatnonzero((found.data != UNKNOWN).any(axis=axis)) for axis in (1, 0))
    bottom, left = (int(rows[0]), int(columns[0])) if rows.size else (0, 0)
    cells = found.data[bottom : rows[-1] + 1, left : columns[-1] + 1] if rows.size else found.data[:1, :1]
    picture = np.zeros((*cells.shape, 4), np.uint8)
    picture[cells == FREE] = _FREE_BGRA
    picture[cells == OCCUPIED] = _OCCUPIED_BGRA
    _, png = cv2.imencode(".png", np.ascontiguousarray(picture[::-1]), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return {
        "png": base64.b64encode(png.tobytes()).decode(),
        "resolution": found.resolution,
        "x": found.origin_x + left * found.resolution,
        "y": found.origin_y + bottom * found.resolution,
        "known_m2": found.known_area_m2,
    }


def frontiers(msg: MarkerArray) -> dict[str, Any]:
    """borders: x, y [m] of each frontier's cells. views: x, y, U and the words of each ranked view, best first."""
    borders, views = [], []
    for marker in msg.markers:
        if marker.action == Marker.ADD and marker.type == Marker.POINTS:
            borders.append([[round(p.x, 2), round(p.y, 2)] for p in marker.points])
        elif marker.action == Marker.ADD and marker.type == Marker.TEXT_VIEW_FACING:
            where, found = marker.pose.position, _UTILITY.search(marker.text)
            utility = float(found.group(1)) if found else None
            views.append({"x": where.x, "y": where.y, "utility": utility, "text": marker.text})
    return {"borders": borders, "views": views}


def keyframes(msg: PoseArray) -> list[list[float]]:
    """x, y [m] of each camera and where it looks on the floor [rad]."""
    found = []
    for camera in msg.poses:
        p, q = camera.position, camera.orientation
        looks = math.atan2(q.y * q.z - q.x * q.w, q.x * q.z + q.y * q.w)
        found.append([round(p.x, 2), round(p.y, 2), round(looks, 2)])
    return found


def plan(msg: PathMsg) -> list[list[float]]:
    """x, y [m] of the path, thinned; empty for one that is not in the map's frame (driven by odometry alone)."""
    if frames.bare(msg.header.frame_id) != topics.MAP_FRAME:
        return []
    step = max(1, len(msg.poses) // _PLAN_POINTS)
    kept = [*msg.poses[::step], *msg.poses[-1:]]
    return [[round(p.pose.position.x, 3), round(p.pose.position.y, 3)] for p in kept]
