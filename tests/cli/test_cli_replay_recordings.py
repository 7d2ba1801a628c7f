"""Replays of real recordings, where they are present."""

import os
from pathlib import Path

import pytest

from vsx_ros.cli.main import execute
from vsx_ros.runs.folder import RunFolder

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[2] / "../shared/data"))


def replay(name, tmp_path, *more):
    """Exit code and run folder of a replay of a recording."""
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent (set VSX_DATA)")
    out = tmp_path / "run"
    return execute(["replay", str(DATA / name), "--out", str(out), *more]), RunFolder(out)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bags/foxglove/empty-file.bag", "is empty (0 bytes)"),
        ("bags/scan_tools/laser_scan_sparsifier_demo_v12.bag", "has the format 1.2"),
        ("bags/evo/tf_example.bag", "no image topic; it has /tf"),
        ("bags/foxglove/no-messages.bag", "it holds no messages"),
    ],
)
def test_unusable_bags_are_one_sentence(name, message, tmp_path, capsys):
    code, _ = replay(name, tmp_path)
    error = capsys.readouterr().err
    assert code == 1
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "tracked", "ate_m"), [("vamr_checkerboard", 80, 0.005), ("new_tsukuba_150", 120, 0.03)]
)
def test_real_recordings_are_tracked(name, tracked, ate_m, tmp_path):
    code, run = replay(name, tmp_path)
    summary = run.read_summary()
    assert code == 0
    assert summary["frames_tracked"] >= tracked
    assert summary["ate_rmse_sim3_m"] <= ate_m
    assert summary["ate_rmse_m"] is None


@pytest.mark.data
@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_of_every_compression_replay(compression, tmp_path):
    calibration = str(DATA / "new_tsukuba_150/camera.json")
    name = f"bags/derived_shared_tsukuba/tsukuba_60_compressed_{compression}.bag"
    code, run = replay(name, tmp_path, "--calibration", calibration)
    assert code == 0
    assert run.read_summary()["frames_tracked"] >= 40
    assert run.read_summary()["ate_rmse_sim3_m"] < 0.02


@pytest.mark.data
def test_a_truncated_bag_is_replayed_as_far_as_it_goes(tmp_path, capsys):
    calibration = str(DATA / "new_tsukuba_150/camera.json")
    code, run = replay("bags/derived_shared_tsukuba/truncated_70pct.bag", tmp_path, "--calibration", calibration)
    assert code == 0
    assert 30 <= run.read_summary()["frames"] <= 45
    assert "cut short or damaged" in capsys.readouterr().err


@pytest.mark.data
def test_without_a_calibration_a_nominal_one_is_assumed_aloud(tmp_path, capsys):
    code, run = replay("bags/derived_shared_tsukuba/tsukuba_60_compressed_none.bag", tmp_path)
    assert code == 0
    assert run.read_summary()["frames_tracked"] >= 40
    assert "nominal one is assumed (525 px)" in capsys.readouterr().err


@pytest.mark.data
def test_a_drone_that_stands_on_the_floor_never_starts(tmp_path, capsys):
    code, run = replay("euroc_v101_stationary", tmp_path)
    assert code == 1
    assert run.read_summary()["frames_tracked"] == 0
    assert "stands still" in capsys.readouterr().out
