"""A run in lock-step on a disk that takes no more goes on to its end, and keeps what there is room for."""

import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from waiting import PATIENCE_S

from vsx_ros.cli.main import execute
from vsx_ros.runs import lockstep
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import read_journal

LIMIT = 60_000
"""Bytes: of a file in one of the tests; of the whole disk in the other, whose pages and logs need some more."""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={4 * LIMIT}", "tmpfs", str(place)]
    if (
        shutil.which("mount") is None
        or subprocess.run(["mount", *options], capture_output=True, check=False).returncode
    ):
        pytest.skip("mounting a small disk is not permitted; the test with a limit on the size of files says the same")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def explore(out: Path, prepare: Callable[[], None] | None = None) -> subprocess.CompletedProcess[str]:
    code = f"import sys; sys.path[:0] = {sys.path!r}; from vsx_ros.cli.main import main; main()"
    words = ["explore", "--fast", "--seed", "1", "--time", "12", "--out", str(out)]
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        preexec_fn=prepare,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def is_told_and_whole(done: subprocess.CompletedProcess[str], out: Path) -> None:
    assert done.stdout.startswith("time limit of 12 s\n"), done.stderr
    assert "tracked" in done.stdout
    first, last = done.stderr.splitlines()
    assert "cannot be written" in first
    assert first.endswith("the run goes on")
    assert last.startswith("vsx: not all of the run is kept: ")
    assert done.returncode == 1
    assert read_journal(RunFolder(out).journal)
    assert RunFolder(out).journal.read_bytes().endswith(b"\n")
    assert not list(out.rglob(".*.part"))


def test_files_that_may_not_grow_cost_what_does_not_fit(tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = explore(out, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)))
    is_told_and_whole(done, out)
    assert "File too large" in done.stderr
    folder = RunFolder.open(out)
    assert folder.read_summary()["stop_reason"] == "time limit of 12 s"
    assert folder.read_summary()["frames_tracked"] > 0
    assert folder.read_map() is not None
    assert folder.read_frames()


def test_a_full_disk_costs_what_does_not_fit(small_disk: Path) -> None:
    done = explore(small_disk / "run")
    is_told_and_whole(done, small_disk / "run")
    assert "No space left on device" in done.stderr


def test_a_run_folder_that_was_deleted_is_made_anew(tmp_path: Path, monkeypatch, capsys) -> None:
    out = tmp_path / "run"
    step = lockstep.FastRun._step

    def step_and_delete(run, frame, odometry):
        if len(run.record.frames) == 20:
            shutil.rmtree(out)
        return step(run, frame, odometry)

    monkeypatch.setattr(lockstep.FastRun, "_step", step_and_delete)
    assert execute(["explore", "--fast", "--seed", "1", "--time", "2", "--out", str(out)]) == 1
    assert "config.yaml cannot be read (No such file or directory)" in capsys.readouterr().err
    folder = RunFolder.open(out)
    assert folder.read_summary()["stop_reason"] == "time limit of 2 s"
    assert folder.read_frames()
