import json

import numpy as np
import pytest

from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.evaluation.summary import Summary, with_accuracy
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose, so3_exp
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.robot import Odometry
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, TruthLine, flat
from vsx_ros.slam.state import TrackingResult, TrackingState


@pytest.fixture
def walk():
    positions = np.cumsum(np.random.default_rng(1).normal(0, 0.1, (30, 3)), axis=0)
    return [StampedPose(i * 10**8, SE3(np.eye(3), p)) for i, p in enumerate(positions)]


@pytest.fixture
def half(walk):
    return [StampedPose(s, SE3(T.rotation, 0.5 * T.translation)) for s, T in walk]


def numbers(capsys, *line):
    assert execute(["evaluate", *map(str, line), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_two_files(tmp_path, walk, half, capsys):
    write_trajectory(tmp_path / "e.txt", half)
    write_trajectory(tmp_path / "t.txt", walk)
    files = "--estimate", tmp_path / "e.txt", "--truth", tmp_path / "t.txt"
    strict, lenient = numbers(capsys, *files), numbers(capsys, *files, "--align", "sim3")
    assert strict["ate_rmse_m"] > 0.05
    assert lenient["ate_rmse_m"] < 1e-6
    assert strict["scale"] == pytest.approx(2.0)
    assert strict["pairs"] == 30


def test_a_run_adds_what_its_summary_knows(tmp_path, walk, half, capsys):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx"])
    folder.write_summary(Summary(u1=0.9, breaks=2).as_dict())
    folder.write_poses("trajectory", half)
    folder.write_poses("odometry", half)
    assert numbers(capsys, folder.path)["u1"] == 0.9
    folder.write_poses("groundtruth", walk)
    both = numbers(capsys, folder.path)
    assert (both["breaks"], both["coverage"]) == (2, None)
    assert both["scale_error"] == pytest.approx(0.5)
    assert both["ate_of"] == "live poses (trajectory.txt)"
    assert "ate_final_rmse_m" not in both, "a run of an older version"
    folder.write_poses("trajectory_final", walk)
    assert numbers(capsys, folder.path)["ate_final_rmse_m"] < 1e-6 < both["ate_rmse_m"]


@pytest.mark.parametrize(("odometry", "kind"), [(True, "yaw"), (False, None)])
def test_a_run_is_compared_as_in_its_summary(tmp_path, walk, odometry, kind, capsys):
    """The estimate is tilted, so that each kind of alignment gives another number."""
    tilt = SE3(so3_exp(np.array([0.0, 0.2, 0.5])), np.zeros(3))
    poses = [StampedPose(s, SE3(T.rotation, 0.9 * T.translation)) for s, T in walk]
    poses = [StampedPose(s, tilt @ T) for s, T in poses]
    summary = with_accuracy(Summary(), poses, poses, walk, kind)
    folder = RunFolder.create(tmp_path / "run")
    folder.write_summary(summary.as_dict())
    for name, of in {"trajectory": poses, "trajectory_final": poses, "groundtruth": walk}.items():
        folder.write_poses(name, of)
    if odometry:
        folder.write_poses("odometry", poses)
    both = numbers(capsys, folder.path)
    assert both["aligned_by"] == (kind or "sim3")
    assert both["scale_error"] == (None if kind is None else pytest.approx(summary.scale_error, abs=1e-5))
    assert (both["scale"] is None) == (kind is None)
    error_m = summary.ate_rmse_sim3_m if kind is None else summary.ate_rmse_m
    assert both["ate_rmse_m"] == pytest.approx(error_m, abs=1e-6)
    assert both["ate_final_rmse_m"] == pytest.approx(error_m, abs=1e-6)
    if odometry:
        assert numbers(capsys, folder.path, "--align", "se3")["ate_rmse_m"] < 0.9 * error_m


def test_a_resumed_run_that_was_killed_gives_what_its_journals_know(tmp_path, walk, capsys):
    """Its files are of the first session, of five frames."""
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx"])
    folder.write_summary(Summary(frames=5, u1=0.9).as_dict())
    for name in ("trajectory", "groundtruth", "odometry"):
        folder.write_poses(name, walk[:5])
    good = TrackingState.GOOD
    lines = [
        FrameLine.of(TrackingResult(s, good, T, 100, 90), Odometry(s, SE2(0.1 * k, 0.0, 0.0)), 5.0, None)
        for k, (s, T) in enumerate(walk)
    ]
    Journal(folder.journal).add(*lines)
    Journal(folder.witness).add(*(TruthLine(s, flat(T), (0.0, 0.0, 0.0), 0) for s, T in walk))
    assert execute(["evaluate", str(folder.path), "--json"]) == 0
    said = capsys.readouterr()
    known = json.loads(said.out)
    assert (known["frames"], known["pairs"], known["u1"]) == (30, 30, None)
    assert "the run has not come to its end" in said.err


@pytest.mark.parametrize("tracked", [0, 1, 2])
def test_a_run_with_too_few_poses_for_an_error_gives_the_rest(tmp_path, walk, tracked, capsys):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_summary(Summary(u1=0.25).as_dict())
    for name, of in {"trajectory": walk[:tracked], "trajectory_final": walk[:tracked], "groundtruth": walk}.items():
        folder.write_poses(name, of)
    assert execute(["evaluate", str(folder.path), "--json"]) == 0
    said = capsys.readouterr()
    known = json.loads(said.out)
    assert known["u1"] == 0.25
    assert "ate_rmse_m" not in known
    reason = f"only {tracked} of {tracked} estimated poses" if tracked else f"run {folder.path} holds no trajectory"
    assert f"its accuracy is unknown: {reason}" in said.err
    assert "clock" not in said.err
    assert execute(["evaluate", str(folder.path), "--truth", str(folder.path / "groundtruth.txt")]) == 1, "it is asked"


def test_the_table_says_unknown(tmp_path, capsys):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_summary(Summary(u1=0.25).as_dict())
    assert execute(["evaluate", str(folder.path)]) == 0
    table = capsys.readouterr().out
    assert "coverage                 unknown" in table
    assert "u1                       0.25" in table


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ([], "either a run folder or --estimate"),
        (["--estimate", "e.txt"], "--truth"),
        (["absent"], "not a run folder"),
        (["--estimate", "absent.txt", "--truth", "t.txt"], "absent.txt"),
    ],
)
def test_wrong_questions_are_one_sentence(line, message, capsys):
    assert execute(["evaluate", *line]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
