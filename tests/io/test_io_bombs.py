"""A file of at most 10 MB takes at most 512 MiB, whatever it declares, and is one sentence."""

from pathlib import Path

import bombs
import file_samples
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from taken import taken

from vsx_ros.cli.main import execute
from vsx_ros.errors import InputError, VsxError
from vsx_ros.experiments.rows import read_rows
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.image_encoding import GrayImages, gray_image
from vsx_ros.io.map_file import load_map, load_plan
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.io.trajectory_file import read_trajectory
from vsx_ros.runs.checkpoint import Checkpoint, CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import read_journal
from vsx_ros.runs.parameters import load, update_robot_file
from vsx_ros.runs.world import save_world
from vsx_ros.sim.generate import world_from_grid
from vsx_ros.sim.scene import compile_scene
from vsx_ros.sim.truth import ground_truth_grid
from vsx_ros.sim.world_file import load_world


@pytest.fixture(scope="module")
def good_map(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "good.vsxmap"
    save_slam_map(file_samples.slam_map(), path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def gigabyte():
    return bombs.deflated(bombs.GIB)


def maps(good, gigabyte):
    yield "asks for", bombs.with_entry(good, "arrays/more.npy", bombs.GIB, gigabyte)
    yield "cannot be unpacked", bombs.with_entry(good, "arrays/more.npy", bombs.GIB, gigabyte, declared=10)
    yield "cannot be unpacked", bombs.damaged_deflate(good)
    yield "asks for", bombs.map_of(good, bombs.zero_arrays(400_000))
    many = bombs.zero_arrays(70_000)
    many["anchor"][1:] = 0
    yield "keyframes, a map has", bombs.map_of(good, many)
    yield "pictures asks for", bombs.map_of(good, bombs.zero_arrays(600), bombs.png(1920, 1200), 1920, 1200)
    yield "keyframe 0 is no grey", bombs.map_of(good, bombs.zero_arrays(1), bombs.png(30_000, 30_000))
    for text in bombs.JSON_BOMBS.values():
        yield "cannot be used", bombs.seal({**bombs.unseal(good), "manifest.json": text.encode()})


def test_maps(tmp_path, good_map, gigabyte):
    for message, content in maps(good_map, gigabyte):
        (tmp_path / "x.vsxmap").write_bytes(content)
        assert message in taken(tmp_path / "x.vsxmap", load_slam_map)


@pytest.mark.parametrize("bomb", bombs.YAML_BOMBS)
def test_yaml(tmp_path, bomb):
    path, folder = tmp_path / "x.yaml", tmp_path / "run"
    path.write_text(bombs.YAML_BOMBS[bomb])
    folder.mkdir()
    (folder / "config.yaml").write_bytes(path.read_bytes())
    for read in (
        read_calibration,
        load_map,
        load_world,
        lambda p: load(p, []),
        lambda p: update_robot_file(p, "robot.mount", {}, ""),
    ):
        assert str(path) in taken(path, read) or bomb == "laughs"
    assert "config" in taken(folder, lambda p: RunFolder.open(p).read_config())


@pytest.mark.parametrize("bomb", bombs.JSON_BOMBS)
def test_json(tmp_path, bomb):
    path, folder = tmp_path / "x.json", tmp_path / "run"
    (folder / "resume").mkdir(parents=True)
    files = (path, folder / "summary.json", folder / "events.jsonl", folder / "resume" / "mission.json")
    for file in (*files, folder / "resume" / "map.zip"):
        file.write_text(bombs.JSON_BOMBS[bomb] + "\n")
    run = RunFolder(folder)
    assert taken(path, read_calibration)
    told: list[str] = []
    assert taken(path, lambda p: read_rows(p, told.append)) == ""
    assert "is no row of results" in told[0]
    assert taken(path, read_journal)
    assert taken(folder, lambda _: run.read_events())
    assert taken(folder, lambda _: run.read_summary()) or bomb == "huge"
    assert taken(folder, lambda _: run.checkpoint.read_mission()) or bomb in ("digits", "huge")


def test_a_device_has_no_end(tmp_path):
    for read in (read_calibration, load_plan, read_trajectory, lambda p: load(p, [])):
        with pytest.raises(VsxError, match="/dev/zero"):
            read(Path("/dev/zero"))


PICTURES = {
    "png": lambda: bombs.png(30_000, 30_000),
    "png of 64 bits": lambda: bombs.png(10_000, 10_000, 16, 6),
    "jpeg": lambda: bombs.jpeg(65_000, 65_000),
    "tiff": lambda: bombs.tiff(30_000, 30_000),
    "tiff with two heights": lambda: bombs.tiff(30_000, 4000, (257, 4, 1, 64)),
    "tiff with its height elsewhere": lambda: bombs.tiff(30_000, 4000, (257, 16, 1, bombs.PLACE)),
    "tiff with two kinds of height": lambda: bombs.tiff(30_000, 4000, (257, 3, 2, 64)),
    "tiff of large tiles": lambda: bombs.tiff(64, 64, (322, 4, 1, 2**17), (323, 4, 1, 2**10)),
    "tiff of tiles without a height": lambda: bombs.tiff(64, 64, (322, 4, 1, 64)),
    "large tiff": lambda: bombs.big_tiff(64, 64),
    "bmp": lambda: bombs.bmp(30_000, -30_000),
    "pgm": lambda: b"P5\n40000 40000\n255\n",
    "pgm with a comment": lambda: b"P5\n# 1 1\n40000 40000\n255\n",
    "ppm": lambda: b"P3 #x\n40000 40000\n255\n1 2 3",
    "scans": lambda: bombs.jpeg(5000, 5000) + b"\xff\xda" * 1000,
    "webp": lambda: b"RIFF\x00\x00\x00\x00WEBPVP8 ",
}


@pytest.mark.parametrize("kind", PICTURES)
def test_pictures(tmp_path, kind):
    path = tmp_path / "x.pgm"
    path.write_bytes(PICTURES[kind]())
    assert "cannot be used" in taken(path, lambda p: GrayImages().of_file(p.read_bytes(), f"image {p}"))
    assert "cannot be used" in taken(
        path, lambda p: GrayImages().of_file(p.read_bytes(), f"image {p}", "bayer_rggb8; png")
    )
    assert str(path) in taken(path, load_plan)
    (tmp_path / "m.yaml").write_text(
        "image: x.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nfree_thresh: 0.2\noccupied_thresh: 0.6\nnegate: 0\n"
    )
    assert str(path) in taken(tmp_path, lambda p: load_map(p / "m.yaml"))


def test_the_largest_map_that_is_read(tmp_path):
    path = tmp_path / "plan.png"
    path.write_bytes(bombs.png(4096, 4096, 16, 6))
    assert taken(path, load_plan) == ""


@pytest.mark.parametrize(("height", "width"), [(2**31, 2**31), (2**16, 2**16), (1, 2**32 - 1), (0, 0)])
def test_raw_images(height, width):
    for encoding in ("mono8", "bgr8", "mono16", "yuv422"):
        with pytest.raises(InputError, match="image"):
            gray_image(encoding, height, width, width, bytes(1000))


@pytest.mark.parametrize("how", ["bz2", "lz4"])
@pytest.mark.parametrize("declared", [None, 100, 2**32 - 1])
@pytest.mark.parametrize("index", [True, False])
def test_ros1_bags(tmp_path, how, declared, index):
    path = tmp_path / "x.bag"
    path.write_bytes(bombs.ros1_bag(how, declared=declared, index=index))
    assert "x.bag" in taken(path, lambda p: list(open_recording(p).messages()))


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_ros2_bags(tmp_path, plugin, mode):
    bombs.ros2_bag(tmp_path / "x", plugin, mode)
    said = taken(tmp_path / "x", lambda p: list(open_recording(p).messages()))
    assert any(words in said for words in ("at most", "left for", "more than")), said


@pytest.mark.parametrize(
    "sql",
    [
        "ALTER TABLE messages RENAME TO old; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp "
        "INTEGER, data BLOB AS (zeroblob(900000000))); INSERT INTO messages(topic_id, timestamp) VALUES (1, 1);",
        "DROP TABLE schema; CREATE VIEW schema AS WITH RECURSIVE c(schema_version) AS (SELECT 1 UNION ALL SELECT "
        "schema_version + 1 FROM c) SELECT max(schema_version) AS schema_version FROM c;",
    ],
    ids=["column", "view"],
)
def test_a_table_that_is_computed(tmp_path, sql):
    bombs.computed_table(tmp_path / "x", sql)
    assert "is computed" in taken(tmp_path / "x", lambda p: list(open_recording(p).messages()))


def test_lists_of_images_and_trajectories(tmp_path):
    (tmp_path / "rgb.txt").write_text("0 a\n" * 2_400_000)
    assert "lists more than" in taken(tmp_path, open_recording)
    path = tmp_path.with_name("t.txt")
    path.write_text("1 0 0 0 0 0 0 1\n" * 100_000)
    assert taken(path, read_trajectory) == ""


def test_one_picture_or_piece_for_many(tmp_path):
    checkpoint = Checkpoint(tmp_path)
    checkpoint.write(CheckpointData(file_samples.slam_map(), 1, {}, {}))
    whole = (tmp_path / "map.zip").read_bytes()
    for change, message in ((bombs.same_picture, "the same picture"), (bombs.same_piece, "asks for")):
        (tmp_path / "map.zip").write_bytes(change(whole))
        assert message in taken(tmp_path, lambda _: checkpoint.read())


def worlds(tree):
    far = [[0, 0], [9000, 0], [9000, 9000], [0, 9000]]
    yield "more than", tree | {"outlines": [tree["outlines"][0] | {"points": far, "material": "floor"}]}
    box = {"x": 1, "y": 1, "length": 1, "width": 1, "height": 1, "material": "floor"}
    yield "300000 values", tree | {"boxes": [box] * 25_000}
    wall = {"points": [[1, 1]] * 25_000, "thickness": 0.1, "height": 2, "material": "floor"}
    yield "can be drawn", tree | {"walls": [wall]}
    large = [{**box, "x": 500, "length": 900, "width": 900, "height": 900}] * 3500  # beside the robot
    yield "bytes, at most", tree | {"boxes": large}
    carpets = {f"c{k}": {"kind": "carpet"} for k in range(60)}
    yield "bytes, at most", tree | {
        "materials": tree["materials"] | carpets, "boxes": [{**box, "material": name} for name in carpets]
    }  # fmt: skip


def test_worlds(tmp_path):
    import json

    import msgspec

    from vsx_ros.sim.generate import generate_world

    path = tmp_path / "world.yaml"

    def read(file):
        world = load_world(file)
        ground_truth_grid(world, 0.05, 0.02, 0.45)
        compile_scene(world)

    tree = msgspec.to_builtins(generate_world("corridor", 0))
    for message, changed in worlds(tree):
        path.write_text(json.dumps(changed))
        assert message in taken(path, read)
    save_world(generate_world("building", 1), path)
    assert taken(path, load_world) == ""


def test_a_map_of_noise(tmp_path):
    import cv2

    noise = np.random.default_rng(0).random((4096, 4096)) > 0.1
    cv2.imwrite(str(tmp_path / "noise.png"), noise.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    assert "separate obstacles" in taken(tmp_path / "noise.png", lambda p: world_from_grid(load_plan(p), "noise", 0))


def test_the_command_line(tmp_path, capfd, good_map, gigabyte):
    (tmp_path / "x.vsxmap").write_bytes(bombs.with_entry(good_map, "arrays/more.npy", bombs.GIB, gigabyte))
    (tmp_path / "x.bag").write_bytes(bombs.ros1_bag("bz2"))
    (tmp_path / "x.yaml").write_text("[" * bombs.DEEP)
    (tmp_path / "x.pgm").write_bytes(b"P5 40000 40000 255\n")
    (tmp_path / "m.yaml").write_text(
        "image: x.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nfree_thresh: 0.2\noccupied_thresh: 0.6\nnegate: 0\n"
    )
    (tmp_path / "run").mkdir()
    for name in ("config.yaml", "summary.json"):
        (tmp_path / "run" / name).write_text("[" * bombs.DEEP)
    poses = ["--start", "0,0,0", "--goal", "1,0,0"]
    for words in (
        ["map", "info", "x.vsxmap"], ["map", "export", "x.vsxmap", "--format", "colmap"], ["replay", "x.bag"],
        ["explore", "--fast", "--load-map", "x.vsxmap"], ["explore", "--fast", "--world", "x.yaml"],
        ["explore", "--fast", "--resume", "run"], ["plan", *poses, "--map", "m.yaml"], ["report", "run"],
        ["evaluate", "run"], ["config", "--config", "x.yaml"], ["plan", *poses, "--map", "x.yaml"],
        ["world", "m.yaml", "--out", "w.yaml"], ["world", "x.yaml", "--out", "w.yaml"],
    ):  # fmt: skip
        paths = [str(tmp_path / word) if (tmp_path / word).exists() else word for word in words]
        assert execute(paths) == 1, words
        said = capfd.readouterr().err
        assert said.count("\n") == 1, said
        assert "internal error" not in said
