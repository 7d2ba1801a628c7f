"""A robot and a laptop, as two network namespaces joined by one cable: nothing is configured but ROS_MASTER_URI."""

import json
import os
import pty
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

pytest.importorskip("rospy")

from processes import Processes
from waiting import PATIENCE_S, wait_for

pytestmark = [pytest.mark.ros, pytest.mark.light]

ROBOT, LAPTOP = "10.77.31.1", "10.77.31.2"
MASTER = f"http://{ROBOT}:11311"

BRINGUP = """
import sys
from vsx_ros.ros import launch
launch.start(launch.xml(launch.emulation("lab", 1, sys.argv[1]), {}), quiet=True).spin()
"""
LISTENER = """
import sys, urllib.request
page = urllib.request.urlopen(sys.argv[1]).read().decode()
assert "<html" in page
said = ""
with urllib.request.urlopen(sys.argv[1].partition("#")[0].rstrip("/") + "/events") as events:
    while "mobile_base: " not in said:
        said += events.readline().decode()
print(said)
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=PATIENCE_S)


class Machines(NamedTuple):
    robot: Processes
    laptop: Processes


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    """Skips where this kernel or user may not make networks."""
    robot, laptop = f"vsx-robot-{os.getpid()}", f"vsx-laptop-{os.getpid()}"
    try:
        ip("netns", "add", robot)
        ip("netns", "add", laptop)
        ip("-n", robot, "link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", laptop)
    except (OSError, subprocess.CalledProcessError) as error:
        subprocess.run(["ip", "netns", "delete", robot], capture_output=True, check=False)
        pytest.skip(f"no network namespaces here: {getattr(error, 'stderr', None) or error}")
    for name, address in ((robot, ROBOT), (laptop, LAPTOP)):
        ip("-n", name, "address", "add", f"{address}/24", "dev", "eth0")
        ip("-n", name, "link", "set", "eth0", "up")
        ip("-n", name, "link", "set", "lo", "up")
    made = Machines(*(Processes(tmp_path, MASTER, ["ip", "netns", "exec", name]) for name in (robot, laptop)))
    yield made
    made.laptop.end()
    made.robot.end()
    for name in (robot, laptop):
        ip("netns", "delete", name)


def test_the_laptop_watches_and_drives_the_robot(machines: Machines, tmp_path: Path) -> None:
    robot, laptop = machines
    devices = tmp_path / "devices"
    devices.mkdir()
    robot.start("robot", sys.executable, "-c", BRINGUP, str(devices))
    view = [sys.executable, "-m", "vsx_ros.cli.main", "view", "--headless"]
    laptop.start("view", *view)

    def facts() -> dict[str, object]:
        said = laptop.vsx("status", "--json").stdout
        return dict(json.loads(said)) if said else {}

    laptop.wait(lambda: facts().get("battery_fraction"), "the robot's battery on the laptop")
    [url] = re.findall(r"live view: (\S+)", (tmp_path / "view.txt").read_text())
    events = laptop.run(sys.executable, "-c", LISTENER, url)
    assert "mobile_base: " in events.stdout, events.stderr + laptop.logs()

    ours, theirs = pty.openpty()
    teleop = subprocess.Popen(
        ["ip", "netns", "exec", f"vsx-laptop-{os.getpid()}", sys.executable, "-m", "vsx_ros.cli.main", "teleop"],
        env=laptop.environment, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True,
    )  # fmt: skip
    try:
        watch = laptop.start("odom", "rostopic", "echo", "/odom/twist/twist/linear/x", ROS_IP=LAPTOP)

        def drives() -> bool:
            assert watch.poll() is None, laptop.logs()
            os.write(ours, b"\x1b[A")
            speeds = [float(x) for x in re.findall(r"^-?\d[\d.e-]*$", (tmp_path / "odom.txt").read_text(), re.M)]
            return max(speeds, default=0.0) > 0.05

        wait_for(drives, "the robot to drive", laptop.logs, 0.05)
    finally:
        teleop.kill()
        teleop.wait()
        os.close(ours)
        os.close(theirs)
