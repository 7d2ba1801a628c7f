"""The examples as a reader starts them: short, and they do what they say."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
OFFICE = Path(os.environ.get("VSX_DATA", "../shared/data")) / "new_tsukuba_150"


def run(name, *words):
    shell = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, str(EXAMPLES / name), *map(str, words)]
    done = subprocess.run(command, env=shell, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.name)
def test_examples_are_short_and_say_how_they_are_started(file):
    text = file.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
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


@pytest.mark.data
@pytest.mark.skipif(not OFFICE.exists(), reason="VSX_DATA has no new_tsukuba_150")
def test_a_recording_is_tracked(tmp_path):
    said = run("track_a_recording.py", OFFICE, tmp_path / "t.txt")
    tracked, frames = int(said.split()[0]), int(said.split()[2])
    assert 0.8 * frames < tracked <= frames
    assert np.loadtxt(tmp_path / "t.txt").shape == (tracked, 8)
