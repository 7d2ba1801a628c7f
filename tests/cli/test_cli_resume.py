"""A run that is killed without warning goes on in the same map."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from waiting import wait_for

from vsx_ros.cli.main import execute
from vsx_ros.errors import MapFileError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.io.zone_file import zone_file
from vsx_ros.runs.checkpoint import Checkpoint
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.interrupted import REASON
from vsx_ros.runs.journal import FrameLine, Journal, read_journal
from vsx_ros.runs.moments import Moments
from vsx_ros.runs.previous import PreviousSessions

SECOND = 1_000_000_000


def start(*words: str) -> subprocess.Popen[bytes]:
    code = f"import sys; sys.path[:0] = {sys.path!r}; from vsx_ros.cli.main import main; main()"
    return subprocess.Popen([sys.executable, "-c", code, "explore", "--fast", *words], stdout=subprocess.DEVNULL)


def kill_at(run: subprocess.Popen[bytes], folder: Path, second: float) -> None:
    """kill -9 as soon as the run's journal has come so far."""

    def is_there() -> bool:
        assert run.poll() is None, "the run ended before it could be killed"
        frames = [line for line in read_journal(folder / "resume/journal.jsonl") if isinstance(line, FrameLine)]
        return bool(frames) and frames[-1].stamp_ns >= second * SECOND

    wait_for(is_there, f"second {second}")
    os.kill(run.pid, signal.SIGKILL)
    run.wait()


@pytest.fixture(scope="module")
def resumed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[PreviousSessions]]:
    """A run killed twice, once before it has a map and once on its way, then resumed to its end."""
    out, befores = tmp_path_factory.mktemp("killed") / "run", []
    kill_at(start("--seed", "1", "--time", "40", "--out", str(out)), out, 0.5)
    assert PreviousSessions.of(RunFolder.open(out)) is None
    kill_at(start("--resume", str(out)), out, 13.0)
    before = PreviousSessions.of(RunFolder.open(out))
    assert before is not None
    befores.append(before)
    shutil.copytree(out, out.with_name("killed"))
    assert execute(["report", str(out)]) == 0
    assert REASON in (out / "report.html").read_text()
    second = before.ended_ns // SECOND  # 13, or later where it was killed late
    assert second <= len(Moments.read(out / "moments.jsonl").pictures) <= second + 3
    assert execute(["explore", "--fast", "--resume", str(out)]) == 0
    return out, befores


def test_no_more_than_the_last_seconds_are_lost(resumed):
    _, (before,) = resumed
    frames = [line for line in before.lines if isinstance(line, FrameLine)]
    assert before.ended_ns >= 13 * SECOND
    assert before.ended_ns - frames[-1].stamp_ns <= 6 * SECOND
    keyframes = before.saved.slam_map.view.keyframes
    assert len(keyframes) >= 5
    assert keyframes[-1].data.stamp_ns <= frames[-1].stamp_ns


def test_its_report_shows_every_second_of_all_sessions(resumed):
    out, (before,) = resumed
    kept, second = Moments.read(out / "moments.jsonl"), before.ended_ns // SECOND
    seconds = [line.stamp_ns // SECOND for line in kept.pictures]
    assert seconds == sorted(seconds)
    assert set(range(40)) - set(seconds) <= {0, second, second + 1}, "the second in which it was killed"
    assert len(kept.maps) in range(20, 45)
    page = (out / "report.html").read_text()
    assert REASON not in page
    assert "Second by second" in page


def test_what_became_known_is_told_of_all_sessions(resumed):
    out, _ = resumed
    summary = json.loads((out / "summary.json").read_text())
    with (out / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    seconds, metres, areas = (
        np.array([float(row[name]) for row in rows]) for name in ("elapsed_s", "driven_m", "known_area_m2")
    )
    assert seconds[0] == 0.0
    assert seconds[-1] == pytest.approx(40.0, abs=0.2)
    assert (np.diff(seconds) < 4.0).all()
    assert (np.diff(metres) >= 0.0).all()
    assert 1.0 < metres[-1] < 12.0
    assert areas[-1] > 5.0 * areas[0] > 0.0
    assert float(rows[-1]["coverage_correct"]) == pytest.approx(summary["coverage_correct"], abs=1e-5)
    page = (out / "report.html").read_text()
    assert "<h2>Known area</h2>" in page
    assert page.count('<g class="goal">') >= 2


def test_it_goes_on_in_the_same_map_and_ends_as_a_run_does(resumed):
    out, (before,) = resumed
    folder, summary = RunFolder.open(out), json.loads((out / "summary.json").read_text())
    assert summary["stop_reason"] == "time limit of 40 s"
    assert (summary["breaks"], summary["collisions"]) == (0, 0)
    assert summary["relocalizations"] >= 1
    assert summary["keyframes"] >= len(before.saved.slam_map.view.living)
    assert 0.0 < summary["ate_rmse_m"] < 0.05
    assert 0.5 < summary["u1"] <= 1.0
    assert summary["frames"] == len(folder.read_frames()) == len(folder.read_poses("odometry"))
    reasons = [event.reason for event in folder.read_events()]
    assert any("resumed" in reason for reason in reasons)
    assert reasons[-1] == "time limit of 40 s"
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
        (["--fast", "--moved"], "stands where it stood; leave out --moved"),
        (["--fast", "--rate", "10"], "--rate 10 has no meaning for the robot of"),
        (["--port", "/dev/x"], "was made with --fast"),
    ],
)
def test_what_contradicts_the_run_is_refused(resumed, words, said, capsys):
    out, _ = resumed
    assert execute(["explore", "--resume", str(out), *words]) == 1
    assert said in capsys.readouterr().err


def test_a_resume_that_fails_leaves_the_robot_where_it_stood(resumed, tmp_path, capsys):
    out, _ = resumed
    folder = RunFolder.open(shutil.copytree(out.with_name("killed"), tmp_path / "run"))
    journal = folder.journal.read_bytes()
    zone_file(folder.path / "map.yaml").write_text("zones: 3\n")
    assert execute(["explore", "--fast", "--resume", str(folder.path)]) == 1
    assert "map_zones.yaml" in capsys.readouterr().err
    assert folder.journal.read_bytes() == journal


def test_a_robot_stands_where_it_stood_also_after_a_session_that_was_killed_at_once(resumed, tmp_path):
    """Such a session has rewound the journal to the checkpoint, and has written no newer one."""
    out, (before,) = resumed
    folder = RunFolder.open(shutil.copytree(out.with_name("killed"), tmp_path / "run"))
    assert before.ended_ns > before.saved.stamp_ns
    Journal(folder.journal, before.lines)
    again = PreviousSessions.of(folder)
    assert again.lines == before.lines
    assert (again.ended_ns, again.T_odom_base, again.truth) == (before.ended_ns, before.T_odom_base, before.truth)
    assert again.system.mission.trail == before.system.mission.trail


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


def test_what_never_changes_is_written_once_and_goes_with_its_keyframe(resumed):
    out, _ = resumed
    checkpoint = Checkpoint(out / "resume")
    saved, folders = checkpoint.read(), [out / "resume" / name for name in ("keyframes", "pieces")]
    before = {path: path.stat().st_mtime_ns for folder in folders for path in folder.iterdir()}
    assert len(list(folders[0].iterdir())) == len(saved.slam_map.view.living)
    for folder, name in zip(folders, ("000099_1.png", "0123.npy")):
        (folder / name).touch()
    checkpoint.write(saved)
    assert {path: path.stat().st_mtime_ns for folder in folders for path in folder.iterdir()} == before
    assert sum(path.stat().st_size for path in before) > 2 * (out / "resume" / "map.zip").stat().st_size


def test_a_damaged_piece_of_the_map_is_told(resumed, tmp_path):
    out, _ = resumed
    shutil.copytree(out / "resume", tmp_path / "resume")
    checkpoint = Checkpoint(tmp_path / "resume")
    checkpoint.read()
    piece = next((tmp_path / "resume" / "pieces").iterdir())
    piece.write_bytes(piece.read_bytes()[:-1])
    with pytest.raises(MapFileError, match=f"piece {piece.name} was changed"):
        checkpoint.read()
    piece.unlink()
    with pytest.raises(MapFileError, match="cannot be read"):
        checkpoint.read()


def test_the_journal_is_on_the_disk_before_the_map_that_needs_it(resumed, monkeypatch):
    out, _ = resumed
    checkpoint, names, sync = Checkpoint(out / "resume"), [], os.fsync
    saved = checkpoint.read()

    def watched(descriptor):
        names.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    checkpoint.write(saved)
    assert names.index("journal.jsonl") < names.index(".map.zip.part") < names.index("resume")
    names.clear()
    checkpoint.write_mission(saved.mission, saved.stamp_ns)
    (checkpoint.path / "mission.json").unlink()
    assert ".mission.json.part" in names


def test_a_journal_that_ends_seconds_before_the_map_is_gone_on_with(resumed, tmp_path):
    out, _ = resumed
    cut = tmp_path / "cut"
    shutil.copytree(out, cut)
    folder = RunFolder.open(cut)
    lines, saved = folder.journal.read_bytes().splitlines(keepends=True), folder.checkpoint.read()
    frames = [line for line in read_journal(folder.journal) if isinstance(line, FrameLine)]
    last = frames[-45]
    assert saved.stamp_ns - last.stamp_ns > 2 * SECOND
    end = next(i for i, line in enumerate(lines) if f'"stamp_ns":{last.stamp_ns}'.encode() in line and b"truth" in line)
    folder.journal.write_bytes(b"".join(lines[: end + 1]) + b'{"type":"fra')
    before = PreviousSessions.of(folder)
    assert before.ended_ns == saved.stamp_ns
    assert before.T_odom_base == SE2(*last.T_odom_base)
    assert before.truth.stamp_ns == last.stamp_ns
    assert saved.mission["trail"]
    assert before.system.mission.trail == [], "the robot stands before the end of its trail"
    assert execute(["explore", "--fast", "--resume", str(cut), "--time", "42"]) == 0
    assert folder.read_frames()[-1].stamp_ns > 41 * SECOND


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
    assert command == f"vsx map load {path} --fast --seed 1 --time 3 --out {other}"
    path.unlink()  # what became of it is in the run's own folder
    assert execute(["explore", "--fast", "--resume", str(other), "--time", "4"]) == 0
    assert json.loads((other / "summary.json").read_text())["coverage"] is None
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
