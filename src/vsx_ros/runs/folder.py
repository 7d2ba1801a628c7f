"""The folder of a run: its events, settings and results."""

from __future__ import annotations

import csv
import io
import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import structs

from vsx_ros.config import Config, from_dict, to_dict
from vsx_ros.errors import InputError, VsxError, disk_trouble, explained
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.atomic import try_to_make, write_text
from vsx_ros.io.map_file import load_map, save_map
from vsx_ros.io.trajectory_file import format_stamp, parse_stamp, read_trajectory, write_trajectory
from vsx_ros.limits import LOG_BYTES, TEXT_BYTES, file_text, json_tree
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.checkpoint import Checkpoint
from vsx_ros.runs.config_file import config_text, config_tree
from vsx_ros.runs.hold import hold
from vsx_ros.runs.journal import RunEvent
from vsx_ros.runs.versions import installed_versions, is_of_a_run

FILES = (
    "summary.json", "config.yaml", "trajectory.txt", "trajectory_final.txt", "odometry.txt", "groundtruth.txt",
    "map.pgm", "map.yaml", "sparse.ply", "dense.ply", "planes.json", "events.jsonl", "frames.csv", "report.html",
    "map.vsxmap", "moments.jsonl", "progress.csv", "map_zones.yaml", "map_rooms.json", "map_rooms.pgm", "map_dock.yaml",
    "world.yaml", "world_resumed.yaml", "odometry_calibration.yaml",
)  # fmt: skip
_RUNS = Path("runs")
_FRAME_COLUMNS_ONCE = 6  # older versions stored no u2_frames
_MOST = 1e12  # limit of all numbers in a frame
_EVENT = msgspec.json.Decoder(RunEvent)


class FrameRecord(NamedTuple):
    """One frame in frames.csv. state: value of the tracking state. track_ms: None if not measured. u2_frames: U2 of the
    run so far; None if there is none yet, and in folders of older versions."""

    stamp_ns: int
    state: str
    searched: int
    found: int
    keyframe_added: bool
    track_ms: float | None
    u2_frames: float | None = None


@dataclass(frozen=True)
class RunFolder:
    """Reads and writes the files of one run; each file appears complete or not at all."""

    path: Path

    @staticmethod
    def check(path: Path) -> None:
        """Raises InputError if something else has this path, or no folder can be made and written there."""
        with _making(path):
            if path.exists() and (not path.is_dir() or (any(path.iterdir()) and not is_of_a_run(path / "config.yaml"))):
                raise InputError(f"{path} exists and is not a run folder; choose another with --out, or remove it")
            try_to_make(path)

    @staticmethod
    def create(path: Path) -> RunFolder:
        """Make the folder, or empty that of an earlier run. Raises InputError as ``check`` and ``hold`` do."""
        RunFolder.check(path)
        with _making(path):
            path.mkdir(parents=True, exist_ok=True)
            with hold(path):
                for name in FILES:
                    (path / name).unlink(missing_ok=True)
                shutil.rmtree(path / "resume", ignore_errors=True)
        return RunFolder(path)

    @staticmethod
    def create_dated(name: str) -> RunFolder:
        """Make runs/<date>_<name>, with _2, _3, ... appended if it exists. Raises InputError if that fails."""
        first = dated(name)
        path, number = first, 1
        with _making(first):
            first.parent.mkdir(parents=True, exist_ok=True)
            while True:
                with suppress(FileExistsError):
                    path.mkdir()
                    return RunFolder(path)
                number += 1
                path = first.with_name(f"{first.name}_{number}")

    @staticmethod
    def open(path: Path) -> RunFolder:
        """An existing run. Raises InputError if the path is no run folder."""
        if not any((path / name).is_file() for name in ("summary.json", "config.yaml")):
            raise InputError(f"{path} is not a run folder (no config.yaml or summary.json in it); give one")
        return RunFolder(path)

    def write_what_fits(self, *writes: Callable[[], object]) -> str:
        """Try each write; remake a folder that was deleted meanwhile. Returns the reason of the first failure as a
        sentence; empty if everything is written."""
        said = ""
        for write in writes:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
                write()
            except VsxError as error:
                said = said or str(error)
            except OSError as error:
                said = said or disk_trouble(error) or f"{error.filename or self.path} cannot be written ({error})"
        return said

    @property
    def checkpoint(self) -> Checkpoint:
        """The state with which an interrupted run is resumed."""
        return Checkpoint(self.path / "resume")

    @property
    def journal(self) -> Path:
        """The path of the journal, see ``journal``."""
        return self.path / "resume" / "journal.jsonl"

    @property
    def witness(self) -> Path:
        """The path of a live run's other journal, see ``MonitorJournal``."""
        return self.path / "resume" / "witness.jsonl"

    @property
    def moments(self) -> Path:
        """The path of the camera pictures and maps of all moments, see ``Moments``."""
        return self.path / "moments.jsonl"

    def write_config(self, config: Config, command: Sequence[str], **facts: Any) -> None:
        """Write configuration, versions of the computing packages, command line, and facts such as the seed."""
        date = datetime.now().isoformat(" ", "seconds")
        tree = {"command": " ".join(command), "date": date, **facts, "versions": installed_versions()}
        tree["config"] = to_dict(config)
        write_text(self.path / "config.yaml", config_text(tree), durable=True)

    def read_config(self) -> tuple[Config, dict[str, Any]]:
        """The configuration, and the other entries of config.yaml (command, versions, seed). Raises InputError or
        ConfigError when the file is missing, damaged or cut short."""
        tree = self._parsed("config.yaml", config_tree)
        return from_dict(tree.pop("config")), tree

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """The numbers of the run, one key per line; unknown values are null."""
        write_text(self.path / "summary.json", json.dumps(dict(summary), indent=1, allow_nan=False) + "\n")

    def read_summary(self) -> dict[str, Any]:
        """What ``write_summary`` wrote. Raises InputError when missing or damaged."""
        return self._parsed("summary.json", json_tree)

    def write_events(self, events: Iterable[RunEvent]) -> None:
        """Every change of state with its reason, by time, one JSON object per line."""
        ordered = sorted(events, key=lambda event: event.stamp_ns)
        write_text(self.path / "events.jsonl", "".join(json.dumps(structs.asdict(event)) + "\n" for event in ordered))

    def read_events(self) -> list[RunEvent]:
        """What ``write_events`` wrote; empty without a file. Raises InputError when damaged."""
        if not (self.path / "events.jsonl").exists():
            return []
        with self._reading("events.jsonl", (RecursionError, ValueError)):
            return [_EVENT.decode(line) for line in io.StringIO(self._text("events.jsonl", LOG_BYTES))]

    def write_frames(self, frames: Iterable[FrameRecord]) -> None:
        """frames.csv: how each frame was tracked."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["stamp_s", *FrameRecord._fields[1:]])
        for frame in frames:
            measured = ("" if value is None else f"{value:.2f}" for value in (frame.track_ms, frame.u2_frames))
            counts = frame.searched, frame.found, int(frame.keyframe_added)
            writer.writerow([format_stamp(frame.stamp_ns), frame.state, *counts, *measured])
        write_text(self.path / "frames.csv", text.getvalue())

    def read_frames(self) -> list[FrameRecord]:
        """What ``write_frames`` wrote; empty without a file. Raises InputError when damaged."""
        if not (self.path / "frames.csv").exists():
            return []
        with self._reading("frames.csv", (csv.Error, OverflowError, ValueError)):
            rows = csv.reader(io.StringIO(self._text("frames.csv", LOG_BYTES)))
            return [_frame_record(row) for row in islice(rows, 1, None)]

    def write_poses(self, name: str, poses: Iterable[StampedPose]) -> None:
        """name: trajectory, trajectory_final, groundtruth (T_world_cam) or odometry (T_odom_base)."""
        write_trajectory(self.path / f"{name}.txt", poses)

    def read_poses(self, name: str) -> list[StampedPose]:
        """What ``write_poses`` wrote; empty without a file."""
        path = self.path / f"{name}.txt"
        return read_trajectory(path) if path.exists() else []

    def read_trajectories(self) -> tuple[list[StampedPose], list[StampedPose]]:
        """T_world_cam of the tracked frames, live and final."""
        return self.read_poses("trajectory"), self.read_poses("trajectory_final")

    def write_map(self, grid: OccupancyGrid) -> None:
        """map.pgm and map.yaml."""
        save_map(grid, self.path / "map.yaml")

    def read_map(self) -> OccupancyGrid | None:
        """The map, or None."""
        return load_map(self.path / "map.yaml") if (self.path / "map.yaml").exists() else None

    def _text(self, name: str, most: int = TEXT_BYTES) -> str:
        with explained(InputError, f"{self.path / name} cannot be read", "run again"):
            return file_text(self.path / name, most)

    def _reading(self, name: str, causes: tuple[type[Exception], ...]) -> AbstractContextManager[None]:
        return explained(InputError, f"{self.path / name} is damaged", "delete it or run again", causes)

    def _parsed(self, name: str, parse: Any) -> dict[str, Any]:
        text = self._text(name)
        with explained(InputError, f"{self.path / name} is damaged", "run again"):
            tree = parse(text)
            if not isinstance(tree, dict):
                raise ValueError("it holds no names")
            return tree


def dated(name: str, parent: Path = _RUNS) -> Path:
    """The path of a run that begins now: <parent>/<date>_<name>."""
    return parent / f"{datetime.now().strftime('%Y-%m-%d_%H-%M-%S')}_{name}"


def _making(path: Path) -> AbstractContextManager[None]:
    return explained(InputError, f"run folder {path} cannot be made", "choose another with --out", OSError)


def _frame_record(row: Sequence[str]) -> FrameRecord:
    stamp, state, searched, found, added, *measured = row if len(row) > _FRAME_COLUMNS_ONCE else [*row, ""]
    track_ms, u2_frames = (float(value) if value else None for value in measured)
    frame = FrameRecord(
        parse_stamp(stamp), state, searched=int(searched), found=int(found), keyframe_added=bool(int(added)),
        track_ms=track_ms, u2_frames=u2_frames,
    )  # fmt: skip
    if not all(0 <= number <= _MOST for number in (frame.searched, frame.found, track_ms or 0, u2_frames or 0)):
        raise ValueError(f"frame {stamp} holds a number that is none of a frame")
    return frame
