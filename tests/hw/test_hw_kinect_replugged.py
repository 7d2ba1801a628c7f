"""The Kinect driver when a camera comes back, or another one in its place."""

import pytest
from hw_scripted_transport import ScriptedTransport
from waiting import wait_for

from vsx_hw.kinect import driver as driver_module
from vsx_hw.kinect.driver import KinectCamera


class NamedTransport(ScriptedTransport):
    """One of several cameras; lost when ``failure`` says so."""

    def __init__(self, serial: str) -> None:
        super().__init__([])
        self.serial, self.failure = serial, ""


@pytest.fixture
def plugged(monkeypatch):
    """The cameras that are opened one after the other; the last one is opened again and again."""
    monkeypatch.setattr(driver_module, "BACKOFF_S", (0.01,))

    def open_next() -> NamedTransport:
        opened.append(NamedTransport(waiting[0] if len(waiting) == 1 else waiting.pop(0)))
        return opened[-1]

    waiting: list[str] = []
    opened: list[NamedTransport] = []
    return waiting, opened, KinectCamera(open_next, "kinect", lambda reading: None)


def serves(transport: NamedTransport) -> bool:
    return "47000000" in transport.log


def lose_the_first(opened: list[NamedTransport]) -> None:
    wait_for(lambda: opened and serves(opened[0]))
    opened[0].failure = "unplugged"


def test_another_camera_in_the_place_of_the_first_is_refused_until_that_is_back(plugged):
    """SLAM would go on with the first one's calibration."""
    waiting, opened, camera = plugged
    waiting += ["A", "B"]
    with camera:
        lose_the_first(opened)
        wait_for(lambda: camera.status().message == "kinect is B now; plug A in as before, or start anew")
        wait_for(lambda: len(opened) > 3, "it keeps trying")
        assert not camera.status().connected
        assert camera.serial == camera.status().device == "A"
        waiting += ["A"]
        wait_for(lambda: opened[-1].serial == "A" and serves(opened[-1]))
    for refused in opened[1:-1]:
        assert (refused.serial, refused.log) == ("B", ["close"]), "it is left as it is"


@pytest.mark.parametrize(
    ("serials", "kept"),
    [
        (("A", ""), "A"),
        (("", "A"), "A"),
        (("A", "usb-1-port2"), "A"),
        (("usb-1-port2", "A"), "A"),
        (("usb-1-port2", "usb-1-port2"), "usb-1-port2"),
    ],
)
def test_a_camera_whose_serial_number_cannot_be_read_each_time_is_used(plugged, serials, kept):
    waiting, opened, camera = plugged
    waiting += serials
    with camera:
        lose_the_first(opened)
        wait_for(lambda: len(opened) == 2 and serves(opened[1]))
        assert camera.serial == kept


def test_a_camera_that_is_known_by_its_port_stays_there(plugged):
    waiting, opened, camera = plugged
    waiting += ["usb-1-port2", "usb-1-port3"]
    with camera:
        lose_the_first(opened)
        wait_for(lambda: "kinect is usb-1-port3 now; plug usb-1-port2 in" in camera.status().message)
