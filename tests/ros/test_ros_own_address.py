"""How nodes call themselves where nobody told them."""

import os
import socket

import pytest

from vsx_ros.ros.environment import export_ros_address, host_address


@pytest.mark.parametrize(
    "master", ["http://localhost:11311", "http://127.0.0.1:11399", "http://no-such-host.invalid:1", "?"]
)
def test_a_master_here_or_nowhere_is_met_as_localhost(master):
    assert host_address(master) == "localhost"


def test_a_master_elsewhere_is_met_by_an_address_of_this_machine():
    address = host_address("http://192.0.2.7:11311")
    if address != "localhost":  # a machine without a network has no other
        with socket.socket() as probe:
            probe.bind((address, 0))
        assert not address.startswith("127.")


@pytest.mark.parametrize("said", ["ROS_IP", "ROS_HOSTNAME"])
def test_what_the_user_said_stands(said, monkeypatch):
    monkeypatch.delenv("ROS_IP", raising=False)
    monkeypatch.delenv("ROS_HOSTNAME", raising=False)
    monkeypatch.setenv(said, "robot")
    export_ros_address()
    assert {name: os.environ.get(name) for name in ("ROS_IP", "ROS_HOSTNAME") if name in os.environ} == {said: "robot"}
