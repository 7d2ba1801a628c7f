"""Replays of an emulated drive: what they keep, and what cannot be."""

import json
import os
import re
import shutil
import signal

import cv2
import numpy as np
import pytest
import yaml
from chromium import EXECUTABLE, Chromium
from recorded_drive import write_images
from ros2_bags import image as image_message
from ros2_bags import odometry, write
from rosbags.rosbag2 import StoragePlugin

from vsx_ros.cli.main import execute
from vsx_ros.evaluation.summary import Summary
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.io.trajectory_file import read_trajectory
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.record import RunRecord

FEW = 40  # images of the drive, with as few keyframes of a map without odometry as may be given up


def test_a_drive_is_tracked_at_metric_scale(replayed):
    summary = replayed.read_summary()
    assert list(summary) == list(Summary().as_dict())
    assert summary["frames"] == 60
    assert summary["frames_tracked"] >= 30
    assert summary["ate_rmse_m"] < 0.05
    assert summary["breaks"] == 0
    assert summary["stop_reason"] == "the recording was tracked to its end"
    assert summary["ended_well"] is True
    assert summary["coverage"] is None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_replay_with_what_there_is(number, drive, tmp_path, monkeypatch, capsys):
    add_frame = RunRecord.add_frame

    def press_at_frame_40(record, *frame):
        add_frame(record, *frame)
        if len(record.frames) == 40:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(RunRecord, "add_frame", press_at_frame_40)
    before, saved = signal.getsignal(number), tmp_path / "a.vsxmap"
    assert execute(["replay", str(drive), "--map", "--save-map", str(saved), "--out", str(tmp_path / "run")]) == 4
    assert signal.getsignal(number) is before
    assert "stopped by the operator after 40 of 60 frames" in capsys.readouterr().out
    folder = RunFolder.open(tmp_path / "run")
    assert folder.read_summary()["frames"] == 40
    assert folder.read_map() is not None
    assert load_slam_map(saved).view.keyframes


def test_the_run_folder_holds_what_it_promises(replayed):
    for name in (
        "config.yaml",
        "trajectory.txt",
        "trajectory_final.txt",
        "odometry.txt",
        "groundtruth.txt",
        "map.pgm",
        "map.yaml",
        "sparse.ply",
    ):
        assert (replayed.path / name).stat().st_size > 0
    assert len(replayed.read_poses("trajectory")) == replayed.read_summary()["frames_tracked"]
    live, final = replayed.read_trajectories()
    assert [pose.stamp_ns for pose in final] == [pose.stamp_ns for pose in live]
    moved_m = [float(np.linalg.norm(a.T.translation - b.T.translation)) for a, b in zip(live, final)]
    assert 1e-5 < max(moved_m) < 0.05, "adjustments moved the keyframes"
    summary = replayed.read_summary()
    assert 0 < summary["ate_final_rmse_m"] < 0.01
    assert any(event.state == "initialised" for event in replayed.read_events())
    assert len(replayed.read_frames()) == 60


def test_how_long_points_live_is_kept_for_each_frame_and_ends_at_the_number_of_the_run(replayed):
    frames, u2_frames = replayed.read_frames(), replayed.read_summary()["u2_frames"]
    lives = [frame.u2_frames for frame in frames]
    assert lives[0] is None
    assert lives[-1] == pytest.approx(u2_frames, abs=0.006)
    assert 3.0 <= lives[-10] < lives[-1] <= len(frames)
    report = (replayed.path / "report.html").read_text()
    assert "U2 so far" in report
    assert f"<b>{u2_frames:.0f} frames</b>" in report
    free_m2 = np.count_nonzero(replayed.read_map().data == 0) * 0.05**2
    assert 0.3 < free_m2 < 20
    assert yaml.safe_load((replayed.path / "config.yaml").read_text())["versions"]["numpy"] == np.__version__


def test_the_report_needs_nothing_else(replayed, capsys):
    page = (replayed.path / "report.html").read_text()
    assert "the recording was tracked to its end" in page
    assert page.count("<svg") == page.count("</svg>") == 6
    assert "data:image/png;base64," in page
    for outside in ('src="http', 'href="http', "url(http", "<script src"):
        assert outside not in page
    assert execute(["report", str(replayed.path)]) == 0
    assert capsys.readouterr().out.strip() == str(replayed.path / "report.html")
    assert (replayed.path / "report.html").read_text() == page


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_a_browser_shows_the_report_and_asks_nobody(replayed, tmp_path):
    page = (replayed.path / "report.html").as_uri()
    with Chromium(tmp_path / "profile") as browser:
        browser.open(page)
        browser.wait(f"location.href === {page!r} && document.readyState === 'complete'")
        boxes = browser.evaluate(
            "Array.from(document.querySelectorAll('svg')).map(picture => { "
            "const box = picture.getBoundingClientRect(), drawn = picture.getBBox(); "
            "return [box.width, box.height, drawn.width, drawn.height]; })"
        )
        assert len(boxes) == 6
        assert all(length_px > 20.0 for box in boxes for length_px in box), boxes
        pictures = "Promise.all(Array.from(document.querySelectorAll('image')).map(i => i.decode()))"
        assert browser.evaluate(f"{pictures}.then(decoded => decoded.length)") >= 1
        wide_px = browser.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert wide_px[0] <= wide_px[1]
        assert page in browser.requested
        assert [url for url in browser.requested if not url.startswith((page, "data:", "about:"))] == []


def test_two_runs_are_compared(drive, replayed, tmp_path, capsys):
    coarse, page = tmp_path / "coarse", tmp_path / "page.html"
    words = ["--map", "--set", "ground_map.resolution_m=0.1", "--out", str(coarse)]
    assert execute(["replay", str(drive), *words]) == 0
    capsys.readouterr()
    assert execute(["report", str(replayed.path), str(coarse)]) == 0
    assert execute(["report", str(replayed.path), str(coarse), "--out", str(page)]) == 0
    assert capsys.readouterr().out == f"{coarse / 'compared.html'}\n{page}\n"
    text = page.read_text()
    assert (coarse / "compared.html").read_text() == text
    assert "<h1>coarse against drive</h1>" in text
    settings = re.search(r"Settings that differ</h2><pre>([^<]*)</pre>", text)
    assert [line.split("  #")[0] for line in settings[1].splitlines()] == [
        "- ground_map.resolution_m: 0.05",
        "+ ground_map.resolution_m: 0.1",
    ]
    assert text.count("data:image/png;base64,") == 2
    assert "<td>breaks</td><td>0</td><td>0</td>" in text


def test_a_comparison_that_cannot_be_written_is_told(replayed, tmp_path, capsys):
    out = tmp_path / "none" / "compared.html"
    assert execute(["report", str(replayed.path), str(replayed.path), "--out", str(out)]) == 1
    assert f"{out} cannot be written (No such file or directory); give another" in capsys.readouterr().err


def test_the_same_recording_gives_the_same_bytes(drive, replayed, tmp_path):
    assert execute(["replay", str(drive), "--map", "--out", str(tmp_path / "again")]) == 0
    for name in ("trajectory.txt", "sparse.ply", "map.pgm", "events.jsonl"):
        assert (tmp_path / "again" / name).read_bytes() == (replayed.path / name).read_bytes()


def test_a_camera_that_stands_still_says_why(drive, tmp_path, capsys):
    image = cv2.imread(str(drive / "rgb/000010.png"), cv2.IMREAD_GRAYSCALE)
    write_images(tmp_path / "still", [(i * 10**8, image) for i in range(8)])
    (tmp_path / "still/camera.json").write_text((drive / "camera.json").read_text())
    assert execute(["replay", str(tmp_path / "still"), "--out", str(tmp_path / "run")]) == 1
    assert "the map was never started: " in capsys.readouterr().out
    summary = RunFolder.open(tmp_path / "run").read_summary()
    assert (summary["frames_tracked"], summary["u1"], summary["ate_rmse_m"]) == (0, None, None)
    assert "There is no map" in (tmp_path / "run/report.html").read_text()


def test_odometry_can_be_declined(drive, tmp_path, capsys):
    image = cv2.imread(str(drive / "rgb/000010.png"), cv2.IMREAD_GRAYSCALE)
    write_images(tmp_path / "still", [(i * 10**8, image) for i in range(3)])
    (tmp_path / "still/camera.json").write_text((drive / "camera.json").read_text())
    (tmp_path / "still/odometry.txt").write_text("0.0 0 0 0 0 0 0 0\n")
    command = ["replay", str(tmp_path / "still"), "--out", str(tmp_path / "run")]
    assert execute(command) == 1
    assert "odometry.txt, line 1" in capsys.readouterr().err
    assert execute([*command, "--odometry-topic", "none"]) == 1
    assert "the map was never started: camera stands still" in capsys.readouterr().out


def test_a_map_that_was_given_up_is_not_one_that_never_started(drive, tmp_path, capsys):
    """Without odometry, a young map that has lost the camera is worth less than another start."""
    pictures = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted((drive / "rgb").iterdir())]
    seen = [*pictures[:FEW], *[np.zeros((480, 640), np.uint8)] * 12]
    write_images(tmp_path / "dark", [(i * 66_666_667, image) for i, image in enumerate(seen)])
    (tmp_path / "dark/camera.json").write_text((drive / "camera.json").read_text())
    assert execute(["replay", str(tmp_path / "dark"), "--map", "--out", str(tmp_path / "run")]) == 3
    said = capsys.readouterr().out
    assert "never started" not in said
    (began, ended) = re.search(r"the map was there from (\S+) s to (\S+) s, then given up \(lost with", said).groups()
    states = [(frame.stamp_ns, frame.state) for frame in RunFolder.open(tmp_path / "run").read_frames()]
    with_map = [1e-9 * stamp_ns for stamp_ns, state in states if state != "not initialised"]
    assert (float(began), float(ended)) == pytest.approx((with_map[0], with_map[-1]), abs=0.051)
    assert "kept are frames.csv and events.jsonl, but no map and no trajectory" in said
    assert RunFolder.open(tmp_path / "run").read_poses("trajectory") == []
    assert "There is no map: it was given up." in (tmp_path / "run/report.html").read_text()


def test_a_map_without_odometry_says_in_what_unit_it_is(drive, tmp_path, capsys):
    shutil.copytree(drive, tmp_path / "pictures")
    (tmp_path / "pictures/odometry.txt").unlink()
    assert execute(["replay", str(tmp_path / "pictures"), "--map", "--out", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    assert "made without odometry, lengths are in the map's own unit" in said
    assert "jumps unknown: no odometry" in said
    folder = RunFolder.open(tmp_path / "run")
    assert folder.read_summary()["breaks"] is None
    assert folder.read_summary()["map_note"].startswith("made without odometry")
    planes = json.loads((folder.path / "planes.json").read_text())
    assert planes["unit"] == "map"
    assert planes["planes"]
    assert (folder.path / "dense.ply").exists()


def test_a_bag_that_is_damaged_in_its_middle_leaves_what_was_tracked(drive, tmp_path, capsys):
    messages = []
    for number, reading in enumerate(read_trajectory(drive / "odometry.txt")):
        pixels = cv2.imread(str(drive / f"rgb/{number:06d}.png"), cv2.IMREAD_GRAYSCALE)
        messages += [("/odom", odometry(reading.stamp_ns, reading.T.translation[0])),
                     ("/camera/image_raw", image_message(reading.stamp_ns, pixels))]  # fmt: skip
    [database] = write(tmp_path / "drive", messages, StoragePlugin.SQLITE3).glob("*.db3")
    raw = bytearray(database.read_bytes())
    page = 2 * len(raw) // 3 // 4096 * 4096  # of an image, with the number of its next page
    raw[page : page + 4096] = bytes(4096)
    database.write_bytes(raw)
    calibration = ["--calibration", str(drive / "camera.json")]
    assert execute(["replay", str(tmp_path / "drive"), *calibration, "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr()
    assert "the recording cannot be read to its end: bag" in said.out
    assert said.out.count("cut short or damaged") == 1
    summary = RunFolder.open(tmp_path / "run").read_summary()
    assert summary["ended_well"] is False
    assert 30 < summary["frames"] < 60
    assert len(RunFolder.open(tmp_path / "run").read_poses("trajectory")) == summary["frames_tracked"] > 15
    assert (tmp_path / "run/report.html").exists()


def test_a_missing_calibration_and_a_wrong_one_are_named(drive, tmp_path, capsys):
    write_images(tmp_path / "bare", [(0, np.zeros((48, 64), np.uint8))])
    assert execute(["replay", str(tmp_path / "bare"), "--out", str(tmp_path / "run")]) == 1
    assert "--calibration FILE" in capsys.readouterr().err
    calibration = ["--calibration", str(drive / "camera.json")]
    assert execute(["replay", str(tmp_path / "bare"), *calibration, "--map", "--ros"]) == 1
    assert "leave out --map or --ros" in capsys.readouterr().err
    assert execute(["replay", str(tmp_path / "bare"), *calibration, "--out", str(tmp_path / "run")]) == 1
    assert "64x48 but the calibration is for 640x480" in capsys.readouterr().err
    (tmp_path / "bare/camera.json").write_text("{}")
    assert execute(["replay", str(tmp_path / "bare"), "--out", str(tmp_path / "run")]) == 1
    assert "camera.json: entry 'fx' is missing" in capsys.readouterr().err
    assert execute(["replay", str(tmp_path / "bare"), *calibration, "--out", str(tmp_path / "run")]) == 1
    assert "64x48 but the calibration is for 640x480" in capsys.readouterr().err
