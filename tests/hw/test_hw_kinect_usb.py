"""What libusb may answer: each failure has its remedy; the parts of other models; gravity from the motor."""

from __future__ import annotations

import math
from typing import Any

import pytest
import usb1

from vsx_hw.errors import DeviceNotFound, ProtocolError
from vsx_hw.kinect.tilt import decode_tilt_state
from vsx_hw.kinect.usb_transport import UsbTransport, lamp_message, light_lamp, remedy


@pytest.mark.parametrize(
    ("failure", "advice"), [(FileNotFoundError("libusb-1.0"), "libusb-1.0-0"), (usb1.USBErrorAccess(), "permission")]
)
def test_what_keeps_libusb_from_starting_is_a_missing_camera(
    failure: Exception, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: usb1.USBContext) -> None:
        raise failure

    monkeypatch.setattr(usb1.USBContext, "open", fail)
    with pytest.raises(DeviceNotFound, match=advice):
        UsbTransport()


def test_every_failure_has_a_remedy_of_its_own() -> None:
    advice = {
        usb1.USBErrorAccess: "udev rule",
        usb1.USBErrorBusy: "rmmod gspca_kinect",
        usb1.USBErrorNotFound: "12 V",
        usb1.USBErrorIO: "USB port of its own",
        usb1.USBErrorNoMem: "usbfs_memory_mb",
    }
    for kind, words in advice.items():
        assert words in remedy(kind())
    assert len({remedy(kind()) for kind in advice}) == len(advice)


class Part:
    """A device on a scripted bus; ``opened`` is what happens when it is opened."""

    def __init__(self, ids: tuple[int, int], serial: str = "", failure: usb1.USBError | None = None) -> None:
        self.ids, self.serial, self.failure = ids, serial, failure
        self.written: list[bytes] = []
        self.alternatives: list[int] = []
        self.closed = self.released = 0

    def getVendorID(self) -> int:
        return self.ids[0]

    def getProductID(self) -> int:
        return self.ids[1]

    def getbcdDevice(self) -> int:
        return 0x010B if self.ids[1] == 0x02AE and self.serial.strip("0") else 0x0200

    def getBusNumber(self) -> int:
        return 1

    def getDeviceAddress(self) -> int:
        raise AssertionError("it changes whenever the camera is plugged in")

    def getPortNumberList(self) -> list[int]:
        return [1, 4]

    def open(self) -> Part:
        if self.failure is not None and self.ids[1] in (0x02AE, 0x02BF):
            raise self.failure
        return self

    def getSerialNumber(self) -> str:
        return self.serial

    def setAutoDetachKernelDriver(self, enable: bool) -> None:
        assert enable

    def claimInterface(self, interface: int) -> None:
        assert interface == 0

    def setInterfaceAltSetting(self, interface: int, alternative: int) -> None:
        assert interface == 0
        self.alternatives.append(alternative)

    def bulkWrite(self, endpoint: int, data: bytes, timeout: int) -> None:
        assert endpoint == 0x01
        if self.failure is not None:
            raise self.failure
        self.written.append(data)

    def bulkRead(self, endpoint: int, size: int, timeout: int) -> bytes:
        assert endpoint == 0x81
        return bytes(12)

    def releaseInterface(self, interface: int) -> None:
        assert (interface, self.closed) == (0, 0)
        self.released += 1
        if self.failure is not None:
            raise self.failure

    def close(self) -> None:
        self.closed += 1


class Bus:
    """A libusb context with these devices."""

    def __init__(self, *parts: Part) -> None:
        self.parts = parts

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def getDeviceIterator(self, skip_on_error: bool) -> Any:
        return iter(self.parts)

    def handleEventsTimeout(self, seconds: float) -> None:
        pass


@pytest.mark.parametrize(
    "failure", [usb1.USBErrorAccess(), usb1.USBErrorBusy(), usb1.USBErrorNotFound(), usb1.USBErrorIO()]
)
def test_a_camera_that_cannot_be_opened_is_told_with_its_remedy(
    failure: usb1.USBError, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(usb1, "USBContext", lambda: Bus(Part((0x045E, 0x02AE), "A1", failure)))
    with pytest.raises(DeviceNotFound) as told:
        UsbTransport()
    assert remedy(failure) in str(told.value)


def test_the_right_camera_is_opened_by_its_serial_number(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus(Part((0x046D, 0x0825)), Part((0x045E, 0x02AE), "A1"), Part((0x045E, 0x02AE), "A2"))
    monkeypatch.setattr(usb1, "USBContext", lambda: bus)
    camera = UsbTransport("A2")
    assert camera.serial == "A2"
    camera.close()
    camera.close()
    assert [part.closed for part in bus.parts] == [0, 1, 1]
    with pytest.raises(DeviceNotFound, match=r"A3; found \['A1', 'A2'\]"):
        UsbTransport("A3")


@pytest.mark.parametrize("failure", [None, usb1.USBErrorNoDevice(), usb1.USBErrorNotFound()])
def test_a_closed_camera_is_the_kernel_s_again(failure: usb1.USBError | None, monkeypatch: pytest.MonkeyPatch) -> None:
    part = Part((0x045E, 0x02AE), "A1")
    monkeypatch.setattr(usb1, "USBContext", lambda: Bus(part))
    camera = UsbTransport()
    part.failure = failure
    camera.close()
    assert (part.released, part.closed) == (1, 1)


def test_a_kinect_for_windows_needs_its_second_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, audio = Part((0x045E, 0x02BF), "0000000000000000"), Part((0x045E, 0x02BE), "B7")
    monkeypatch.setattr(usb1, "USBContext", lambda: Bus(camera, audio))
    transport = UsbTransport()
    transport.close()
    assert camera.alternatives == [1]
    assert transport.serial == "B7"
    assert audio.written == [lamp_message(1, 3)]


@pytest.mark.parametrize(
    ("audio", "serial", "lacking"),
    [
        ([], "usb-1-port1.4", "audio part is missing"),
        ([Part((0x045E, 0x02AD), "", usb1.USBErrorPipe())], "usb-1-port1.4", "lamp and serial number are"),
        ([Part((0x045E, 0x02AD), "B7", usb1.USBErrorPipe())], "B7", "lamp is"),
        ([Part((0x045E, 0x02AD), "B7", usb1.USBErrorTimeout())], "B7", "lamp is"),
    ],
)
def test_a_newer_camera_works_without_its_audio_part(
    audio: list[Part], serial: str, lacking: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    parts = [Part((0x045E, 0x02AE), "0000000000000000"), *audio]
    monkeypatch.setattr(usb1, "USBContext", lambda: Bus(*parts))
    transport = UsbTransport()
    transport.close()
    assert transport.serial == serial
    (told,) = [r.getMessage() for r in caplog.records if "camera works without" in r.getMessage()]
    assert lacking in told


def test_lamp_bytes() -> None:
    assert lamp_message(1, 3) == bytes.fromhex("09200206 01000000 00000000 10000000 03000000")
    assert light_lamp(Bus(Part((0x045E, 0x02AD), "B7"))) == "B7"


def test_gravity_from_the_motor() -> None:
    level = decode_tilt_state(bytes((0, 0)) + bytes.fromhex("0000 0333 0000") + bytes((246, 0)))
    assert level.gravity_g == (0.0, 1.0, 0.0)
    assert (level.pitch_rad, level.roll_rad, level.tilt_deg) == (0.0, 0.0, -5.0)
    nose_up = decode_tilt_state(bytes((0, 0)) + bytes.fromhex("0000 02C5 019A") + bytes((128, 4)))
    assert math.degrees(nose_up.pitch_rad) == pytest.approx(30.0, abs=0.1)
    assert nose_up.tilt_deg is None
    for junk in (bytes(9), bytes(10)):
        with pytest.raises(ProtocolError, match="motor"):
            decode_tilt_state(junk)
