"""Where the robot may go, as its user says: no-go zones, virtual walls, zones to stay in, zones to drive slowly in.

The zones of a session are tied to keyframes and move with the map."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import IntArray, Points2
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.limits import FAR_M, json_tree
from vsx_ros.occupancy.anchored_poses import AnchoredPoses

MAX_ZONES, MAX_CORNERS, MAX_NAME = 100, 200, 40  # a drawing by hand has a few dozen corners
OUTSIDE = "only here"  # what the ground outside all zones of the kind ONLY is called
_LEAST_M2 = 0.01  # a smaller zone is a slip of the hand
_SLOW_M_S = (0.03, 0.7)  # what the bases can drive
_RIM = np.array([(math.cos(0.25 * k), math.sin(0.25 * k)) for k in range(26)] + [(0.0, 0.0)])  # and middle of a body
_ROUNDING_M = 1e-3  # so that two polygons with a common edge have no gap
_EVERY = -1.0  # spacing of anchored corners [m]: no corner is left out


class ZoneKind(Enum):
    """What a zone means."""

    NO_GO = "no-go"
    WALL = "wall"
    ONLY = "only"
    SLOW = "slow"
    LOOK = "look"


class Zone(NamedTuple):
    """points: corners of a polygon, or of a line (WALL), in the map [m]. v_m_s: of SLOW, else None. ONLY: the body
    stays inside. LOOK: unknown ground outside is not worth a drive. Several zones of these two kinds add up."""

    name: str
    kind: ZoneKind
    points: tuple[tuple[float, float], ...]
    v_m_s: float | None = None

    def tree(self) -> dict[str, Any]:
        """As a tree for a file or message; ``zone_of`` reads it back."""
        slow = {} if self.v_m_s is None else {"v_m_s": self.v_m_s}
        return {"name": self.name, "kind": self.kind.value, **slow, "points": [list(point) for point in self.points]}

    def words(self) -> str:
        """Name and meaning."""
        return f"{self.name} ({self.kind.value}{'' if self.v_m_s is None else f', at most {self.v_m_s:g} m/s'})"


def zone_of(tree: Any) -> Zone:
    """The zone of a tree. Raises InputError for anything else."""
    if not isinstance(tree, Mapping):
        raise InputError(f"a zone is a table with name, kind and points, not {tree!r:.60}")
    unknown = sorted(str(key) for key in tree.keys() - {"name", "kind", "points", "v_m_s"})
    if unknown:
        raise InputError(f"a zone has name, kind, points and v_m_s (slow zones), not {unknown[0]!r:.60}")
    name, kinds = tree.get("name"), {kind.value: kind for kind in ZoneKind}
    if not isinstance(name, str) or not name.strip() or len(name) > MAX_NAME or not name.isprintable():
        raise InputError(f"a zone's name is a word or a few, at most {MAX_NAME} characters, not {name!r:.60}")
    kind = tree.get("kind")
    if not isinstance(kind, str) or kind not in kinds:
        raise InputError(f"zone {name!r}: its kind is one of {', '.join(kinds)}, not {kind!r:.60}")
    return _checked(Zone(name, kinds[kind], _points(name, tree.get("points")), _number(name, tree.get("v_m_s"))))


def _points(name: str, given: Any) -> tuple[tuple[float, float], ...]:
    try:
        points = tuple((float(x), float(y)) for x, y in given[: MAX_CORNERS + 1])
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"zone {name!r}: its points are pairs of x and y [m], not {given!r:.60}") from error
    if len(points) > MAX_CORNERS:
        raise InputError(f"zone {name!r} has more than {MAX_CORNERS} corners; draw it simpler")
    for x, y in points:
        if not (abs(x) < FAR_M and abs(y) < FAR_M):
            raise InputError(f"zone {name!r}: its corner ({x:g}, {y:g}) m lies in no building; give metres in the map")
    return points


def _number(name: str, given: Any) -> float | None:
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, (int, float)):
        raise InputError(f"zone {name!r}: its speed v_m_s is a number [m/s], not {given!r:.60}")
    try:
        return float(given)
    except OverflowError:
        raise InputError(f"zone {name!r}: its speed v_m_s is no number of metres per second") from None


def _checked(zone: Zone) -> Zone:
    """The zone. Raises InputError when it makes no sense."""
    least, example = (2, "1,2 3,2") if zone.kind is ZoneKind.WALL else (3, "1,2 3,2 3,4")
    if (given := len(zone.points)) < least:
        has = f"zone {zone.name!r} has {given} corner{'' if given == 1 else 's'}"
        raise InputError(f"{has}; the kind {zone.kind.value} needs at least {least}, e.g. '{example}' in metres")
    corners = np.array(zone.points)
    if zone.kind is ZoneKind.WALL:
        if float(np.hypot(*np.diff(corners, axis=0).T).sum()) < math.sqrt(_LEAST_M2):
            raise InputError(f"zone {zone.name!r}: a wall shorter than 10 cm holds nobody back; draw it longer")
    elif abs(cv2.contourArea((corners - corners[0]).astype(np.float32))) < _LEAST_M2:
        raise InputError(f"zone {zone.name!r} has an area below {_LEAST_M2:g} m2; draw it larger")
    if (zone.kind is ZoneKind.SLOW) != (zone.v_m_s is not None):
        raise InputError(f"zone {zone.name!r}: a speed v_m_s belongs to zones of the kind slow, and to no other")
    if zone.v_m_s is not None and not _SLOW_M_S[0] <= zone.v_m_s <= _SLOW_M_S[1]:
        low, high = _SLOW_M_S
        raise InputError(f"zone {zone.name!r}: its speed is {zone.v_m_s:g} m/s; give one from {low:g} to {high:g}")
    return zone


def closings(zones: Sequence[Zone]) -> list[tuple[Zone, ...]]:
    """What closes ground: each zone of the kinds NO_GO and WALL, and those of the kind ONLY together."""
    allowed = tuple(zone for zone in zones if zone.kind is ZoneKind.ONLY)
    return [(zone,) for zone in zones if zone.kind in (ZoneKind.NO_GO, ZoneKind.WALL)] + [allowed] * bool(allowed)


def outside_of(allowed: Sequence[Zone], x: float, y: float, radius_m: float) -> Points2:
    """(N, 2) places [m] on the rim, and in the middle, of a round body at x, y [m] that lie in none of the polygons."""
    rim = np.array([x, y]) + radius_m * _RIM
    inside = [any(depth_m(zone, *place) > -_ROUNDING_M for zone in allowed) for place in rim.tolist()]
    return rim[np.logical_not(inside)]


def depth_m(zone: Zone, x: float, y: float) -> float:
    """How far a place lies inside a polygon [m]; outside, and beside a line, negative."""
    line = zone.kind is ZoneKind.WALL
    corners = np.array([*zone.points, *zone.points[-2:0:-1]] if line else zone.points) - [x, y]
    inside_m = float(cv2.pointPolygonTest(corners.astype(np.float32), (0.0, 0.0), True))
    return -abs(inside_m) if line else inside_m


class AnchoredZones:
    """The zones of one session. Each corner is tied to the keyframe nearest to it. version: counts the user's changes.
    Not thread-safe."""

    def __init__(self) -> None:
        self.version = 0
        self._zones: list[tuple[Zone, AnchoredPoses]] = []

    def __len__(self) -> int:
        return len(self._zones)

    def add(self, zone: Zone) -> None:
        """Add a zone in the map of the last ``zones``; it replaces one of the same name. Raises InputError for one too
        many."""
        others = [pair for pair in self._zones if pair[0].name != zone.name]
        if len(others) >= MAX_ZONES:
            raise InputError(f"zone {zone.name!r}: there are {MAX_ZONES} zones already; remove one first")
        corners = AnchoredPoses(_EVERY)
        for x, y in zone.points:
            corners.add(SE2(x, y, 0.0))
        self._zones = [*others, (zone, corners)]
        self.version += 1

    def remove(self, name: str) -> None:
        """Raises InputError when there is no zone of this name."""
        left = [pair for pair in self._zones if pair[0].name != name]
        if len(left) == len(self._zones):
            there = ", ".join(repr(zone.name) for zone, _ in self._zones) or "none"
            raise InputError(f"there is no zone {name!r:.60}; the zones are: {there}")
        self._zones = left
        self.version += 1

    def replace(self, zones: Sequence[Zone], kept: Callable[[Zone], bool]) -> None:
        """Have these zones instead of all others but those to be kept. Raises InputError for one too many."""
        self._zones = [pair for pair in self._zones if kept(pair[0])]
        self.version += 1
        for zone in zones:
            self.add(zone)

    def clear(self) -> None:
        """Remove all zones."""
        self._zones, self.version = [], self.version + 1

    def zones(self, keyframe_ids: IntArray, T_world_cams: Sequence[SE3]) -> tuple[Zone, ...]:
        """The zones in a map of these keyframes (K,), ids ascending."""
        moved = []
        for zone, corners in self._zones:
            poses = corners.poses(keyframe_ids, T_world_cams)
            moved.append(zone._replace(points=tuple((pose.x, pose.y) for pose in poses)))
        return tuple(moved)

    def state(self) -> dict[str, NDArray[Any]]:
        """For ``restore``: corners (N, 8) as of ``AnchoredPoses.state``, and what the zones are, as JSON (uint8)."""
        corners = [corners.state() for _, corners in self._zones]
        told = json.dumps([zone.tree() for zone, _ in self._zones]).encode()
        rows = np.vstack(corners) if corners else np.zeros((0, 8))
        return {"zone_corners": rows, "zones": np.frombuffer(told, np.uint8)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a ``state``; sessions of older versions had no zones. Raises InputError for anything else."""
        if "zones" not in state:
            return
        try:
            trees = json_tree(np.asarray(state["zones"], np.uint8).tobytes())
            rows, first, restored = np.asarray(state["zone_corners"], float), 0, []
            for zone in [zone_of(tree) for tree in trees]:
                corners = AnchoredPoses(_EVERY)
                corners.restore(rows[first : first + len(zone.points)])
                first += len(zone.points)
                restored.append((zone, corners))
            if first != len(rows):
                raise ValueError(f"{len(rows)} corners for zones of {first}")
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the zones to go on with are damaged ({error}); start a new run") from error
        self._zones, self.version = restored, self.version + 1
