import json

import numpy as np
import pytest

from vsx_ros.config import Config, overridden
from vsx_ros.errors import InputError, VsxError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.map_export import read_ply, write_ply
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.folder import FILES, FrameRecord, RunFolder
from vsx_ros.runs.journal import RunEvent
from vsx_ros.runs.world import save_world
from vsx_ros.sim.generate import generate_world


@pytest.fixture
def run(tmp_path):
    folder = RunFolder.create(tmp_path / "runs" / "one")
    folder.write_config(overridden(Config(), {"planner.phi_rad_m": 0.5}), ["vsx", "replay", "x"], seed=3)
    return folder


def test_everything_written_is_read_back(run):
    poses = [StampedPose(i * 10**8, SE3(np.eye(3), np.array([i, 0.5, 0.0]))) for i in range(3)]
    frames = [FrameRecord(5, "good", 10, 9, True, 1.25, 4.5), FrameRecord(7 * 10**18, "lost", 0, 0, False, None)]
    grid = OccupancyGrid(np.array([[0, -1, 100]]), 0.05, 0.0, 0.0)
    run.write_poses("trajectory", poses)
    run.write_frames(frames)
    run.write_map(grid)
    write_ply(run.path / "sparse.ply", np.eye(3))
    run.write_summary({"frames": 3, "u1": None})
    again = RunFolder.open(run.path)
    config, facts = again.read_config()
    assert config.planner.phi_rad_m == 0.5
    assert (facts["seed"], facts["command"]) == (3, "vsx replay x")
    assert facts["versions"]["numpy"] == np.__version__
    assert [p.stamp_ns for p in again.read_poses("trajectory")] == [0, 10**8, 2 * 10**8]
    assert again.read_frames() == frames
    assert np.array_equal(again.read_map().data, grid.data)
    assert np.array_equal(read_ply(again.path / "sparse.ply"), np.eye(3))
    assert again.read_summary() == {"frames": 3, "u1": None}


def test_frames_of_an_older_version_are_read(run):
    head = "stamp_s,state,searched,found,keyframe_added,track_ms\n"
    (run.path / "frames.csv").write_text(head + "1.000000000,good,10,9,1,1.25\n")
    assert run.read_frames() == [FrameRecord(10**9, "good", 10, 9, True, 1.25, None)]


def test_what_was_never_written_is_absent(run):
    assert (run.read_poses("groundtruth"), run.read_frames(), run.read_events()) == ([], [], [])
    assert run.read_map() is None
    assert not (run.path / "sparse.ply").exists()


def test_events_are_ordered_by_time(run):
    run.write_events([RunEvent(9, "slam", "lost", 'a "blank" wall'), RunEvent(2, "mission", "starting", "begin")])
    assert [e.stamp_ns for e in run.read_events()] == [2, 9]
    lines = (run.path / "events.jsonl").read_text().splitlines()
    assert json.loads(lines[1])["reason"] == 'a "blank" wall'


def test_a_second_run_leaves_nothing_of_the_first(run):
    run.write_summary({"frames": 1})
    write_ply(run.path / "sparse.ply", np.eye(3))
    save_dock(SE2(1.0, 2.0, 0.5), dock_file(run.path / "map.yaml"))
    save_world(generate_world("lab", 1), run.path / "world.yaml")
    again = RunFolder.create(run.path)
    assert load_dock(dock_file(again.path / "map.yaml")) is None
    assert not (again.path / "world.yaml").exists()
    assert not any((again.path / name).exists() for name in FILES)


def test_other_folders_are_not_touched(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="not a run folder"):
        RunFolder.create(tmp_path)
    with pytest.raises(InputError, match="not a run folder"):
        RunFolder.open(tmp_path)
    with pytest.raises(InputError, match="not a run folder"):
        RunFolder.create(tmp_path / "thesis.txt")


@pytest.mark.parametrize("name", ["config.yaml", "summary.json"])
def test_files_of_others_with_the_same_names_are_not_deleted(tmp_path, name):
    files = [tmp_path / each for each in (name, "map.pgm", "map.yaml", "world.yaml", "report.html")]
    for file in files:
        file.write_text("robot: {radius_m: 0.2}")
    with pytest.raises(InputError, match="not a run folder"):
        RunFolder.create(tmp_path)
    assert all(file.exists() for file in files)


@pytest.mark.parametrize(
    ("name", "content", "read"),
    [
        ("summary.json", "{", "read_summary"),
        ("summary.json", "[]", "read_summary"),
        ("config.yaml", "a: [", "read_config"),
        ("config.yaml", "config: {slam: 3}", "read_config"),
        ("events.jsonl", '{"stamp_ns": 1}\n', "read_events"),
        ("frames.csv", "h\n1,2,3\n", "read_frames"),
        ("frames.csv", "h\n1.0,good,10,9,1,1.25,4.5,6\n", "read_frames"),
    ],
)
def test_damaged_files_are_named(run, name, content, read):
    (run.path / name).write_text(content)
    with pytest.raises(VsxError, match=r"config|summary|events|frames") as caught:
        getattr(run, read)()
    assert "\n" not in str(caught.value)


def test_a_number_that_json_lacks_is_not_written(run):
    with pytest.raises(ValueError):
        run.write_summary({"u1": float("nan")})
    assert not (run.path / "summary.json").exists()
