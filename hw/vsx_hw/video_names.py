"""Which camera is behind /dev/videoN: the kernel gives the number to whatever is plugged in next.

Sources: Linux, sysfs of USB devices and of video4linux; Linux media documentation, VIDIOC_QUERYCAP."""

import fcntl
import os
import re
import struct
from pathlib import Path

from vsx_hw.errors import DeviceNotFound

FORMER = {"v4l": "rgb_video[0-9]*.yaml", "kinect": "rgb_usb-[0-9]*-[0-9]*.yaml", "ros": "rgb_*_compressed.yaml"}
"""Calibrations of earlier versions, by kind of camera: named by the number of /dev/videoN, the USB address, or how a
topic carries its images."""

_QUERYCAP = 0x80685600  # answers: driver, card, bus_info, version, capabilities, device_caps, reserved
_CAPABILITIES = struct.Struct("=16s32s32s3I12x")
_CAPTURE, _CAPTURE_PLANES, _DEVICE_CAPS = 0x1, 0x1000, 0x80000000


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


def gives_images(device: Path) -> bool:
    """Whether /dev/videoN takes images, unlike the metadata of a webcam or a codec. Opens it; what does not answer may
    be a camera."""
    try:
        handle = os.open(device, os.O_RDWR | os.O_NONBLOCK)
    except OSError:
        return True
    try:
        answer = fcntl.ioctl(handle, _QUERYCAP, bytes(_CAPABILITIES.size))
    except OSError:
        return True
    finally:
        os.close(handle)
    *_, all_of_it, of_this = _CAPABILITIES.unpack(answer)
    return bool((of_this if all_of_it & _DEVICE_CAPS else all_of_it) & (_CAPTURE | _CAPTURE_PLANES))


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
