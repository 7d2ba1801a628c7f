"""The dock in a YAML beside a map: ``lab_dock.yaml`` beside ``lab.vsxmap`` or ``lab.yaml``, in its coordinates."""

import math
from pathlib import Path

import yaml

from vsx_ros.errors import MapFileError, explained
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.atomic import write_text
from vsx_ros.limits import FAR_M, file_text, yaml_tree

_VERSION = 1
_HEADER = "# Where the base stands when it charges, in the coordinates of the map beside this file.\n"
_TURN_RAD = 2.0 * math.pi


def dock_file(map_file: Path) -> Path:
    """Where the dock of a map is."""
    return map_file.with_name(f"{map_file.stem}_dock.yaml")


def save_dock(docked: SE2 | None, path: Path) -> None:
    """Write the file in one step. Without a dock, an earlier file is removed. Raises MapFileError."""
    with explained(MapFileError, f"dock {path} cannot be written", "choose another folder", OSError):
        if docked is None:
            path.unlink(missing_ok=True)
            return
        x, y, theta = (round(float(value), 4) for value in (docked.x, docked.y, docked.wrapped().theta))
        tree = {"version": _VERSION, "docked": {"x_m": x, "y_m": y, "heading_rad": theta}}
        text = _HEADER + yaml.safe_dump(tree, sort_keys=False, default_flow_style=None)
        write_text(path, text, durable=True)


def load_dock(path: Path) -> SE2 | None:
    """The pose of the charging base in a file; None if it does not exist. Raises MapFileError for one that cannot be
    used."""
    if not path.exists():
        return None
    with explained(MapFileError, f"dock {path} cannot be read", "correct it, or remove it to dock anew"):
        tree = yaml_tree(file_text(path))
        if not isinstance(tree, dict) or tree.get("version") != _VERSION or not isinstance(tree.get("docked"), dict):
            raise ValueError(f"it needs 'version: {_VERSION}' and a table 'docked'")
        values = [tree["docked"].get(name) for name in ("x_m", "y_m", "heading_rad")]
        if not all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
            raise ValueError("'docked' needs the numbers x_m, y_m and heading_rad")
        if not all(abs(value) <= most for value, most in zip(values, (FAR_M, FAR_M, _TURN_RAD))):  # none is NaN
            x, y, heading = (f"{value!r:.20}" for value in values)
            raise ValueError(f"({x}, {y}) m with the heading {heading} rad lies in no building")
        return SE2(*map(float, values))
