"""A folder belongs to one run at a time."""

import errno
import fcntl
import signal
import subprocess
import sys

import pytest

from vsx_ros.cli.main import execute, parse
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.hold import hold
from vsx_ros.runs.journal import Journal, RunEvent, read_journal
from vsx_ros.runs.start import begin

HOLDER = """
import sys, time
from pathlib import Path
from vsx_ros.runs.hold import hold
held = hold(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(600)
"""
EVENT = RunEvent(1, "slam", "GOOD", "first map")


@pytest.fixture
def run(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["vsx", "explore"], fast=False, world=None, base="kobuki")
    Journal(folder.journal).add(EVENT)
    return folder


def files(folder):
    return {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}


def test_a_second_run_is_refused_and_the_first_one_s_files_stay(run, capsys):
    before = files(run)
    resumed, anew = ["explore", "--resume", str(run.path)], ["explore", "--fast", "--out", str(run.path)]
    with hold(run.path):
        with pytest.raises(InputError, match=f"a run still works in {run.path}; end that first"):
            RunFolder.create(run.path)
        for words in (resumed, anew):
            with pytest.raises(InputError, match="still works"), begin(parse(words)):
                pass
        assert execute(["report", str(run.path)]) == 0, "readers are free"
    assert {path: content for path, content in files(run).items() if path in before} == before
    assert capsys.readouterr().err == ""
    with begin(parse(resumed)), pytest.raises(InputError, match="still works"):
        RunFolder.create(run.path)
    with begin(parse(anew)), pytest.raises(InputError, match="still works"), begin(parse([*resumed, "--fast"])):
        pass
    assert read_journal(run.journal) == []


def test_a_run_that_was_killed_holds_nothing(run):
    code = f"import sys; sys.path[:0] = {sys.path!r}{HOLDER}"
    with subprocess.Popen([sys.executable, "-c", code, str(run.path)], stdout=subprocess.PIPE) as holder:
        try:
            assert holder.stdout.readline() == b"held\n"
            with pytest.raises(InputError, match="still works"):
                hold(run.path)
        finally:
            holder.send_signal(signal.SIGKILL)
    hold(run.path).close()


def test_what_a_run_has_started_holds_nothing(run):
    with hold(run.path):
        child = subprocess.Popen(["sleep", "600"], close_fds=False)
    try:
        hold(run.path).close()
    finally:
        child.kill()
        child.wait()


@pytest.mark.parametrize("number", [errno.ENOTSUP, errno.ENOLCK])
def test_a_file_system_without_locks_keeps_nobody_from_exploring(run, monkeypatch, number):
    def flock(*_):
        raise OSError(number, "no locks")

    monkeypatch.setattr(fcntl, "flock", flock)
    with hold(run.path), hold(run.path):
        pass
