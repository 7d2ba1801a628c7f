import json

import numpy as np
import pytest

from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.evaluation.summary import Summary
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.runs.folder import RunFolder


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
    assert numbers(capsys, folder.path)["u1"] == 0.9
    folder.write_poses("groundtruth", walk)
    both = numbers(capsys, folder.path)
    assert (both["breaks"], both["coverage"]) == (2, None)
    assert both["scale_error"] == pytest.approx(0.5)
    assert both["ate_of"] == "live poses (trajectory.txt)"
    assert "ate_final_rmse_m" not in both, "a run of an older version"
    folder.write_poses("trajectory_final", walk)
    assert numbers(capsys, folder.path)["ate_final_rmse_m"] < 1e-6 < both["ate_rmse_m"]


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
