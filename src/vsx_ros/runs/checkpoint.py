"""The state with which a killed run can be resumed: its map and counters, written every few seconds.

A folder: keyframes/<index>_<stamp>.png or .jpg and pieces/<hash>.npy (corners and point patches), each written once;
map.zip, sealed, with everything that changes. Even if the program or the power fails, map.zip is either the old or the
new one. The files it names exist, and so do the earlier lines of the journals beside it (*.jsonl)."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.errors import InputError, explained
from vsx_ros.io.atomic import sync, write_bytes, write_text
from vsx_ros.io.sealed_archive import ArrayChunks, array_bytes, array_of, glance, seal, unseal
from vsx_ros.io.slam_map_arrays import Arrays, arrays_of
from vsx_ros.io.slam_map_file import array_name, damage_explained, entries_of, image_name, suffix_of
from vsx_ros.io.slam_map_file import slam_map_of as slam_map_of_entries
from vsx_ros.limits import DATA_BYTES, TEXT_BYTES, file_bytes, file_text, json_tree
from vsx_ros.slam.keyframe import KeyFrame
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.vision.pyramid import picture_file

_PNG, _PICTURE_BYTES = b"\x89PNG\r\n\x1a\n", 2**22
_STATE, _NOTES = "state/", "checkpoint.json"
_KEYFRAMES, _PATCHES = 64, 4096  # Keyframes whose corners form one piece, and patches in one piece: some megabytes


class CheckpointData(NamedTuple):
    """Contents of a checkpoint. stamp_ns: its time. state: named arrays for the resumed run; mission: the mission's
    memory, as JSON. beside: ``digests`` of the files beside the run's map with which its session began; None in those
    of older versions."""

    slam_map: SlamMap
    stamp_ns: int
    state: dict[str, NDArray[Any]]
    mission: dict[str, Any]
    beside: dict[str, str] | None = None


class Checkpoint:
    """Writes and reads one folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunks = ArrayChunks(path / "pieces")

    @property
    def exists(self) -> bool:
        """Whether there is a map to resume."""
        return (self.path / "map.zip").exists()

    def is_older_than(self, path: Path) -> bool:
        """Whether there is the file beside the run's map, and no checkpoint of a session that began with it as it is.
        Times, which a slow clock and copies falsify, tell it only of checkpoints of older versions."""
        if not (self.exists and path.exists()):
            return path.exists()
        known = self._beside()
        if known is None:
            return path.stat().st_mtime_ns >= (self.path / "map.zip").stat().st_mtime_ns
        return known.get(path.name, "") != digests([path]).get(path.name)  # also if it is unreadable: it is told

    def _beside(self) -> dict[str, str] | None:
        """As in ``CheckpointData``; None for a damaged checkpoint, too: who reads all of that tells it."""
        try:
            tree = json_tree(glance(self.path / "map.zip", _NOTES))
            return dict(tree["beside"])
        except (LookupError, TypeError, ValueError):
            return None

    def write(self, saved: CheckpointData) -> None:
        """Replace the checkpoint in one step. Raises InputError when the folder cannot be written."""
        living = {_stem(k): k for k in saved.slam_map.view.keyframes if k.alive}
        arrays = arrays_of(saved.slam_map.view)
        with self._writing():
            self.path.mkdir(parents=True, exist_ok=True)
            for path in (self.path.parent, *self.path.glob("*.jsonl")):
                sync(path)
            names = self._write_pictures(living)
            pieces = {name: self._chunks.write(arrays.pop(name), cuts) for name, cuts in _cuts(arrays).items()}
            entries = dict(entries_of(saved.slam_map, arrays))
            entries |= {f"{_STATE}{name}.npy": array_bytes(array) for name, array in saved.state.items()}
            files = {keyframe.id: names[stem] for stem, keyframe in living.items()}
            notes = {"stamp_ns": saved.stamp_ns, "mission": saved.mission, "files": files, "pieces": pieces}
            entries[_NOTES] = json.dumps(notes | ({} if saved.beside is None else {"beside": saved.beside})).encode()
            write_bytes(self.path / "map.zip", seal(entries, quick=True), durable=True)
            self._chunks.keep({piece for names in pieces.values() for piece in names})
            for path in (self.path / "keyframes").iterdir():
                if path.stem not in living:
                    path.unlink()

    def _writing(self) -> AbstractContextManager[None]:
        return explained(InputError, f"checkpoint {self.path} cannot be written", "free the disk", OSError)

    def _write_pictures(self, living: Mapping[str, KeyFrame]) -> dict[str, str]:
        """The name of each picture, by its stem."""
        folder = self.path / "keyframes"
        folder.mkdir(exist_ok=True)
        names = {path.stem: path.name for path in folder.iterdir()}
        for stem, keyframe in living.items():
            if stem not in names:
                content = picture_file(keyframe.data.image)
                names[stem] = stem + suffix_of(content)
                write_bytes(folder / names[stem], content, durable=True)
        return names

    def read(self) -> CheckpointData:
        """The newest checkpoint. Raises MapFileError when there is none or it is damaged."""
        path = self.path / "map.zip"
        with damage_explained(path):
            entries = unseal(file_bytes(path, DATA_BYTES))
            tree = json_tree(entries[_NOTES])
            files = {int(index): Path(name).name for index, name in tree["files"].items()}
            if len(set(files.values())) < len(files):
                raise ValueError("two of its keyframes name the same picture")
            for index, name in files.items():
                entries[image_name(index)] = file_bytes(self.path / "keyframes" / name, DATA_BYTES)
            allowance = self._chunks.allowance()
            for name, pieces in tree.get("pieces", {}).items():
                entries[array_name(name)] = array_bytes(self._chunks.read(pieces, allowance))
            state = {
                name.removeprefix(_STATE).removesuffix(".npy"): array_of(content)
                for name, content in entries.items()
                if name.startswith(_STATE)
            }
            return CheckpointData(
                slam_map=slam_map_of_entries(entries), stamp_ns=int(tree["stamp_ns"]), state=state,
                mission=dict(tree["mission"]), beside=dict(tree["beside"]) if "beside" in tree else None,
            )  # fmt: skip

    def newest_picture(self) -> bytes:
        """The PNG of the newest keyframe; empty when there is none, or when it is larger than a camera's."""
        pictures = sorted((self.path / "keyframes").glob("*.png"))
        if not pictures or pictures[-1].stat().st_size > _PICTURE_BYTES:
            return b""
        content = file_bytes(pictures[-1], _PICTURE_BYTES)
        return content if content.startswith(_PNG) else b""

    def write_mission(self, memory: Mapping[str, Any], stamp_ns: int) -> None:
        """Write the memory of a mission in a separate process, apart from the map, in one step. stamp_ns: that of
        the journal's last frame, by which ``end_trail`` finds what came after. Raises InputError if it cannot be
        written."""
        with self._writing():
            self.path.mkdir(parents=True, exist_ok=True)
            write_text(self.path / "mission.json", json.dumps({**memory, "stamp_ns": stamp_ns}), durable=True)

    def read_mission(self) -> dict[str, Any] | None:
        """The mission's memory of an interrupted run, and "stamp_ns"; None if there is no map or no memory. Raises
        InputError when damaged."""
        path = self.path / "mission.json"
        if not (self.exists and path.exists()):
            return None
        with explained(InputError, f"{path} cannot be read", "delete it, the mission then begins again"):
            tree = json_tree(file_text(path))
        return tree if isinstance(tree, dict) else {}


def digests(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of each of the files, by its name, without those that cannot be read."""
    found = {}
    for path in paths:
        with suppress(OSError, ValueError):
            found[path.name] = hashlib.sha256(file_bytes(path, TEXT_BYTES)).hexdigest()
    return found


def _cuts(arrays: Arrays) -> dict[str, NDArray[np.int64]]:
    """Where to cut the two largest arrays of a map, whose rows hardly ever change."""
    corners = np.cumsum(arrays["corner_count"].sum(axis=1))
    patches = np.arange(_PATCHES, len(arrays["template_patch"]), _PATCHES)
    return {"corner": corners[_KEYFRAMES - 1 : -1 : _KEYFRAMES], "template_patch": patches}


def _stem(keyframe: KeyFrame) -> str:
    return f"{keyframe.id:06d}_{keyframe.data.stamp_ns}"
