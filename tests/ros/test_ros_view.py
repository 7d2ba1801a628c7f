"""``vsx view``: before there is a stack, and across the end of one."""

import os
import re
import subprocess
import sys
import xmlrpc.client
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE, Chromium
from ros_ports import HOST, free_port
from waiting import wait_for

from vsx_ros.cli import main

pytestmark = [pytest.mark.ros, pytest.mark.light]


class Machine:
    """A master that comes and goes, and the view beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.uri = f"http://{HOST}:{free_port()}"
        self.port = free_port()
        self._environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_HOSTNAME": HOST,
            "ROS_HOME": str(folder),
            "ROS_LOG_DIR": str(folder),
            "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        }
        self._processes: list[subprocess.Popen[bytes]] = []
        self.log = folder / "view.txt"

    def start(self, *command: str) -> subprocess.Popen[bytes]:
        with self.log.open("ab") as log:
            process = subprocess.Popen(command, env=self._environment, stdout=log, stderr=log, start_new_session=True)
        self._processes.append(process)
        return process

    def start_master(self) -> subprocess.Popen[bytes]:
        return self.start("rosmaster", "--core", "-p", self.uri.rsplit(":", 1)[1])

    def knows_the_view(self) -> bool:
        try:
            _, _, (_, _, services) = xmlrpc.client.ServerProxy(self.uri).getSystemState("/test")
        except OSError:
            return False
        return any(node.startswith("/view_") for _, nodes in services for node in nodes)

    def wait(self, condition: Callable[[], object], what: str) -> None:
        wait_for(condition, what, self.log.read_text, 0.1)

    def end(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    made = Machine(tmp_path)
    yield made
    made.end()


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_it_waits_for_a_stack_and_outlives_it(machine: Machine, tmp_path: Path) -> None:
    machine.start(sys.executable, "-m", "vsx_ros.cli.main", "view", "--headless", "--port", str(machine.port))
    machine.wait(lambda: "waiting for a ROS master" in machine.log.read_text(), "its words")
    master = machine.start_master()
    machine.wait(machine.knows_the_view, "the view to join")
    [url] = re.findall(r"live view: (\S+)", machine.log.read_text())
    with Chromium(tmp_path / "profile") as browser:
        browser.open(url)
        browser.wait("known.stack === true && $('banner').hidden")
        master.kill()
        master.wait()
        browser.wait("$('banner').textContent.includes('master is away')")
        machine.start_master()
        machine.wait(machine.knows_the_view, "the view to join again")
        browser.wait("known.stack === true && $('banner').hidden")
        # The same token serves; nobody answers behind the button.
        browser.evaluate("document.querySelector('[data-command=pause]').click()")
        browser.wait("$('said').textContent.includes('/explore/pause')")
    assert len(re.findall(r"live view: ", machine.log.read_text())) == 1


@pytest.mark.parametrize("port", ["0", "65536", "-1"])
def test_an_impossible_port_is_named(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.execute(["view", "--port", port]) == 1
    assert f"--port {port}" in capsys.readouterr().err


def test_lock_step_has_no_view(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.execute(["explore", "--fast", "--view"]) == 1
    assert "--view" in capsys.readouterr().err
