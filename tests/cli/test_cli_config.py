from pathlib import Path

import pytest
import yaml

from vsx_ros.cli.main import execute
from vsx_ros.config import Config, from_dict, to_dict
from vsx_ros.errors import ConfigError
from vsx_ros.runs.parameters import commented_yaml, load

DEFAULT = Path(__file__).parents[2] / "config" / "default.yaml"


def test_the_file_in_the_checkout_is_the_default_tree():
    assert DEFAULT.read_text() == commented_yaml(Config()), "run: scripts/vsx config > config/default.yaml"


def test_the_printed_tree_is_read_back(tmp_path, capsys):
    assert execute(["config", "--set", "planner.phi_rad_m=0.5"]) == 0
    text = capsys.readouterr().out
    (tmp_path / "my.yaml").write_text(text)
    config = load(tmp_path / "my.yaml", [])
    assert config.planner.phi_rad_m == 0.5
    assert to_dict(config) == {**to_dict(Config()), "planner": to_dict(config)["planner"]}


@pytest.mark.parametrize("text", ["2e-1", "5e-05", "0.25"])
def test_numbers_are_read_as_python_writes_them(text, capsys):
    assert execute(["config", "--set", f"dense.min_texture={text}"]) == 0
    assert from_dict(yaml.safe_load(capsys.readouterr().out)).dense.min_texture == float(text)


def test_entries_tell_unit_and_bound():
    lines = {line.split(":")[0].strip(): line for line in commented_yaml(Config()).splitlines() if ":" in line}
    assert lines["phi_rad_m"].endswith("# rad/m, >= 0.01")
    assert lines["jerk_m_s3"].endswith("# m/s^3, >= 0.01 and <= 100")
    assert lines["good_ratio"].endswith("# >= 0 and <= 1")
    assert lines["pitch_down_rad"].endswith("# rad, >= -0.8 and <= 0.8")


def test_every_branch_is_explained():
    text = commented_yaml(Config())
    for name, value in to_dict(Config()).items():
        assert isinstance(value, dict)
        before = text.split(f"\n{name}:")[0]
        assert before.rstrip().splitlines()[-1].startswith("# ")
    assert from_dict(yaml.safe_load(text)) == Config()


def test_a_file_changes_only_what_it_names(tmp_path):
    (tmp_path / "a.yaml").write_text("limits: {v_m_s: 0.1}\n")
    config = load(tmp_path / "a.yaml", ["limits.omega_rad_s=0.2"])
    assert (config.limits.v_m_s, config.limits.omega_rad_s) == (0.1, 0.2)
    assert config.limits.a_m_s2 == Config().limits.a_m_s2
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    assert load(tmp_path / "empty.yaml", []) == Config()


@pytest.mark.parametrize(
    ("text", "assignments", "message"),
    [
        ("limits: {v_m_s: -1}", [], "limits.v_m_s is -1; give a number from 0.01 to 0.7"),
        ("limits: {v_m_s: 9}", [], "limits.v_m_s is 9; give a number from 0.01 to 0.7"),
        ("robot: {mount: {forward_m: .nan}}", [], "robot.mount.forward_m is nan"),
        ("planner: {phi_rad_m: .inf}", [], "planner.phi_rad_m is inf"),
        ("limits: {speed: 1}", [], "speed"),
        ("limits: [", [], "cannot be read"),
        ("3", [], "configuration"),
        ("", ["limits.v_m_s"], "NAME=VALUE"),
        ("", ["limits.v_m_s="], "v_m_s"),
        ("", ["limits.v_m_s=fast"], "v_m_s"),
        ("", ["limits.speed=1"], "no parameter 'limits.speed'"),
    ],
)
def test_wrong_parameters_are_named(tmp_path, text, assignments, message):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load(tmp_path / "a.yaml", assignments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("assignment", "names"),
    [
        ("slam.initialization.baseline_m=0.7", ("slam.initialization.baseline_m", "baseline_max_m, 0.6")),
        ("ground_map.obstacle_min_height_m=0.7", ("ground_map.obstacle_min_height_m", "obstacle_max_height_m, 0.6")),
        ("ground_map.obstacle_max_height_m=0.06", ("ground_map.obstacle_min_height_m", "obstacle_max_height_m, 0.06")),
        ("slam.tracker.good_ratio=0.05", ("slam.tracker.lost_ratio", "slam.tracker.good_ratio, 0.05")),
        ("runs.checkpoint_s=1e300", ("runs.checkpoint_s",)),
        ("exploration.blacklist_s=1e300", ("exploration.blacklist_s",)),
        ("planner.sight_landmarks=100000000000000000000", ("planner.sight_landmarks",)),
        ("limits.v_m_s=1e-9", ("limits.v_m_s",)),
        ("planner.phi_rad_m=1e-6", ("planner.phi_rad_m",)),
        ("ground_map.resolution_m=0.001", ("ground_map.resolution_m",)),
        ("robot.radius_m=5", ("robot.radius_m",)),
        ("dense.planes.hypotheses=65473", ("dense.planes.hypotheses", "65472")),
        ("slam.shutter.readout_s=26", ("slam.shutter.readout_s", "0.2")),
        ("slam.shutter.exposure_s=15", ("slam.shutter.exposure_s", "0.2")),
        ("slam.shutter.readout_s=-0.5", ("slam.shutter.readout_s", "-1")),
        ("slam.shutter.exposure_s=-0.01", ("slam.shutter.exposure_s", "-1")),
    ],
)
def test_parameters_with_which_nothing_would_work_are_refused(assignment, names):
    with pytest.raises(ConfigError) as caught:
        load(None, [assignment])
    assert all(name in str(caught.value) for name in names)


def test_a_missing_file_is_named(tmp_path, capsys):
    assert execute(["config", "--config", str(tmp_path / "absent.yaml")]) == 1
    assert "absent.yaml" in capsys.readouterr().err
