"""The doctor's checks of the ROS network against real masters, one of them with a clock of its own."""

import http.server
import os
import subprocess
import threading
import time
from collections.abc import Iterator
from email.utils import formatdate

import pytest
from free_ports import free_port
from waiting import wait_for

from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding
from vsx_ros.cli.doctor import check_network


def network(**environment: str) -> dict[str, Finding]:
    return {finding.area: finding for finding in check_network(environment)}


@pytest.fixture(scope="module")
def master(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    rosgraph = pytest.importorskip("rosgraph")
    port, folder = free_port(), tmp_path_factory.mktemp("ros")
    uri = f"http://localhost:{port}"
    environment = {**os.environ, "ROS_MASTER_URI": uri, "ROS_HOSTNAME": "localhost", "ROS_LOG_DIR": str(folder)}
    command = ["rosmaster", "--core", "-p", str(port)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_for(lambda: rosgraph.is_master_online(uri), "the master")
        yield uri
        process.terminate()


@pytest.mark.ros
@pytest.mark.light
def test_a_master_that_runs(master: str) -> None:
    found = network(ROS_MASTER_URI=master, ROS_HOSTNAME="localhost")
    assert {area: finding.level for area, finding in found.items()} == {"hostname": OK, "master": OK, "clock": OK}
    assert master in found["master"].text


@pytest.mark.ros
@pytest.mark.light
def test_simulated_time_without_a_clock_is_told(master: str) -> None:
    import rosgraph

    rosgraph.Master("/test", master).setParam("/use_sim_time", True)
    try:
        clock = network(ROS_MASTER_URI=master, ROS_HOSTNAME="localhost")["clock"]
    finally:
        rosgraph.Master("/test", master).deleteParam("/use_sim_time")
    assert clock.level == WARN
    assert "rosparam delete" in clock.remedy


class _Late(http.server.BaseHTTPRequestHandler):
    """A master whose clock is a minute behind."""

    def do_POST(self) -> None:  # noqa: N802 - the server's name for it
        import xmlrpc.client

        body = xmlrpc.client.dumps(((1, "", []),), methodresponse=True).encode()
        self.send_response_only(200)
        self.send_header("Date", formatdate(time.time() - 60.0, usegmt=True))
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


def test_a_master_with_another_clock_is_told() -> None:
    with http.server.HTTPServer(("localhost", 0), _Late) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        clock = network(ROS_MASTER_URI=f"http://localhost:{server.server_port}")["clock"]
        server.shutdown()
    assert clock.level == FAIL
    assert "-60 s" in clock.text or "-61 s" in clock.text


def test_nobody_at_home_is_no_fault() -> None:
    assert network(ROS_MASTER_URI=f"http://localhost:{free_port()}")["master"].level == NOTE


@pytest.mark.parametrize("uri", ["localhost", "http://", "http://host:port"])
def test_a_master_uri_that_is_none(uri: str) -> None:
    found = network(ROS_MASTER_URI=uri)["master"]
    assert found.level == FAIL
    assert uri in found.text


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ({"ROS_MASTER_URI": "http://robot.invalid:11311"}, "master"),
        ({"ROS_HOSTNAME": "robot.invalid"}, "hostname"),
        ({"ROS_IP": "192.0.2.1"}, "hostname"),
    ],
)
def test_names_without_address_and_addresses_of_others(environment: dict[str, str], said: str) -> None:
    found = network(**{"ROS_MASTER_URI": f"http://localhost:{free_port()}", **environment})[said]
    assert found.level == FAIL
    assert next(iter(environment.values())).removeprefix("http://").split(":")[0] in found.text
    assert found.remedy
