"""What docs/how-to/install.md promises of the wheel works where no part of ROS can be imported."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE_S

TESTS = Path(__file__).resolve().parents[1]
WITHOUT_ROS = """
import importlib.abc, sys

class NoRos(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        ros = {"actionlib", "dynamic_reconfigure", "genmsg", "genpy", "std_srvs"}
        if top in ros or top.endswith("_msgs") or (top.startswith("ros") and top != "rosbags"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, NoRos())
from vsx_ros.cli.main import main
main()
"""


def vsx(*words: object) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join(path for path in sys.path if path)
    command = [sys.executable, "-c", WITHOUT_ROS, *map(str, words)]
    return subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("without_ros") / "run"
    done = vsx("explore", "--fast", "--world", "lab", "--seed", 1, "--time", 8, "--out", out)
    assert done.returncode == 0, done.stderr
    return out


def test_an_exploration_leaves_its_results(run: Path) -> None:
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert summary["stop_reason"] == "time limit of 8 s"
    assert summary["ate_rmse_m"] < 0.05
    assert (run / "map.pgm").stat().st_size > 1000


def test_its_trajectory_is_evaluated_and_its_report_written(run: Path) -> None:
    done = vsx("evaluate", "--estimate", run / "trajectory.txt", "--truth", run / "groundtruth.txt", "--json")
    assert done.returncode == 0, done.stderr
    assert 0.0 < json.loads(done.stdout)["ate_rmse_m"] < 0.05
    (run / "report.html").unlink()
    assert vsx("report", run).returncode == 0
    assert "<html" in (run / "report.html").read_text(encoding="utf-8")


def test_a_motion_is_planned() -> None:
    done = vsx("plan", "--start", "0,0,0", "--goal", "2,1,90", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["planner"] == "fov"


def test_a_bag_is_replayed(tmp_path: Path) -> None:
    hallway, out = TESTS / "data/mononav_hallway", tmp_path / "run"
    done = vsx("replay", hallway / "hallway.bag", "--calibration", hallway / "camera.json", "--out", out)
    assert done.returncode == 0, done.stderr
    assert json.loads((out / "summary.json").read_text(encoding="utf-8"))["frames"] == 91


@pytest.mark.parametrize("words", [["status"], ["explore", "--world", "lab"], ["record"]])
def test_what_needs_ros_says_so(words: list[str]) -> None:
    done = vsx(*words)
    assert done.returncode == 1
    assert re.fullmatch(r"vsx: there is no Python package '\w+' here; 'vsx doctor' tells .*\n", done.stderr)
