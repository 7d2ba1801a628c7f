"""The driver's end of an emulated Kinect."""

import contextlib
import queue
import socket
import threading

from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.kinect import wire
from vsx_hw.kinect.transport import PacketHandler

REPLY_WAIT_S = 0.5


class SocketTransport:
    """Connects to the emulator's socket; see ``KinectTransport``. Raises DeviceNotFound when no emulator listens
    there."""

    serial = "emulated"

    def __init__(self, path: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(path)
        except OSError as error:
            self._socket.close()
            raise DeviceNotFound(f"{path}: no emulated Kinect there ({error.strerror}); start the emulator") from error
        self._replies: queue.Queue[bytes] = queue.Queue()
        self._handler: PacketHandler | None = None
        self._handing_over = threading.Lock()
        self.failure = ""
        self._closed = False
        self._thread = threading.Thread(target=self._listen, name="emulated usb", daemon=True)
        self._thread.start()

    def control_out(self, data: bytes) -> None:
        """See KinectTransport."""
        wire.send(self._socket, wire.CONTROL_OUT, data)

    def control_in(self, size: int) -> bytes:
        """See KinectTransport."""
        wire.send(self._socket, wire.CONTROL_IN, size.to_bytes(2, "little"))
        try:
            return self._replies.get(timeout=REPLY_WAIT_S)
        except queue.Empty:
            return b""

    def start_iso(self, handler: PacketHandler) -> None:
        """See KinectTransport."""
        self._handler = handler
        wire.send(self._socket, wire.START)

    def stop_iso(self) -> None:
        """See KinectTransport."""
        with self._handing_over:
            self._handler = None
        wire.send(self._socket, wire.STOP)

    def close(self) -> None:
        """See KinectTransport."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)
            self._thread.join(timeout=1.0)
            self._socket.close()

    def _listen(self) -> None:
        try:
            while True:
                kind, body = wire.receive(self._socket)
                if kind == wire.REPLY:
                    self._replies.put(body)
                elif kind == wire.PACKETS:
                    message = wire.decode_packets(body)
                    with self._handing_over:
                        if self._handler is not None:
                            self._handler(*message)
        except DeviceError as error:
            self.failure = str(error)
