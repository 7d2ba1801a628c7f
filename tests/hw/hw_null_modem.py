"""A cable from a driver to a test."""

from __future__ import annotations

import threading

from vsx_hw.errors import DeviceError


class LoopbackTransport:
    """One end of a null modem; ``pair`` makes both. ``sever`` pulls the plug."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._arrived = threading.Condition()
        self._peer: LoopbackTransport | None = None
        self._severed = False

    @staticmethod
    def pair() -> tuple[LoopbackTransport, LoopbackTransport]:
        """Two ends; what one writes the other reads."""
        a, b = LoopbackTransport(), LoopbackTransport()
        a._peer, b._peer = b, a
        return a, b

    def read(self, timeout_s: float) -> bytes:
        """See SerialTransport."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._buffer) or self._severed, timeout_s)
            if self._severed:
                raise DeviceError("null modem: severed")
            data = bytes(self._buffer)
            self._buffer.clear()
            return data

    def write(self, data: bytes) -> None:
        """See SerialTransport."""
        peer = self._peer
        if self._severed or peer is None:
            raise DeviceError("null modem: severed")
        with peer._arrived:
            peer._buffer += data
            peer._arrived.notify_all()

    def sever(self) -> None:
        """Cut the cable: both ends fail from now on."""
        for end in (self, self._peer):
            if end is not None:
                with end._arrived:
                    end._severed = True
                    end._arrived.notify_all()

    def close(self) -> None:
        """See SerialTransport."""
        self.sever()
