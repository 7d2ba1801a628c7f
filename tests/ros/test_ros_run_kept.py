"""What stays of a run: a folder by roslaunch, too, and neither master nor nodes of a killed run."""

import csv
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from ros_ports import free_port
from test_ros_run import CHECKOUT, environment, exploring, processes_that_name

from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.moments import Moments

pytestmark = pytest.mark.ros


def test_roslaunch_leaves_a_whole_folder(tmp_path: Path) -> None:
    port = free_port()
    around = {**environment(tmp_path, port), "ROS_PACKAGE_PATH": f"{CHECKOUT}:/usr/share"}
    words = ["roslaunch", "-p", str(port), "vsx_ros", "simulate.launch", "seed:=1", f"devices:={tmp_path}"]
    with subprocess.Popen(words, env=around, start_new_session=True) as launched:
        try:
            while not list(tmp_path.glob("runs/*_ros/resume/map.zip")):
                assert launched.poll() is None
                time.sleep(0.2)
            time.sleep(5.0)
        finally:
            launched.send_signal(signal.SIGINT)
    (path,) = (tmp_path / "runs").iterdir()
    folder = RunFolder.open(path)
    config, facts = folder.read_config()
    assert (facts["world"], facts["seed"], facts["fast"]) == ("lab", 1, False)
    summary = folder.read_summary()
    assert summary["stop_reason"] == "stopped by the operator"
    assert summary["frames_tracked"] > 0
    assert summary["coverage"] > 0.0
    assert any(event.source == "mission" for event in folder.read_events())
    assert folder.read_map() is not None
    kept = Moments.read(folder.moments)
    assert len(kept.pictures) >= 5, "five seconds and more since there is a map"
    assert kept.maps
    assert "Second by second" in (path / "report.html").read_text()
    with (path / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["known_area_m2"]) > 0.0
    assert float(rows[-1]["driven_m"]) == pytest.approx(summary["driven_m"], rel=0.2, abs=0.1)
    assert float(rows[-1]["coverage_correct"]) == pytest.approx(summary["coverage_correct"], abs=1e-5)
    assert config.exploration.teleop_quiet_s > 0.0


def test_a_killed_run_leaves_no_master_and_no_node(tmp_path: Path) -> None:
    port = free_port()
    with exploring(tmp_path, port, tmp_path / "run") as (run, _):
        os.kill(run.pid, signal.SIGKILL)
        run.wait()
    while processes_that_name(f"-p {port}") or processes_that_name(str(tmp_path)):
        time.sleep(0.1)
