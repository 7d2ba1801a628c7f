"""Which camera is behind /dev/videoN: the kernel gives the number to whatever is plugged in next.

Source: Linux, sysfs of USB devices and of video4linux."""

import os
import re
from pathlib import Path

from vsx_hw.errors import DeviceNotFound

MOVING = {"v4l": "rgb_video[0-9]*.yaml", "kinect": "rgb_usb-[0-9]*-[0-9]*.yaml"}
"""Calibrations of earlier versions, by kind of camera: named by the number of /dev/videoN or the USB address."""


def content(path: Path) -> str:
    """A small file of the kernel without the white space around it; empty if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def port_name(bus: int | str, ports: str) -> str:
    """Name of a place on the USB: bus, and the ports from hub to hub such as 1.4. It stays when a device is plugged in
    again; the address does not."""
    return f"usb-{bus}-port{ports}"


def video_number(device: str) -> int:
    """N of the /dev/videoN that ``device`` is or leads to. Raises DeviceNotFound for a link that leads nowhere."""
    found = re.fullmatch(r"/dev/video(\d+)", os.path.realpath(device))
    if found is None:
        raise DeviceNotFound(f"{device} leads to no /dev/videoN; check the cable and 'ls -l /dev/v4l/by-id'")
    return int(found[1])


def video_name(number: int, root: Path = Path("/")) -> str:
    """Vendor, product and serial number of the camera at /dev/videoN; where it has no serial number, the USB port. A
    camera that is not on the USB has the kernel's names. root: root of the file system."""
    entry = root / f"sys/class/video4linux/video{number}"
    interface = (entry / "device").resolve()
    usb, index = interface.parent, content(entry / "index") or "0"
    vendor, product, serial = (content(usb / name) for name in ("idVendor", "idProduct", "serial"))
    if vendor and product:
        own = serial if serial.strip("0") else port_name(*usb.name.split("-", 1))
        function = int(content(interface / "bInterfaceNumber") or "0", 16)
        parts = [vendor, product, own, f"{function}.{index}" if (function, index) != (0, "0") else ""]
    else:
        place = interface.name if (entry / "device").exists() else ""
        parts = [content(entry / "name") or f"video{number}", place, index if index != "0" else ""]
    return re.sub(r"[^\w.-]", "_", "_".join(part for part in parts if part))
