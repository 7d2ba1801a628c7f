"""The unit files of the master and the drivers."""

import os
import shutil
import subprocess
from configparser import ConfigParser
from pathlib import Path

import pytest
import yaml
from free_ports import free_port
from waiting import PATIENCE_S

from vsx_ros.config import Config, to_dict

ROOT = Path(__file__).parents[2]
UNITS = sorted((ROOT / "hw/systemd").glob("*.service"))


def read(unit: Path) -> ConfigParser:
    parser = ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # names keep their case
    parser.read(unit)
    return parser


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_a_driver_is_started_again_however_often_it_fails(unit: Path) -> None:
    """By default systemd gives up for good after five starts within ten seconds."""
    of = read(unit)
    assert of["Unit"]["StartLimitIntervalSec"] == "0"
    assert of["Service"]["Restart"] == "on-failure"
    assert float(of["Service"]["RestartSec"]) > 0.0
    assert of["Install"]["WantedBy"] == "multi-user.target"


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_the_programs_of_the_units_exist(unit: Path) -> None:
    of = read(unit)["Service"]
    for program in (of[name].split()[0] for name in ("ExecStart", "ExecStopPost") if name in of):
        if (unit.stem, program) == ("vsx-master", "/usr/bin/roscore"):  # of ROS, as apt.txt installs it
            continue
        assert (ROOT / Path(program).relative_to("/opt/vsx_ros")).is_file()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_understands_every_option(unit: Path, tmp_path: Path) -> None:
    for each in UNITS:  # they name each other
        (tmp_path / each.name).write_text(each.read_text().replace("/opt/vsx_ros", str(ROOT)))
    here = tmp_path / unit.name
    done = subprocess.run(["systemd-analyze", "verify", here], capture_output=True, text=True, timeout=60, check=False)
    told = [line for line in done.stderr.splitlines() if unit.name in line]
    assert (done.returncode, told) == (0, [])


@pytest.mark.parametrize("name", ["vsx-base", "vsx-camera"])
def test_a_driver_waits_for_the_master_and_is_started_again_without_it(name: str) -> None:
    """Requires= in place of Wants= would give a driver up for good when the master's first start fails."""
    of = read(ROOT / "hw/systemd" / f"{name}.service")["Unit"]
    assert "vsx-master.service" in of["After"].split()
    assert of["Wants"] == "vsx-master.service"


def test_the_camera_starts_after_the_base_has_loaded_the_configuration() -> None:
    assert "vsx-base.service" in read(ROOT / "hw/systemd/vsx-camera.service")["Unit"]["After"].split()


@pytest.mark.ros
def test_the_base_starts_with_the_calibrations_of_this_robot_and_nothing_of_an_earlier_run(tmp_path: Path) -> None:
    """'vsx explore' leaves its configuration at a master that lasts, with what --set changed."""
    pytest.importorskip("rospy")
    robot = tmp_path / "vsx_ros" / "robot.yaml"
    robot.parent.mkdir()
    robot.write_text("robot: {mount: {pitch_down_rad: 0.125}}\n")
    loads = read(ROOT / "hw/systemd/vsx-base.service")["Service"]["ExecStartPre"]
    shell = loads.replace("$$", "$").replace("/opt/vsx_ros", str(ROOT)).removeprefix("/bin/sh -c ").strip("'")
    earlier = "until rosparam list >/dev/null 2>&1; do sleep 0.2; done; rosparam set /config/limits/v_m_s 0.1"
    port = free_port()
    env = {**os.environ, "ROS_HOME": str(tmp_path), "ROS_HOSTNAME": "localhost"}
    env |= {"ROS_MASTER_URI": f"http://localhost:{port}", "ROS_LOG_DIR": str(tmp_path)}
    with subprocess.Popen(["roscore", "-p", str(port)], env=env, stdout=subprocess.DEVNULL) as master:
        try:
            for each in (earlier, shell):
                subprocess.run(["/bin/sh", "-c", each], env=env, timeout=PATIENCE_S, check=True)
            asked = ["rosparam", "get", "/config"]
            told = subprocess.run(asked, env=env, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
        finally:
            master.terminate()
    tree = yaml.safe_load(told.stdout)
    assert tree["robot"]["mount"]["pitch_down_rad"] == 0.125
    assert tree["limits"] == to_dict(Config())["limits"]
