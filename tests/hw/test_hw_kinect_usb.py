"""A computer that cannot open its USB is told what to do; the driver tries again as for any missing camera."""

from __future__ import annotations

import pytest
import usb1

from vsx_hw.errors import DeviceNotFound
from vsx_hw.kinect.usb_transport import UsbTransport


@pytest.mark.parametrize(
    ("failure", "remedy"), [(FileNotFoundError("libusb-1.0"), "libusb-1.0-0"), (usb1.USBErrorAccess(), "permission")]
)
def test_what_keeps_libusb_from_starting_is_a_missing_camera(
    failure: Exception, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: usb1.USBContext) -> None:
        raise failure

    monkeypatch.setattr(usb1.USBContext, "open", fail)
    with pytest.raises(DeviceNotFound, match=remedy):
        UsbTransport()
