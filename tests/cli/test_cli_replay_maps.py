"""Replays that go on in a saved map, or save theirs."""

import shutil

import cv2
import numpy as np
import pytest
from recorded_drive import write_images

from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import dock_file, load_dock, save_dock
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.folder import RunFolder


def test_a_saved_map_is_gone_on_in(drive, tmp_path, capsys):
    saved = str(tmp_path / "lab.vsxmap")
    assert execute(["replay", str(drive), "--save-map", saved, "--out", str(tmp_path / "first")]) == 0
    first = RunFolder.open(tmp_path / "first").read_summary()
    assert execute(["replay", str(drive), "--load-map", saved, "--out", str(tmp_path / "second")]) == 0
    second = RunFolder.open(tmp_path / "second")
    summary = second.read_summary()
    assert (first["continued_map"], summary["continued_map"]) == (None, saved)
    assert first["frames_tracked"] < summary["frames_tracked"] == 60
    assert summary["initialized_at_s"] == 0.0
    assert summary["keyframes"] >= first["keyframes"]
    assert summary["ate_rmse_m"] < 0.03
    assert [event.state for event in second.read_events()][:2] == ["lost", "relocalised"]
    assert "map continued after 0.0 s" in capsys.readouterr().out


def test_what_lies_beside_a_map_goes_on_with_it_and_not_with_another(drive, tmp_path, capsys):
    lab, other = tmp_path / "lab.vsxmap", tmp_path / "other.vsxmap"
    stairs = Zone("stairs", ZoneKind.WALL, ((0.0, 0.0), (1.0, 0.0)))
    assert execute(["replay", str(drive), "--save-map", str(lab), "--out", str(tmp_path / "first")]) == 0
    save_zones([stairs], zone_file(lab))
    save_dock(SE2(1.0, 0.5, 0.0), dock_file(lab))
    again = ["replay", str(drive), "--load-map", str(lab), "--save-map", str(other)]
    assert execute([*again, "--out", str(tmp_path / "second")]) == 0
    assert load_zones(zone_file(other)) == [stairs]
    assert load_dock(dock_file(other)) == SE2(1.0, 0.5, 0.0)
    assert execute(["replay", str(drive), "--save-map", str(other), "--out", str(tmp_path / "third")]) == 0
    assert load_zones(zone_file(other)) == []
    assert load_dock(dock_file(other)) is None
    shutil.copy(lab, tmp_path / "first/map.vsxmap")
    capsys.readouterr()
    inside = ["--load-map", str(tmp_path / "first/map.vsxmap"), "--out", str(tmp_path / "first")]
    assert execute(["replay", str(drive), *inside]) == 1
    assert "which a new run empties" in capsys.readouterr().err
    assert (tmp_path / "first/summary.json").exists()


@pytest.mark.parametrize("given", ["input", "calibration"])
def test_a_replay_does_not_empty_the_folder_that_it_reads(drive, tmp_path, given, capsys):
    run = RunFolder.create(tmp_path / "run")
    run.write_config(Config(), ["vsx", "replay"])
    shutil.copytree(drive, run.path, dirs_exist_ok=True)
    words = {"input": [str(run.path)], "calibration": [str(drive), "--calibration", str(run.path / "camera.json")]}
    assert execute(["replay", *words[given], "--out", str(run.path)]) == 1
    assert "which a new run empties" in capsys.readouterr().err
    assert (run.path / "groundtruth.txt").exists()


def test_a_map_that_does_not_fit_or_cannot_be_saved_stops_before_the_replay(drive, tmp_path, capsys):
    out = ["--out", str(tmp_path / "run")]
    assert execute(["replay", str(drive), "--save-map", str(tmp_path / "absent/m"), *out]) == 1
    assert "its folder does not exist" in capsys.readouterr().err
    assert execute(["replay", str(drive), "--load-map", str(drive / "camera.json"), *out]) == 1
    assert "no sealed archive" in capsys.readouterr().err
    saved = str(tmp_path / "lab.vsxmap")
    assert execute(["replay", str(drive), "--save-map", saved, *out]) == 0
    other = ["--set", "robot.mount.height_m=0.5", "--out", str(tmp_path / "other")]
    assert execute(["replay", str(drive), "--load-map", saved, *other]) == 1
    assert "z 0.5000 m" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_where_no_map_was_made_none_is_saved(drive, tmp_path, capsys):
    image = cv2.imread(str(drive / "rgb/000010.png"), cv2.IMREAD_GRAYSCALE)
    write_images(tmp_path / "still", [(i * 10**8, image) for i in range(3)])
    (tmp_path / "still/camera.json").write_text((drive / "camera.json").read_text())
    saved = tmp_path / "still.vsxmap"
    command = ["replay", str(tmp_path / "still"), "--save-map", str(saved), "--out", str(tmp_path / "run")]
    assert execute(command) == 1
    assert "is not written: there is no map" in capsys.readouterr().err
    assert not saved.exists()


def test_a_place_that_is_not_in_the_map_ends_lost_and_says_so(drive, tmp_path, capsys):
    saved = str(tmp_path / "lab.vsxmap")
    assert execute(["replay", str(drive), "--save-map", saved, "--out", str(tmp_path / "first")]) == 0
    write_images(tmp_path / "dark", [(i * 10**8, np.zeros((480, 640), np.uint8)) for i in range(3)])
    (tmp_path / "dark/camera.json").write_text((drive / "camera.json").read_text())
    command = ["replay", str(tmp_path / "dark"), "--load-map", saved, "--out", str(tmp_path / "run")]
    assert execute(command) == 3
    assert "lost for good from frame 1 of 3: not yet recognised in the loaded map" in capsys.readouterr().out
    summary = RunFolder.open(tmp_path / "run").read_summary()
    assert (summary["frames_tracked"], summary["frames_lost"], summary["u1"]) == (0, 3, None)
