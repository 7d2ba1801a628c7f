"""What a run needs to go on after it was killed: its map and what was counted, written every few seconds.

A folder: keyframes/<index>_<stamp>.png, each written once; map.zip, sealed, with all that changes. Whatever the moment
the program dies or the power goes, map.zip is the old or the new one, and the pictures it names are there, as are the
lines that the journals beside it (*.jsonl) held before.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from vsx_ros.errors import InputError
from vsx_ros.io.atomic import sync, write_bytes, write_text
from vsx_ros.io.sealed_archive import seal, unseal
from vsx_ros.io.slam_map_file import array_bytes, array_of, damage_explained, encoded, entries_of, image_name
from vsx_ros.io.slam_map_file import slam_map_of as slam_map_of_entries
from vsx_ros.slam.keyframe import KeyFrame
from vsx_ros.slam.slam_map import SlamMap

_STATE, _NOTES = "state/", "checkpoint.json"


class Saved(NamedTuple):
    """What a checkpoint holds. stamp_ns: when it was made. state: arrays of whoever wants to go on, by name; mission:
    what the mission remembers, as JSON has it."""

    slam_map: SlamMap
    stamp_ns: int
    state: dict[str, NDArray[Any]]
    mission: dict[str, Any]


class Checkpoint:
    """Writes and reads one folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def exists(self) -> bool:
        """Whether there is a map to go on in."""
        return (self.path / "map.zip").exists()

    def write(self, saved: Saved) -> None:
        """Replace the checkpoint in one step. Raises InputError when the folder cannot be written."""
        living = [k for k in saved.slam_map.view.keyframes if k.alive]
        entries = entries_of(saved.slam_map)
        entries |= {f"{_STATE}{name}.npy": array_bytes(array) for name, array in saved.state.items()}
        notes = {"stamp_ns": saved.stamp_ns, "mission": saved.mission, "files": {k.id: _file(k) for k in living}}
        entries[_NOTES] = json.dumps(notes).encode()
        try:
            (self.path / "keyframes").mkdir(parents=True, exist_ok=True)
            for path in (self.path.parent, *self.path.glob("*.jsonl")):
                sync(path)
            there = {path.name for path in (self.path / "keyframes").iterdir()}
            for keyframe in living:
                if _file(keyframe) not in there:
                    picture = self.path / "keyframes" / _file(keyframe)
                    write_bytes(picture, encoded(keyframe.data.pyramid.level(0)), durable=True)
            write_bytes(self.path / "map.zip", seal(entries, quick=True), durable=True)
            for name in there - {_file(k) for k in living}:
                (self.path / "keyframes" / name).unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"checkpoint {self.path} cannot be written ({error.strerror}); free the disk") from error

    def read(self) -> Saved:
        """The newest checkpoint. Raises MapFileError when there is none or it is damaged."""
        path = self.path / "map.zip"
        with damage_explained(path):
            entries = unseal(path.read_bytes())
            tree = json.loads(entries[_NOTES])
            for index, name in tree["files"].items():
                entries[image_name(int(index))] = (self.path / "keyframes" / Path(name).name).read_bytes()
            state = {
                name.removeprefix(_STATE).removesuffix(".npy"): array_of(content)
                for name, content in entries.items()
                if name.startswith(_STATE)
            }
            return Saved(slam_map_of_entries(entries), int(tree["stamp_ns"]), state, dict(tree["mission"]))

    def write_mission(self, memory: Mapping[str, Any]) -> None:
        """What a mission in a process of its own remembers, apart from the map, in one step.

        Raises InputError when it cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            write_text(self.path / "mission.json", json.dumps(dict(memory)), durable=True)
        except OSError as error:
            raise InputError(f"checkpoint {self.path} cannot be written ({error.strerror}); free the disk") from error

    def read_mission(self) -> dict[str, Any] | None:
        """What the mission of an interrupted run remembered; None without a map to use it in. Raises InputError when
        damaged."""
        path = self.path / "mission.json"
        if not (self.exists and path.exists()):
            return None
        try:
            tree = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{path} cannot be read ({error}); delete it, the mission then begins anew") from error
        return tree if isinstance(tree, dict) else {}


def _file(keyframe: KeyFrame) -> str:
    return f"{keyframe.id:06d}_{keyframe.data.stamp_ns}.png"
