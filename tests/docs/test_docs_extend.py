"""The recipes of docs/how-to/extend.md: each module is run as it stands there, without a file of src/ touched."""

import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from waiting import PATIENCE_S

from vsx_ros.registry import PLUGINS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "extend.md"
MODULES = {
    m[1]: m[0] for m in re.findall(r"```python\n(# (\w+)\.py:.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
}
MOST_LINES = 40


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_there_is_one_of_each_kind_and_each_is_short() -> None:
    assert sorted(MODULES) == ["my_base", "my_camera", "my_planner", "my_ranker"]
    assert all(sum(map(bool, text.splitlines())) < MOST_LINES for text in MODULES.values())


def in_a_program(plugins: Path, program: str) -> str:
    """What a Python of its own prints: what is added to a registry stays for the whole process."""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=plugins, capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture(autouse=True)
def paths(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PYTHONPATH", ":".join([str(tmp_path), *filter(None, sys.path)]))


def test_a_base(plugins: Path) -> None:
    pytest.importorskip("rospy")
    program = """
import time, my_base
from vsx_ros.ros.base_drivers import BaseSettings, Listeners, base_driver
seen = []
base = base_driver(BaseSettings("mine", ""), Listeners(seen.append, lambda *_: None, lambda _: None))
base.start()
while len(seen) < 200 and (not seen or seen[-1].odometry.x_m < 0.05):
    base.drive(0.2, 0.0)
    time.sleep(0.01)
print(seen[-1].odometry.x_m >= 0.05, base.close())
"""
    assert in_a_program(plugins, program) == "True True"


def test_a_camera(plugins: Path) -> None:
    pytest.importorskip("rospy")
    cv2.imwrite(str(plugins / "one.png"), np.full((4, 6), 7, np.uint8))
    program = f"""
import time, my_camera
from vsx_ros.ros.cameras import open_camera
seen = []
camera = open_camera("folder:{plugins}", seen.append)
camera.start()
while not seen:
    time.sleep(0.01)
print(seen[0].image.shape, seen[0].encoding, camera.status().counters["frames"])
"""
    assert in_a_program(plugins, program) == "(4, 6) mono8 1"


def test_a_ranker(plugins: Path) -> None:
    program = """
import numpy as np, my_ranker
from vsx_ros.config import Config
from vsx_ros.exploration.utility import RANKERS, RankingInput
from vsx_ros.geometry.view import with_view
from vsx_ros.occupancy.grid import OccupancyGrid
data = np.full((120, 120), -1, np.int8)
data[20:100, 20:60] = 0
grid = OccupancyGrid(data, 0.05, 0.0, 0.0)
points = np.random.default_rng(0).uniform(0.0, 6.0, (400, 3))
asked = RankingInput(grid, 0.2, points, np.zeros((0, 3)), lambda p: np.hypot(p[:, 0] - 2.0, p[:, 1] - 2.0),
                     lambda p: np.zeros(len(p), bool), with_view(Config()).exploration)
views = RANKERS["nearest"](asked).views
print(len(views) > 1, all(a.distance_m <= b.distance_m for a, b in zip(views, views[1:])))
"""
    assert in_a_program(plugins, program) == "True True"


def test_a_planner(plugins: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLUGINS, "my_planner")
    words = ["plan", "--planner", "gentle", "--start", "0,0,0", "--goal", "3,1,0", "--json"]
    command = [sys.executable, "-m", "vsx_ros.cli.main", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert '"planner": "gentle"' in done.stdout


def test_a_module_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLUGINS, "my_base_misspelt")
    words = ["explore", "--fast", "--time", "1"]
    done = subprocess.run(
        [sys.executable, "-m", "vsx_ros.cli.main", *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "'my_base_misspelt' named in VSX_PLUGINS cannot be imported" in done.stderr
