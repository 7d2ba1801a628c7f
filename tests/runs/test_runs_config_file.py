"""config.yaml of a run folder is used whole or not at all."""

import os
import subprocess
import sys

import pytest

from vsx_ros.config import Config, overridden
from vsx_ros.errors import InputError
from vsx_ros.runs.folder import RunFolder

CAREFUL = overridden(Config(), {"limits.v_m_s": 0.1, "robot.radius_m": 0.25, "planner.phi_rad_m": 0.7})


@pytest.fixture
def run(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(CAREFUL, ["vsx", "explore"], seed=3)
    return folder


def older(text):
    """As older versions wrote it."""
    return text.removeprefix("---\n").removesuffix("...\n")


@pytest.mark.parametrize("of", [str, older])
def test_a_file_cut_short_is_refused_and_a_whole_one_is_used(run, of):
    path = run.path / "config.yaml"
    lines = of(path.read_text()).splitlines(keepends=True)
    for count in range(len(lines)):
        path.write_text("".join(lines[:count]))
        with pytest.raises(InputError, match=r"config\.yaml is damaged"):
            run.read_config()
    path.write_text("".join(lines))
    config, facts = run.read_config()
    assert config == CAREFUL
    assert facts["seed"] == 3


def test_a_file_without_a_configuration_is_refused(run):
    (run.path / "config.yaml").write_text("---\nseed: 3\n...\n")
    with pytest.raises(InputError, match="it holds no configuration"):
        run.read_config()


def test_paths_that_are_not_utf8_are_kept(tmp_path):
    path, map_file = (str(tmp_path / os.fsdecode(name)) for name in (b"caf\xe9", b"\xfc.vsxmap"))
    run = RunFolder.create(tmp_path / path)
    run.write_config(Config(), ["vsx", "explore", "--out", path], load_map=map_file, zones="plain.yaml", seed=None)
    facts = run.read_config()[1]
    assert (facts["load_map"], facts["zones"], facts["seed"]) == (map_file, "plain.yaml", None)
    assert facts["command"] == f"vsx explore --out {path}"
    run.write_summary({"continued_map": map_file, "stop_reason": "it is done", "frames": 0, "ended_well": True})
    for command in ("report", "evaluate"):
        words = [sys.executable, "-m", "vsx_ros.cli.main", command, path]
        done = subprocess.run(words, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, capture_output=True)
        assert done.returncode == 0, done.stderr
    assert r"caf\udce9" in (run.path / "report.html").read_text(encoding="utf-8")
