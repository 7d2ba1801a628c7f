"""A second, tiny process that stops the wheels when the driver's process dies.

A base may go on driving by its last command for ever. The guardian waits on a pipe; when it breaks without a word (the
driver was killed), it opens the port and sends the stop bytes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

from vsx_hw.errors import DeviceError
from vsx_hw.transport import SerialTransport

RELEASED = b"released"
ATTEMPTS, PAUSE_S = 40, 0.05


class Guardian:
    """The parent's end. Start it before the wheels may turn, ``release`` it after they were stopped."""

    def __init__(self, port: str, baud: int, stop_bytes: bytes) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vsx_hw.guardian", port, str(baud), stop_bytes.hex()],
            stdin=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            start_new_session=True,
        )

    def release(self) -> None:
        """All is well; the guardian ends without touching the port."""
        if self._process.poll() is None:
            self._process.communicate(RELEASED, timeout=2.0)


def watch(port: str, baud: int, stop_bytes: bytes, last_words: bytes) -> bool:
    """What the guardian does once the pipe has ended: True when it stopped the wheels.

    Another driver may have taken the port meanwhile; that one begins by stopping the wheels itself.
    """
    if last_words == RELEASED:
        return False
    for _ in range(ATTEMPTS):
        try:
            transport = SerialTransport(port, baud)
            transport.write(stop_bytes)
            transport.close()
            return True
        except DeviceError:
            time.sleep(PAUSE_S)
    return False


def main() -> None:
    """Port, baud rate and stop bytes in hexadecimal are the arguments."""
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    watch(sys.argv[1], int(sys.argv[2]), bytes.fromhex(sys.argv[3]), sys.stdin.buffer.read())


if __name__ == "__main__":
    main()
