"""The start of an exploration, of a resumed one, or of a replay: complete options, folder, world, recording."""

import argparse
import dataclasses
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError, InputError, MapFileError, explained
from vsx_ros.geometry.camera import PinholeCamera, nominal_camera
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.recording import Recording
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.runs.folder import RunFolder, dated
from vsx_ros.runs.hold import hold
from vsx_ros.runs.parameters import load, robot_file_here
from vsx_ros.runs.places import given_zones
from vsx_ros.runs.previous import end_trail
from vsx_ros.runs.rooms import room_beside
from vsx_ros.runs.world import model_folders, open_world, save_world, world_files
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.world_file import load_world

DEFAULTS = {"seed": 1, "base": "auto", "port": "/dev/kobuki", "camera": "kinect", "rate": 15.0, "planner": "fov",
            "eye": "raster"}  # fmt: skip
REMEMBERED = (
    "world", "seed", "base", "port", "camera", "rate", "planner", "time", "until", "fast", "load_map", "zones", "room",
    "dock", "battery_pace", "eye",
)  # fmt: skip


@contextmanager
def begin(args: argparse.Namespace) -> Iterator[tuple[RunFolder, Config, EmulatedWorld | None]]:
    """The run folder, held meanwhile, its configuration, and the emulated world or None. Missing options get the
    default, or the value of the run to resume. Checks everything before it writes. Raises InputError, ConfigError or
    MapFileError if the run, world or map does not exist, or an option contradicts it, or another run has the folder."""
    check_files(args)
    if args.resume is not None:
        with hold(args.resume):
            yield _begin_again(args, RunFolder.open(args.resume))
        return
    if args.moved:
        raise ConfigError("--moved is said of the robot of an interrupted run; give that run with --resume, too")
    fill(args, DEFAULTS)
    if args.fast:
        fill(args, {"world": "lab"})
    if args.load_map is not None:
        load_slam_map(Path(args.load_map))
    if args.world is None:
        args.config = robot_file_here(args.config)
    parameters = load(args.config, args.set)
    if args.phi is not None:
        parameters = overridden(parameters, {"planner.phi_rad_m": args.phi})
    world = open_world(args.world, args.seed, args.models, args.hard) if args.world else None
    tell_remarks(world)
    name = Path(args.world).stem.replace(":", "_") if args.world else args.base.partition(":")[0]
    folder = RunFolder.create(args.out) if args.out else RunFolder.create_dated(name)
    hard = {} if world is None else world.hard
    with hold(folder.path):
        folder.write_config(parameters, args.line, hard=hard, **{name: getattr(args, name) for name in REMEMBERED})
        if world is not None:
            save_world(world, folder.path / "world.yaml")
        yield folder, parameters, world


def check_files(args: argparse.Namespace) -> None:
    """Make the paths of files absolute. Raises InputError, ConfigError or MapFileError for options that contradict each
    other or the run to resume, and for a run, map, room, zones or folder of the run that cannot be used, as far as that
    is known without kernels."""
    if args.resume is not None:
        facts = _facts_to_resume(args, RunFolder.open(args.resume))
        _refuse_meaningless(args, facts.get("world") or None, facts.get("load_map"))
    else:
        _refuse_meaningless(args, args.world, args.load_map)
        RunFolder.check(args.out or dated("explore"))
    if args.load_map is not None:
        args.load_map = str(Path(args.load_map).resolve())
        if not Path(args.load_map).is_file():
            raise ConfigError(f"there is no map {args.load_map}; 'vsx map save' makes one")
        check_slam_map(Path(args.load_map))
    if args.room is not None:
        if args.load_map is None and args.resume is None:
            raise ConfigError(f"--room {args.room}: rooms are known of a saved map; give it with --load-map")
        if args.load_map is not None:
            room_beside(Path(args.load_map), args.room)
    if args.zones is not None:
        args.zones = str(Path(args.zones).resolve())
        given_zones(Path(args.zones))
    if args.out is not None:
        keep_apart(args.out, args.load_map, args.zones, *(world_files(args.world, args.models) if args.world else ()))


def check_slam_map(path: Path) -> None:
    """Raises MapFileError for a file that is no SLAM map at all, by its first bytes, or cannot be read."""
    with explained(MapFileError, f"map {path} cannot be read", "'vsx map save' makes one"), path.open("rb") as file:
        if file.read(2) != b"PK":
            raise MapFileError(f"{path} is not a .vsxmap; 'vsx map save' makes one")


def keep_apart(out: Path, *inputs: Path | str | None) -> None:
    """Raises ConfigError for an input file in the run folder that a new run is about to empty."""
    for file in inputs:
        if file is not None and Path(file).resolve().is_relative_to(out.resolve()):
            raise ConfigError(f"{file} lies in {out}, which a new run empties; choose another folder with --out")


def tell_remarks(world: EmulatedWorld | None) -> None:
    """Name what is missing of a Gazebo world, on standard error."""
    for remark in world.parts.remarks if isinstance(world, MeshWorld) else ():
        print(f"vsx: {remark}", file=sys.stderr)


def fill(args: argparse.Namespace, values: Mapping[str, Any]) -> None:
    """Set the missing options to these values."""
    for name, value in values.items():
        if getattr(args, name) is None:
            setattr(args, name, value)


def _refuse_meaningless(args: argparse.Namespace, world: str | None, load_map: str | None) -> None:
    """Raises ConfigError for options that only a real robot has, or only one with emulated devices. world, load_map:
    those of the run, also of one to resume, whose other options are not filled in yet."""
    emulated = args.fast or world is not None
    if args.until is not None and (not emulated or load_map):
        known = "how much is right is known of an emulated world and a new map alone"
        raise ConfigError(f"{_written(args, 'until')}: {known}")
    remedy = "leave it out" if args.resume is not None else "give --world, or leave it out"
    for name, what in {"rate": "camera", "dock": "world", "battery_pace": "world"}.items():
        if getattr(args, name) is not None and not emulated:
            raise ConfigError(f"{_written(args, name)} is for an emulated {what}; {remedy}")
    if args.eye is not None and not args.fast:
        raise ConfigError(f"--eye {args.eye} draws in lock-step alone; add --fast, or leave it out")
    if args.hard and not emulated:
        raise ConfigError(f"--with {args.hard[0]} is for an emulated world; {remedy}")
    if args.models and world is None:
        raise ConfigError(f"--models {args.models[0]} is for a Gazebo world; {remedy}")
    whose = f"that {'--fast' if args.fast else '--world'} emulates; leave out one of the two"
    if args.resume is not None:
        whose = f"of {args.resume}, which is emulated; leave it out"
    wires = ("base", "port", "camera", "rate", "dock", "battery_pace") if args.fast else ("port", "camera")
    for name in wires if emulated else ():
        if getattr(args, name) is not None:
            raise ConfigError(f"{_written(args, name)} has no meaning for the robot {whose}")


def _written(args: argparse.Namespace, name: str) -> str:
    """The option as on the command line."""
    value = getattr(args, name)
    return f"--{name.replace('_', '-')} {f'{value:g}' if isinstance(value, float) else value}"


def _facts_to_resume(args: argparse.Namespace, folder: RunFolder) -> dict[str, Any]:
    """What config.yaml tells of the run beside its configuration. Raises ConfigError for a run that cannot be resumed
    so, and for an option that was chosen when it began; InputError if that cannot be read."""
    facts = folder.read_config()[1]
    fixed = ("world", "seed", "base", "planner", "phi", "load_map", "room", "zones", "config", "set", "out", "models",
             "eye")  # fmt: skip
    contradicting = [name.replace("_", "-") for name in fixed if getattr(args, name) not in (None, [])]
    contradicting += ["with"] if args.hard else []
    if contradicting:
        raise ConfigError(f"--resume goes on with the options of {folder.path}; leave out --{contradicting[0]}")
    if "fast" not in facts:
        raise ConfigError(f"{folder.path} is no run of 'vsx explore'; a replay is begun again")
    if facts["fast"] is not args.fast:
        how = "with" if facts["fast"] else "without"
        raise ConfigError(f"{folder.path} was made {how} --fast; resume it so, too")
    return facts


def _begin_again(args: argparse.Namespace, folder: RunFolder) -> tuple[RunFolder, Config, EmulatedWorld | None]:
    parameters, facts = folder.read_config()
    fill(args, {name: facts.get(name) for name in REMEMBERED})
    fill(args, DEFAULTS)
    world = load_world(folder.path / "world.yaml", usual=model_folders()) if args.world else None
    if args.moved and world is not None:
        raise ConfigError(f"the emulated robot of {folder.path} stands where it stood; leave out --moved")
    if not args.fast:
        end_trail(folder, args.moved)
    return folder, parameters, world


def told(recording: Recording) -> Recording:
    """The recording, which tells on standard error what of it is damaged or left out."""

    @cache  # it may be read several times
    def tell(text: str) -> None:
        print(f"vsx: {text}", file=sys.stderr)

    if recording.damage:
        tell(recording.damage)
    return dataclasses.replace(recording, tell=tell)


def opened_recording(args: argparse.Namespace) -> Recording:
    """The recording of the options, with a camera; damage is reported. Raises InputError if it cannot be used as
    requested, CalibrationError for an unreadable calibration, ConfigError if an input lies in the run folder."""
    RunFolder.check(args.out or dated(args.input.stem))
    if args.out is not None:
        keep_apart(args.out, args.load_map, args.input, args.calibration)
    topics = args.image_topic, args.odometry_topic
    recording = told(open_recording(args.input, *topics, own_camera=args.calibration is None))
    if args.ros and args.map and not recording.odometry:
        raise InputError(f"{args.input} has no odometry, so the nodes know no floor; leave out --map or --ros")
    return dataclasses.replace(recording, camera=_calibration(recording, args.calibration))


@contextmanager
def replay_folder(args: argparse.Namespace, config: Config) -> Iterator[RunFolder]:
    """The run folder, held meanwhile, with the configuration in it. Raises InputError if something else has this path
    or another run the folder."""
    folder = RunFolder.create(args.out) if args.out else RunFolder.create_dated(args.input.stem)
    with hold(folder.path):
        folder.write_config(config, args.line, seed=args.seed, input=str(args.input.resolve()))
        yield folder


def _calibration(recording: Recording, file: Path | None) -> PinholeCamera:
    """The operator's calibration, else the recording's own, else a Kinect's nominal one with a warning."""
    if file is not None:
        return read_calibration(file)
    if recording.camera is not None:
        return recording.camera
    first = next(recording.frames(), None)
    if first is None:
        raise InputError(f"{recording.source} holds no image that could be used; record it again")
    camera = nominal_camera(first.image.shape[1], first.image.shape[0])
    print(
        f"vsx: {recording.source} brings no camera calibration: a Kinect's nominal one is assumed ({camera.fx:g} px), "
        "expect a bent map; give the right one with --calibration FILE (ROS camera_info YAML or camera.json)",
        file=sys.stderr,
    )
    return camera
