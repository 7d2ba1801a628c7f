"""Real pictures that ship with the project: a corridor of white walls, five noisy images a second, odometry of a drone
that is dead reckoning and knows no tilt. See tests/data/mononav_hallway/SOURCE.md."""

import math
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.cli.main import execute
from vsx_ros.evaluation.trajectory import align
from vsx_ros.runs.folder import RunFolder

HALLWAY = Path(__file__).parents[1] / "data/mononav_hallway"
MOUNT = ["--set", "robot.mount.height_m=1.04", "--set", "robot.mount.forward_m=0"]
STRAIGHTS_S = ((0.0, 7.4), (11.1, 18.0))  # before and after the turn, where pictures and odometry have gaps
FREE, OCCUPIED = 0, 100


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("hallway") / "run"
    files = [str(HALLWAY / "hallway.bag"), "--calibration", str(HALLWAY / "camera.json")]
    assert execute(["replay", *files, *MOUNT, "--map", "--out", str(out)]) == 0
    return RunFolder.open(out)


def test_the_corridor_is_tracked_to_its_end(run):
    summary = run.read_summary()
    before = sum(frame.state == "not initialised" for frame in run.read_frames())
    assert summary["frames"] == 91
    assert before <= 12
    assert summary["frames_tracked"] >= 0.9 * (91 - before)
    assert (summary["breaks"], summary["odometry_jumps"]) == (0, 0), "the drone banks, which is no jump"
    assert 0.4 < summary["u1"] < 1.0
    assert summary["ate_rmse_m"] is None, "there is no truth"


@pytest.mark.parametrize("trajectory", ["trajectory", "trajectory_final"])
def test_the_way_is_that_of_the_odometry_where_it_does_not_jump(run, trajectory):
    poses = run.read_poses(trajectory)
    stamps_s = np.array([pose.stamp_ns for pose in poses]) * 1e-9 - 100.0
    seen = np.array([pose.T.translation for pose in poses])
    odometry = run.read_poses("odometry")
    known_s = np.array([pose.stamp_ns for pose in odometry]) * 1e-9 - 100.0
    positions = np.array([pose.T.translation for pose in odometry])
    told = np.stack([np.interp(stamps_s, known_s, positions[:, axis]) for axis in range(3)], axis=1)
    for begin_s, end_s in STRAIGHTS_S:
        here = (stamps_s >= begin_s) & (stamps_s < end_s)
        flat = seen[here] * [1.0, 1.0, 0.0]
        off = np.linalg.norm(align(flat, told[here], "yaw").apply(flat) - told[here], axis=1)
        assert math.sqrt(np.mean(off**2)) < 0.08
        way, length = (np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (flat, told[here]))
        assert way == pytest.approx(length, rel=0.08)


def test_the_corridor_is_free_on_the_map_and_nothing_stands_in_the_way(run):
    grid = run.read_map()
    cells = grid.data
    assert np.count_nonzero(cells == OCCUPIED) > 30
    for pose in run.read_poses("trajectory"):
        column, row = np.floor((pose.T.translation[:2] - [grid.origin_x, grid.origin_y]) / grid.resolution).astype(int)
        assert (cells[row - 3 : row + 4, column - 3 : column + 4] != OCCUPIED).all()
        assert cells[row, column] == FREE
