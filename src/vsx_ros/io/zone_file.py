"""Zones in a YAML beside a map: ``lab_zones.yaml`` beside ``lab.vsxmap`` or ``lab.yaml``, in the map's coordinates."""

from collections.abc import Sequence
from pathlib import Path

import yaml

from vsx_ros.errors import InputError, MapFileError, explained
from vsx_ros.io.atomic import write_text
from vsx_ros.limits import file_text, with_end, yaml_tree
from vsx_ros.occupancy.zones import MAX_ZONES, Zone, zone_of

_VERSION = 1
_HEADER = "# Zones of the map beside this file; corners in its coordinates [m]; see 'vsx zone --help'.\n"
_AGAIN = "# Drawn again after the run.\n"


def zone_file(map_file: Path) -> Path:
    """Where the zones of a map are."""
    return map_file.with_name(f"{map_file.stem}_zones.yaml")


def save_zones(zones: Sequence[Zone], path: Path, *, again: bool = False) -> None:
    """Write the file in one step, without zones, too. again: with one comment more, so that it differs from a file with
    the same zones. Raises MapFileError."""
    with explained(MapFileError, f"zones {path} cannot be written", "choose another folder", OSError):
        tree = {"version": _VERSION, "zones": [zone.tree() for zone in zones]}
        text = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, allow_unicode=True)
        write_text(path, with_end(_HEADER + _AGAIN * again + text), durable=True)


def load_zones(path: Path) -> list[Zone]:
    """The zones of a file; none if it does not exist. Raises MapFileError for one that cannot be used."""
    if not path.exists():
        return []
    with explained(MapFileError, f"zones {path} cannot be read", "correct it, or remove it to drive without zones"):
        tree = yaml_tree(file_text(path))
        if not isinstance(tree, dict) or tree.get("version") != _VERSION or not isinstance(tree.get("zones"), list):
            raise ValueError(f"it needs 'version: {_VERSION}' and a list 'zones'")
        if len(tree["zones"]) > MAX_ZONES:
            raise ValueError(f"it has {len(tree['zones'])} zones, at most {MAX_ZONES} are kept")
    try:
        zones = [zone_of(entry) for entry in tree["zones"]]
    except InputError as error:
        raise MapFileError(f"zones {path}: {error}") from error
    names = [zone.name for zone in zones]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise MapFileError(f"zones {path}: two zones have the name {twice[0]!r}; rename one")
    return zones
