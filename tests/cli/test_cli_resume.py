"""A run that is killed without warning goes on in the same map."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.cli.main import execute
from vsx_ros.cli.session import Before
from vsx_ros.config import Config
from vsx_ros.io.checkpoint import Checkpoint
from vsx_ros.io.journal import FrameLine, read_journal
from vsx_ros.io.run_folder import RunFolder
from vsx_ros.io.slam_map_file import load_slam_map

SECOND = 1_000_000_000


def start(*words: str) -> subprocess.Popen[bytes]:
    code = f"import sys; sys.path[:0] = {sys.path!r}; from vsx_ros.cli.main import main; main()"
    return subprocess.Popen([sys.executable, "-c", code, "explore", "--fast", *words], stdout=subprocess.DEVNULL)


def kill_at(run: subprocess.Popen[bytes], folder: Path, second: float) -> None:
    """kill -9 as soon as the run's journal has come so far."""
    deadline_s = time.monotonic() + 300.0
    while True:
        frames = [line for line in read_journal(folder / "resume/journal.jsonl") if isinstance(line, FrameLine)]
        if frames and frames[-1].stamp_ns >= second * SECOND:
            break
        assert run.poll() is None, "the run ended before it could be killed"
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    os.kill(run.pid, signal.SIGKILL)
    run.wait()


@pytest.fixture(scope="module")
def resumed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Before]]:
    """A run killed twice, once before it has a map and once on its way, then resumed to its end."""
    out, befores = tmp_path_factory.mktemp("killed") / "run", []
    kill_at(start("--seed", "1", "--time", "40", "--out", str(out)), out, 0.5)
    assert Before.of(RunFolder.open(out)) is None
    kill_at(start("--resume", str(out)), out, 13.0)
    before = Before.of(RunFolder.open(out))
    assert before is not None
    befores.append(before)
    assert execute(["explore", "--fast", "--resume", str(out)]) == 0
    return out, befores


def test_no_more_than_the_last_seconds_are_lost(resumed):
    _, (before,) = resumed
    frames = [line for line in before.lines if isinstance(line, FrameLine)]
    assert before.ended_ns >= 13 * SECOND
    assert before.ended_ns - frames[-1].stamp_ns <= 6 * SECOND
    keyframes = before.memory.slam_map.view.keyframes
    assert len(keyframes) >= 5
    assert keyframes[-1].data.stamp_ns <= frames[-1].stamp_ns


def test_it_goes_on_in_the_same_map_and_ends_as_a_run_does(resumed):
    out, (before,) = resumed
    folder, summary = RunFolder.open(out), json.loads((out / "summary.json").read_text())
    assert summary["stop_reason"] == "time limit of 40 s"
    assert (summary["breaks"], summary["collisions"]) == (0, 0)
    assert summary["relocalizations"] >= 1
    assert summary["keyframes"] >= len(before.memory.slam_map.view.living)
    assert 0.0 < summary["ate_rmse_m"] < 0.05
    assert 0.5 < summary["u1"] <= 1.0
    assert summary["frames"] == len(folder.read_frames()) == len(folder.read_poses("odometry"))
    reasons = [event.reason for event in folder.read_events()]
    assert any("resumed" in reason for reason in reasons)
    estimate = folder.read_poses("trajectory")
    stamps = np.array([pose.stamp_ns for pose in estimate])
    assert (np.diff(stamps) > 0).all()
    assert stamps[0] < 3 * SECOND
    assert stamps[-1] > 39 * SECOND
    saved = Checkpoint(out / "resume").read()
    assert saved.stamp_ns == stamps[-1]
    assert len(saved.slam_map.view.living) == summary["keyframes"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--fast"], "give more with --time"),
        (["--fast", "--seed", "0"], "leave out --seed"),
        (["--fast", "--load-map", "x"], "leave out --load-map"),
        (["--fast", "--time", "5"], "give more with --time"),
    ],
)
def test_what_contradicts_the_run_is_refused(resumed, words, said, capsys):
    out, _ = resumed
    assert execute(["explore", "--resume", str(out), *words]) == 1
    assert said in capsys.readouterr().err


def test_a_damaged_checkpoint_is_told(resumed, capsys):
    out, _ = resumed
    path = out / "resume" / "map.zip"
    content = path.read_bytes()
    try:
        path.write_bytes(content[:-100])
        assert execute(["explore", "--fast", "--resume", str(out), "--time", "60"]) == 1
    finally:
        path.write_bytes(content)
    assert "checksum" in capsys.readouterr().err


def test_pictures_are_written_once_and_go_with_their_keyframe(resumed):
    out, _ = resumed
    checkpoint = Checkpoint(out / "resume")
    saved, folder = checkpoint.read(), out / "resume" / "keyframes"
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert len(before) == len(saved.slam_map.view.living)
    (folder / "000099_1.png").touch()
    checkpoint.write(saved)
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before


def test_its_map_can_be_saved_and_gone_on_in_by_another_run(resumed, tmp_path, capsys):
    out, _ = resumed
    path = tmp_path / "lab.vsxmap"
    assert execute(["map", "save", str(out), "--out", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    known = load_slam_map(path).view
    other = tmp_path / "other"
    words = ["--fast", "--seed", "1", "--time", "3", "--out", str(other)]
    assert execute(["map", "load", str(path), *words]) == 0
    summary = json.loads((other / "summary.json").read_text())
    assert summary["continued_map"] == str(path)
    assert summary["keyframes"] >= len(known.living) - 1
    assert summary["frames_tracked"] > 40
    assert summary["coverage"] is None
    command = RunFolder.open(other).read_config()[1]["command"]
    assert command == f"vsx explore --fast --load-map {path} --seed 1 --time 3.0 --out {other}"
    assert execute(["map", "save", str(tmp_path)]) == 1
    assert "is not a run folder" in capsys.readouterr().err


def test_a_mistake_leaves_an_earlier_run_alone(resumed, capsys):
    out, _ = resumed
    before = (out / "summary.json").read_bytes()
    mistakes = ["--world moon", "--load-map none.vsxmap", "--set planner.phi_rad_m=-1", "--port /dev/kobuki"]
    for words in mistakes:
        assert execute(["explore", "--fast", *words.split(), "--out", str(out)]) == 1
    assert capsys.readouterr().err.count("\n") == len(mistakes)
    assert (out / "summary.json").read_bytes() == before


@pytest.mark.parametrize(
    "words", ["--fast --base create", "--fast --port /dev/x", "--world lab --port /dev/x", "--world lab --camera v4l:0"]
)
def test_an_emulated_robot_has_no_wires_to_choose(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert execute(["explore", *words.split()]) == 1
    assert "has no meaning for the robot" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_replay_cannot_be_resumed(tmp_path, capsys):
    RunFolder.create(tmp_path).write_config(Config(), ["vsx", "replay"], seed=0)
    assert execute(["explore", "--fast", "--resume", str(tmp_path)]) == 1
    assert "no run of 'vsx explore'" in capsys.readouterr().err
