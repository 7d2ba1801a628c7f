"""A plain checkout is a ROS package: ROS_PACKAGE_PATH is all that rospack and rosrun need."""

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from waiting import PATIENCE_S

pytest.importorskip("rospy")

CHECKOUT = Path(__file__).resolve().parents[2]

pytestmark = [
    pytest.mark.ros,
    pytest.mark.light,
    pytest.mark.skipif(shutil.which("rosrun") is None, reason="rosrun (package rosbash) is not installed"),
]


def environment(**changes: str) -> dict[str, str]:
    """As in a user's shell: no virtual environment, no PYTHONPATH."""
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return {**kept, "ROS_PACKAGE_PATH": f"{CHECKOUT}:/usr/share", **changes}


def output_of(command: list[str], **changes: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, env=environment(**changes), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def test_rospack_finds_the_checkout() -> None:
    assert output_of(["rospack", "find", "vsx_ros"]).stdout.strip() == str(CHECKOUT)


@pytest.fixture
def spy(tmp_path: Path) -> Path:
    """Tells how it was started."""
    made = tmp_path / "ours" / "bin" / "python3"
    made.parent.mkdir(parents=True)
    made.write_text(f'#!/bin/sh\necho "$VSX_BOOTED $@"\nexec {sys.executable} -c "pass"\n', encoding="utf-8")
    made.chmod(0o755)
    return made


def test_rosrun_finds_one_starter_and_the_starter_finds_its_python(spy: Path) -> None:
    done = output_of(["rosrun", "vsx_ros", "follower", "_x:=1"], VSX_PYTHON=str(spy))
    assert done.returncode == 0, done.stderr
    guard, script, argument = done.stdout.split()
    assert (guard, Path(script).name, argument) == ("1", "follower", "_x:=1")


def test_an_active_environment_of_something_else_does_not_hide_ours(spy: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "foreign", symlinks=True)
    follower = ["env", "-u", "VSX_PYTHON", str(CHECKOUT / "scripts/follower"), "_x:=1"]
    active = {"PATH": f"{tmp_path / 'foreign/bin'}:{os.environ['PATH']}"}
    done = output_of(follower, VSX_VENV=str(tmp_path / "ours"), **active)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["1", *follower[-2:]]
    done = output_of(follower, VSX_VENV=str(tmp_path / "none"), **active)
    assert done.returncode == 1
    assert f"there is no {tmp_path / 'none/bin/python3'}; run scripts/demo once" in done.stderr


def test_under_its_own_python_the_starter_goes_straight_to_the_node() -> None:
    scripts = str(CHECKOUT / "scripts")
    command = [sys.executable, "-c", "import boot; boot.into('json.tool')"]
    done = output_of(command, PYTHONPATH=scripts, VSX_PYTHON=sys.executable, VSX_BOOTED="1")
    assert "Expecting value" in done.stderr  # json.tool ran, on empty input


def test_vsx_works_from_any_folder(tmp_path: Path) -> None:
    """Its programs above, too: they are other processes, which must find the packages as it did."""
    vsx = [str(CHECKOUT / "scripts/vsx"), "status"]
    shell = environment(VSX_PYTHON=sys.executable, ROS_MASTER_URI="http://localhost:1")
    done = subprocess.run(vsx, env=shell, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 1
    assert "no ROS master answers" in done.stderr
