"""Nodes that are started as copies of one process: like any child of the run, and started anew when that fails."""

import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

pytest.importorskip("rospy")

from ros_ports import free_port
from waiting import wait_for

from vsx_ros.ros.fork_server import Copy, ForkServer, Request

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture(scope="module")
def server() -> Iterator[ForkServer]:
    with ForkServer() as server:
        yield server


def start(server: ForkServer, folder: Path, name: str, **environment: str) -> Copy | None:
    nobody = {"ROS_MASTER_URI": f"http://localhost:{free_port()}"}
    command = [str(SCRIPTS / name), f"__name:={name}"]
    with (folder / "out").open("wb") as out, (folder / "err").open("wb") as err:
        request = Request(command, {**os.environ, **nobody, **environment}, str(folder))
        return server.start(request, [out.fileno(), err.fileno()])


def test_a_copy_is_a_child_with_its_own_streams_and_exit_code(server: ForkServer, tmp_path: Path) -> None:
    copy = start(server, tmp_path, "camera")
    assert copy is not None
    wait_for(lambda: copy.poll() is not None, "the camera to end without a master")
    assert copy.poll() == 1
    assert "camera: no ROS master answers" in (tmp_path / "err").read_text()
    assert not (tmp_path / "out").read_text()


def test_a_copy_looks_like_the_node_it_is(server: ForkServer, tmp_path: Path) -> None:
    copy = start(server, tmp_path, "dashboard")  # waits for a master
    assert copy is not None
    wait_for(lambda: "dashboard" in shown(copy.pid), "its command line")
    assert shown(copy.pid).split()[1:] == [str(SCRIPTS / "dashboard"), "__name:=dashboard"]
    parent = Path(f"/proc/{copy.pid}/stat").read_text().rpartition(")")[2].split()[1]
    assert int(parent) == os.getpid()
    assert os.getpgid(copy.pid) == copy.pid
    assert os.readlink(f"/proc/{copy.pid}/cwd") == str(tmp_path)
    os.killpg(copy.pid, signal.SIGKILL)
    wait_for(lambda: copy.poll() is not None, "its end")
    assert copy.returncode == -signal.SIGKILL


def shown(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def test_another_program_is_no_copy(server: ForkServer, tmp_path: Path) -> None:
    assert start(server, tmp_path, "teleop") is None


def test_a_killed_server_starts_nothing_and_says_so(tmp_path: Path) -> None:
    with ForkServer() as killed:
        os.kill(killed.pid, signal.SIGKILL)
        assert start(killed, tmp_path, "camera") is None
        assert start(killed, tmp_path, "camera") is None


def test_nodes_live_on_without_their_server(tmp_path: Path) -> None:
    with ForkServer() as server:
        copy = start(server, tmp_path, "dashboard")
        assert copy is not None
    assert copy.poll() is None
    os.kill(copy.pid, signal.SIGKILL)
    wait_for(lambda: copy.poll() == -signal.SIGKILL, "its end")


def test_a_copy_that_nobody_waits_for_does_not_run(tmp_path: Path) -> None:
    """The run has given up and starts the node anew; two would fight for the robot."""
    nobody = {**os.environ, "ROS_MASTER_URI": f"http://localhost:{free_port()}"}
    request = Request([str(SCRIPTS / "camera"), "__name:=camera"], nobody, str(tmp_path))
    with ForkServer() as server, (tmp_path / "err").open("wb") as err:
        socket.send_fds(server._line, [msgspec.json.encode(request)], [err.fileno(), err.fileno()])
        server._line.close()
        wait_for(lambda: not Path(f"/proc/{server.pid}/exe").exists(), "the server to end")
    time.sleep(2.0)
    assert not (tmp_path / "err").read_text(), "it would say that there is no master"


def test_too_long_a_request_is_no_copy(server: ForkServer, tmp_path: Path) -> None:
    assert start(server, tmp_path, "camera", LONG="x" * 200_000) is None
    assert start(server, tmp_path, "camera") is not None
