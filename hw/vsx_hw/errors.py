"""Errors of devices. Every message names the device, the value found and the remedy."""


class DeviceError(Exception):
    """Base class of all errors that vsx_hw raises on purpose; a driver then closes the device and reopens it."""


class DeviceNotFound(DeviceError):  # noqa: N818 (says what it is, like FileNotFound)
    """The device is absent, busy or may not be opened."""


class OtherSize(DeviceError):  # noqa: N818 (says what it is, too)
    """A camera gives images, but not of the size asked for. width, height [px]: what it gives."""

    def __init__(self, text: str, width: int, height: int) -> None:
        super().__init__(text)
        self.width, self.height = width, height


class DeviceTimeout(DeviceError, TimeoutError):  # noqa: N818 (as socket.timeout)
    """The device did not answer in time."""


class ProtocolError(DeviceError, ValueError):
    """A message or a value that the protocol does not allow."""
