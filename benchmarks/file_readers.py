"""Every reader of files: a good sample, how it is damaged, and all that is done with the file."""

import json
import random
import shutil
from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import file_mutations as mutations
import file_samples as samples
import numpy as np
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from vsx_ros.cli.calibrate import calibrate
from vsx_ros.cli.calibrate_drives import OF_A_DRIVE
from vsx_ros.cli.maps import facts
from vsx_ros.errors import InputError
from vsx_ros.evaluation.trajectory import associate, trajectory_error
from vsx_ros.experiments.rows import read_rows
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.bag import open_recording
from vsx_ros.io.bag_reader import messages
from vsx_ros.io.bag_without_index import UnindexedBag
from vsx_ros.io.calibration_file import read_calibration, write_calibration
from vsx_ros.io.dock_file import load_dock
from vsx_ros.io.image_encoding import SUPPORTED, GrayImages, gray_image
from vsx_ros.io.map_export import read_ply
from vsx_ros.io.map_file import load_map, load_plan
from vsx_ros.io.room_file import load_rooms
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.io.trajectory_file import read_trajectory
from vsx_ros.io.zone_file import load_zones
from vsx_ros.occupancy.zoned_grid import with_zones
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import read_journal
from vsx_ros.runs.parameters import commented_yaml, update_robot_file
from vsx_ros.runs.parameters import load as load_config
from vsx_ros.runs.previous import PreviousSessions, end_trail
from vsx_ros.runs.record import RunRecord
from vsx_ros.runs.report import write_report
from vsx_ros.runs.world import save_world
from vsx_ros.session import SlamSession
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.generate import generate_world, world_from_grid
from vsx_ros.sim.optics import scene_of
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world_file import load_world
from vsx_ros.slam.slam import SequentialSlam


class Reader(NamedTuple):
    """make: writes the good sample to a path. files: pattern of the files to damage; the path itself if empty. damage:
    (random, bytes) to bytes, or changes the file at a path. read: everything done with the file."""

    name: str
    make: Callable[[Path], Any]
    files: tuple[str, ...]
    damage: Callable[..., Any]
    read: Callable[[Path], Any]


def _recording(path: Path) -> None:
    recording = open_recording(path, image_topic=None if path.is_dir() and (path / "rgb.txt").exists() else IMAGES)
    for _ in recording.messages():
        pass


IMAGES = "/camera/image_raw"


def _packed(path: Path) -> None:
    for _ in open_recording(path, image_topic=f"{IMAGES}/compressed").messages():
        pass


def _without_index(path: Path) -> None:
    for connection in UnindexedBag(path).connections:
        assert connection.msgcount >= 0
    _recording(path)


def _cut_bag(path: Path) -> None:
    samples.ros1_bag(path, "lz4")
    path.write_bytes(path.read_bytes()[:-200])


def _counts(path: Path) -> None:
    with messages(path) as bag:
        bag.counts()
    _packed(path)


def _image(path: Path) -> None:
    GrayImages().of_file(path.read_bytes(), str(path))
    GrayImages().of_file(path.read_bytes(), str(path), "bayer_rggb8; x")


def _world(path: Path) -> None:
    world = load_world(path)
    if (world.bounds[2] - world.bounds[0]) * (world.bounds[3] - world.bounds[1]) < 5000.0:
        ground_truth_grid(world, 0.05, 0.02, 0.45)


def _gazebo(path: Path) -> None:
    world = load_gazebo(path / "room.world", [])
    ground_truth_grid(world, 0.05, 0.02, 0.45)
    scene_of(world)


def _resume(path: Path) -> None:
    folder = RunFolder.open(path)
    folder.read_config()
    before = PreviousSessions.of(folder)
    if before is not None:
        assert before.system is not None
    end_trail(folder, False)


def _resume_live(path: Path) -> None:
    """As the node vslam begins again."""
    folder = RunFolder.open(path)
    before = PreviousSessions.of(folder)
    if before is None:
        return
    saved, mount = before.saved, samples.slam_map().T_base_cam
    session = SlamSession(mount, folder.read_config()[0], saved.slam_map, saved.state)
    slam = session.begin(SequentialSlam, samples.CAMERA, 0)
    slam.statistics()
    with_zones(session.ground.grid(slam.snapshot()), session.ground.zones.zones(np.zeros(0, np.int64), []), 0.1, 0.2)
    session.ground.state()


def _found_odometry(path: Path) -> None:
    others = dict.fromkeys(OF_A_DRIVE)
    calibrate(Namespace(verb="odometry", input=path, out=path / "robot.yaml", **others))


def _renewed_calibration(path: Path) -> None:
    """As 'vsx calibrate camera' keeps the shutter of the former file."""
    camera = replace(samples.CAMERA, shutter=read_calibration(path).shutter)
    write_calibration(path, camera)
    assert read_calibration(path) == camera


def _journal(path: Path) -> None:
    record = RunRecord(SE3.identity())
    record.restore(read_journal(path))
    record.counted()
    record.final(None)


def _trajectories(path: Path) -> None:
    poses = read_trajectory(path)
    trajectory_error(associate(poses, poses, 10**7), "yaw")


def _plan_map(path: Path) -> None:
    load_map(path / "map.yaml")
    world_from_grid(load_map(path / "map.yaml"), "map", 0)


def _map_folder(path: Path) -> None:
    from vsx_ros.io.map_file import save_map

    path.mkdir()
    save_map(samples.grid(), path / "map.yaml")


def _map_file(path: Path) -> None:
    save_slam_map(samples.slam_map(), path)


def _journal_file(path: Path) -> None:
    samples.run_folder(path.with_name("run"))
    shutil.copy(path.with_name("run") / "resume" / "journal.jsonl", path)


def _trajectory_file(path: Path) -> None:
    samples.run_folder(path.with_name("run"))
    shutil.copy(path.with_name("run") / "trajectory.txt", path)


def _ply_file(path: Path) -> None:
    samples.run_folder(path.with_name("run"))
    shutil.copy(path.with_name("run") / "sparse.ply", path)


def _raw_image(rng: random.Random, path: Path) -> None:
    numbers = {name: mutations.integer(rng, 32) for name in ("height", "width", "step", "size")}
    if rng.random() < 0.7:
        height, width = rng.choice(((24, 32), (1, 32), (24, 1), (2, 2)))
        step = width * rng.randrange(1, 5)
        numbers |= {"height": height, "width": width, "step": step, "size": step * height - (rng.random() < 0.1)}
    how = {"encoding": rng.choice((*SUPPORTED, "32FC1")), "big_endian": rng.random() < 0.5, "shift": rng.randrange(17)}
    path.write_text(json.dumps({**numbers, **how}))


def _read_rows(path: Path) -> None:
    """Invalid rows are reported and left out; here that counts as refusing the file."""
    told: list[str] = []
    read_rows(path, told.append)
    if told:
        raise InputError(told[0])


def _raw_image_file(path: Path) -> None:
    numbers = {"height": 24, "width": 32, "step": 32, "size": 24 * 32}
    path.write_text(json.dumps({**numbers, "encoding": "mono8", "big_endian": False, "shift": 0}))


def _read_raw_image(path: Path) -> None:
    tree = json.loads(path.read_text())
    data = np.zeros(min(tree["size"], 10**6), np.uint8)
    size = tree["height"], tree["width"], tree["step"]
    gray_image(tree["encoding"], *size, data, big_endian=tree["big_endian"], shift_bits=tree["shift"])


def _any_text(rng: random.Random, data: bytes) -> bytes:
    return (mutations.raw if rng.random() < 0.2 else mutations.text)(rng, data)


def _by_suffix(rng: random.Random, path: Path) -> None:
    how = {
        ".npy": mutations.array,
        ".png": mutations.png,
        ".jpg": mutations.jpeg,
        ".tiff": mutations.tiff,
        ".zip": mutations.sealed,
        **dict.fromkeys((".pgm", ".stl", ".glb"), mutations.raw),
    }
    path.write_bytes(how.get(path.suffix, _any_text)(rng, path.read_bytes()))


def _bag2(rng: random.Random, path: Path) -> None:
    if path.suffix == ".db3":
        mutations.database(rng, path)
    else:
        how = {".mcap": mutations.mcap, ".yaml": _any_text}.get(path.suffix, mutations.raw)
        path.write_bytes(how(rng, path.read_bytes()))


MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
READERS = [
    Reader(
        "slam map",
        lambda p: save_slam_map(samples.slam_map(), p),
        (),
        mutations.sealed,
        lambda p: facts(load_slam_map(p)),
    ),
    Reader("checkpoint", samples.run_folder, ("resume/**/*.*", "resume/map.zip", "config.yaml"), _by_suffix, _resume),
    Reader("live session", samples.live_session, ("resume/map.zip",), _by_suffix, _resume_live),
    Reader("journal", _journal_file, (), _any_text, _journal),
    Reader("run folder", samples.run_folder, ("*.*",), _by_suffix, lambda p: write_report(RunFolder.open(p))),
    *(
        Reader(f"ros1 bag {how}", partial(samples.ros1_bag, how=how), (), mutations.ros1_bag, read)
        for how, read in (("none", _recording), ("bz2", _packed), ("lz4", _recording))
    ),
    Reader("ros1 bag without index", _cut_bag, (), mutations.ros1_bag, _without_index),
    *(
        Reader(f"ros2 {name}", partial(samples.ros2_bag, plugin=plugin, mode=mode), files, _bag2, read)
        for name, plugin, mode, files, read in (
            ("sqlite3", SQLITE, CompressionMode.NONE, ("*.db3", "metadata.yaml"), _recording),
            ("sqlite3 file.zstd", SQLITE, CompressionMode.FILE, ("*",), _recording),
            ("sqlite3 message.zstd", SQLITE, CompressionMode.MESSAGE, ("*",), _packed),
            ("mcap", MCAP, CompressionMode.NONE, ("*.mcap", "metadata.yaml"), _recording),
            ("mcap zstd", MCAP, CompressionMode.STORAGE, ("*.mcap",), _counts),
        )
    ),
    Reader("tum folder", samples.tum_folder, ("*.*", "rgb/*"), _by_suffix, _recording),
    Reader("world", lambda p: save_world(generate_world("corridor", 0), p), (), _any_text, _world),
    Reader("gazebo world", samples.gazebo_world, ("*.*",), _by_suffix, _gazebo),
    Reader("zones", samples.zones_yaml, (), _any_text, lambda p: with_zones(samples.grid(), load_zones(p), 0.1, 0.2)),
    Reader("rooms", samples.rooms_folder, ("*.*",), _by_suffix, lambda p: load_rooms(p / "map_rooms.json")),
    Reader("dock", samples.dock_yaml, (), _any_text, load_dock),
    Reader("map", _map_folder, ("map.yaml", "map.pgm"), _by_suffix, _plan_map),
    Reader("calibration", samples.camera_yaml, (), _any_text, read_calibration),
    Reader("configuration", samples.config_yaml, (), _any_text, lambda p: load_config(p, [])),
    Reader("every parameter", samples.every_parameter, (), _any_text, lambda p: commented_yaml(load_config(p, []))),
    Reader("found odometry", samples.found_odometry, ("*.yaml",), _by_suffix, _found_odometry),
    Reader("renewed calibration", samples.renewed_camera_yaml, (), _any_text, _renewed_calibration),
    Reader(
        "robot file", samples.config_yaml, (), _any_text, lambda p: update_robot_file(p, "robot.mount", {}, "by hand")
    ),
    Reader("trajectory", _trajectory_file, (), _any_text, _trajectories),
    Reader("point cloud", _ply_file, (), mutations.raw, read_ply),
    Reader("campaign", samples.results_jsonl, (), _any_text, _read_rows),
    Reader("raw image", _raw_image_file, (), _raw_image, _read_raw_image),
    *(
        Reader(f"{kind} image", samples.picture, (), how, _image)
        for kind, how in {
            "png": mutations.png,
            "jpg": mutations.jpeg,
            "tiff": mutations.tiff,
            **dict.fromkeys(("pgm", "bmp"), mutations.raw),
        }.items()
    ),
    Reader("png plan", samples.picture, (), mutations.png, load_plan),
]
_YAML = (
    "world", "calibration", "renewed calibration", "configuration", "every parameter", "robot file", "zones", "dock",
)  # fmt: skip
SUFFIXES = {
    "slam map": ".vsxmap", "journal": ".jsonl", "campaign": ".jsonl", "png plan": ".png", "point cloud": ".ply",
    "trajectory": ".txt", **dict.fromkeys(_YAML, ".yaml"),
}  # fmt: skip
BY_PATH = (_by_suffix, _bag2, _raw_image)
