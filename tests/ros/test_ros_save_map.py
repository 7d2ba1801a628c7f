"""vsx map save beside a robot that explores."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

from waiting import PATIENCE_S

from vsx_ros.io.slam_map_file import load_slam_map

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

VSX = [sys.executable, "-m", "vsx_ros.cli.main", "map", "save"]


def test_the_map_of_a_running_robot_is_saved_where_asked(stack: Stack, tmp_path: Path) -> None:
    stack.wait_until_driving()
    path = tmp_path / "now.vsxmap"

    def save(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*VSX, *words], env=stack.environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )

    stack.wait(lambda: save("--out", str(path)).returncode == 0, "a map to save", 60.0)
    assert len(load_slam_map(path).view.living) >= 2
    refused = save("--out", str(tmp_path / "none" / "x.vsxmap"))
    assert refused.returncode == 1
    assert refused.stderr.count("\n") == 1
    assert "cannot be written" in refused.stderr


def test_without_a_robot_it_says_what_to_do(stack: Stack) -> None:
    alone = {**stack.environment, "ROS_MASTER_URI": "http://localhost:1"}
    done = subprocess.run(VSX, env=alone, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 1
    assert "no ROS master answers" in done.stderr
