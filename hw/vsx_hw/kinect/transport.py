"""What the Kinect driver needs of a connection; made by ``usb_transport`` and ``socket_transport``."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

PacketHandler = Callable[[int, NDArray[np.uint8], NDArray[np.int64]], None]
"""Called with the host time of arrival [ns], packets (N, 1920) and their lengths (N,), on the transport's thread.
The arrays are valid during the call only."""


class KinectTransport(Protocol):
    """An open camera. Every method raises DeviceError once the camera is lost."""

    serial: str
    """Serial number, or what stands for it; names the calibration file."""
    failure: str
    """Why the stream has ended, empty while it has not."""

    def control_out(self, data: bytes) -> None:
        """Send a control message."""

    def control_in(self, size: int) -> bytes:
        """The answer, at most size bytes; empty while the camera has none."""

    def start_iso(self, handler: PacketHandler) -> None:
        """Begin to receive packets."""

    def stop_iso(self) -> None:
        """Receive no more; the handler is not called after the return."""

    def close(self) -> None:
        """Let go of the camera; may be called twice."""
