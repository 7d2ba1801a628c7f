"""Broken promises of devices. Every message names the device, the value found and the remedy."""


class DeviceError(Exception):
    """Root of everything vsx_hw raises on purpose; a driver that meets one closes the device and opens it again."""


class DeviceNotFound(DeviceError):  # noqa: N818 (says what it is, like FileNotFound)
    """The device is absent, busy or may not be opened."""


class DeviceTimeout(DeviceError, TimeoutError):  # noqa: N818 (as socket.timeout)
    """The device did not answer in time."""


class ProtocolError(DeviceError, ValueError):
    """A message or a value that the protocol does not allow."""
