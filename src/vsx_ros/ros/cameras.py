"""Cameras by name, for the node ``camera``: what each needs to know, and how it is opened."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.protocol import MODES
from vsx_hw.kinect.socket_transport import SocketTransport
from vsx_hw.kinect.transport import KinectTransport
from vsx_hw.kinect.usb_transport import UsbTransport
from vsx_hw.readings import ImageReading, LinkStatus
from vsx_hw.v4l import V4lCamera
from vsx_ros.errors import ConfigError
from vsx_ros.registry import Registry
from vsx_ros.ros.topic_camera import TopicCamera


class Camera(Protocol):
    """A driver: images come on a thread of its own. One that knows its calibration has ``calibration``, too."""

    serial: str
    """Names the calibration file."""

    def start(self) -> None:
        """Begin connecting; returns at once."""

    def status(self) -> LinkStatus:
        """Health; counts ``frames``."""

    def close(self) -> object:
        """Release the device."""


class CameraSettings(NamedTuple):
    """name: what stands behind the colon of ~device. mode, lock_exposure: of a Kinect."""

    name: str
    on_image: Callable[[ImageReading], None]
    mode: str = "vga"
    lock_exposure: bool = False


def _kinect(device: str, transport: Callable[[], KinectTransport], wanted: CameraSettings) -> Camera:
    if wanted.mode not in MODES:
        raise ConfigError(f"camera ~mode {wanted.mode!r}: give one of {', '.join(MODES)}")
    return KinectCamera(transport, device, wanted.on_image, MODES[wanted.mode], wanted.lock_exposure)


def _on_usb(wanted: CameraSettings) -> Camera:
    device = f"kinect:{wanted.name}" if wanted.name else "kinect"
    return _kinect(device, lambda: UsbTransport(wanted.name), wanted)


def _emulated(wanted: CameraSettings) -> Camera:
    if not wanted.name:
        raise ConfigError("camera emulator: give its socket, emulator:SOCKET")
    return _kinect(f"emulator:{wanted.name}", lambda: SocketTransport(wanted.name), wanted)


def _v4l(wanted: CameraSettings) -> Camera:
    if not wanted.name.isdigit():
        raise ConfigError(f"camera v4l:{wanted.name}: give the number N of /dev/videoN, e.g. v4l:0")
    return V4lCamera(int(wanted.name), wanted.on_image)


CAMERAS: Registry[Callable[[CameraSettings], Camera]] = Registry(
    "camera",
    {
        "kinect": _on_usb,
        "emulator": _emulated,
        "v4l": _v4l,
        "ros": lambda wanted: TopicCamera(wanted.name, wanted.on_image),
    },
)


def open_camera(
    device: str, on_image: Callable[[ImageReading], None], mode: str = "vga", lock_exposure: bool = False
) -> Camera:
    """The driver of a ~device, KIND or KIND:NAME; it connects when started. Raises ConfigError for one without
    meaning."""
    kind, _, name = device.partition(":")
    return CAMERAS[kind](CameraSettings(name, on_image, mode, lock_exposure))
