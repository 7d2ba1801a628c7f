"""What a program says never fails it: on a full disk, to a reader who has gone, or with nowhere to say it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

FULL = "/dev/full"
CHECKOUT = Path(__file__).resolve().parents[2]
TALKER = """
import logging, sys, traceback
from vsx_ros.runs import process

process.never_fail()
logging.basicConfig(filename=sys.argv[1], level=logging.INFO)
for _ in range(2):
    print("words")
    sys.stderr.write("words\\n")
    logging.error("words")
    try:
        [][0]
    except IndexError:
        traceback.print_exc()
sys.exit(process.ended(int(sys.argv[2])))
"""


def python(*words: str, **streams: object) -> subprocess.CompletedProcess[str]:
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.run(
        [sys.executable, *words], env={**os.environ, **path}, text=True, timeout=PATIENCE_S, check=False, **streams
    )


def talker(log: str, code: int, **streams: object) -> subprocess.CompletedProcess[str]:
    return python("-c", TALKER, log, str(code), **streams)


@pytest.mark.parametrize("code", [0, 3])
def test_on_a_full_disk_words_are_lost_and_the_exit_code_is_not(code: int) -> None:
    with Path(FULL).open("w") as full:
        assert talker(FULL, code, stdout=full, stderr=full).returncode == (code or 1)
        said = talker(FULL, code, stdout=full, stderr=subprocess.PIPE)
    assert said.returncode == (code or 1)
    assert said.stderr.splitlines()[-1].startswith("vsx: standard output cannot be used (No space left on device)")
    assert "Logging error" not in said.stderr


def test_a_reader_who_has_gone_is_no_failure(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    said = talker(str(tmp_path / "log"), 0, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (said.returncode, "vsx:" in said.stderr) == (0, False)


def test_with_nowhere_to_speak_no_other_file_is_written_into(tmp_path: Path) -> None:
    def close_both() -> None:
        os.close(1)
        os.close(2)

    log = tmp_path / "log"
    assert talker(str(log), 0, preexec_fn=close_both).returncode == 0
    assert log.read_text().splitlines() == ["ERROR:root:words"] * 2


def test_a_command_whose_words_a_full_disk_did_not_take_says_so_and_fails() -> None:
    with Path(FULL).open("w") as full:
        said = python("-m", "vsx_ros.cli.main", "config", stdout=full, stderr=subprocess.PIPE)
    assert said.returncode == 1
    assert said.stderr.startswith("vsx: standard output cannot be used (No space left on device); free some space")
    assert len(said.stderr.splitlines()) == 1


def test_a_mistake_that_nobody_can_be_told_has_its_exit_code() -> None:
    with Path(FULL).open("w") as full:
        assert python("-m", "vsx_ros.cli.main", "world", "moon", stdout=full, stderr=full).returncode == 1


BUSY = """
import atexit, threading
import cv2, numpy as np

def encode():
    image = np.zeros((240, 320, 3), np.uint8)
    while True:
        cv2.imencode(".png", image)

def main():
    threading.Thread(target=encode, daemon=True).start()
    threading.Timer(0.2, print, ["waited for"]).start()
    atexit.register(print, "last")
    print("done")
"""


@pytest.mark.parametrize(
    "entry",
    [
        "import busy; from vsx_ros.runs import process; busy.main(); process.leave(0)",
        f"import sys; sys.path.append({str(CHECKOUT / 'scripts')!r}); import boot; boot.into('busy')",
    ],
)
def test_a_thread_that_is_in_opencv_at_the_end_changes_no_exit_code(tmp_path: Path, entry: str) -> None:
    (tmp_path / "busy.py").write_text(BUSY)
    (tmp_path / "node").write_text(entry)
    ended = python(str(tmp_path / "node"), stdout=subprocess.PIPE)
    assert (ended.returncode, ended.stdout.split("\n")) == (0, ["done", "waited for", "last", ""])
