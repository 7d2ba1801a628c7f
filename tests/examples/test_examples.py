"""The examples as a reader starts them: short, and they do what they say."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ros.drive_bag import write_drive
from waiting import PATIENCE_S

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run(name, *words):
    shell = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, str(EXAMPLES / name), *map(str, words)]
    done = subprocess.run(command, env=shell, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.name)
def test_examples_are_short_and_say_how_they_are_started(file):
    text = file.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 40
    assert f"python examples/{file.name}" in text


def test_a_motion_is_planned_and_timed():
    said = run("plan_a_motion.py")
    assert "Bernstein" in said
    last = said.splitlines()[-1].split()
    assert float(last[3]) == pytest.approx(5.0, abs=0.3)


def test_a_lab_is_explored(tmp_path):
    said = run("explore_a_lab.py", 6, tmp_path / "lab.pgm")
    assert "mapping: the map is initialised" in said
    assert (tmp_path / "lab.pgm").read_bytes().startswith(b"P5")


def test_a_recording_is_tracked(tmp_path):
    said = run("track_a_recording.py", write_drive(tmp_path / "drive.bag", 60), tmp_path / "t.txt")
    tracked, frames = int(said.split()[0]), int(said.split()[2])
    assert frames == 60
    assert 30 <= tracked < 60
    trajectory = np.loadtxt(tmp_path / "t.txt")
    assert trajectory.shape == (tracked, 8)
    (seconds, *way_m), *_ = np.diff(trajectory[[0, -1]], axis=0)[:, :4]
    assert np.linalg.norm(way_m) / seconds == pytest.approx(0.2, rel=0.03)
