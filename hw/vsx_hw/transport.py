"""The byte pipe to a base."""

import contextlib
import errno
import termios

import serial

from vsx_hw.errors import DeviceError, DeviceNotFound, DeviceTimeout

WRITE_TIMEOUT_S = 0.1  # a command takes 1 ms at 115200 baud
_FORBIDDEN = "permission denied; install the udev rule or join the group dialout, then log in again"
_IN_USE = "in use by another program; stop it, only one driver may own the port"
_REMEDIES = {
    errno.ENOENT: "no such port; plug the base in, switch it on, and check the name with 'ls /dev/ttyUSB*'",
    **dict.fromkeys((errno.EACCES, errno.EPERM), _FORBIDDEN),
    **dict.fromkeys((errno.EAGAIN, errno.EBUSY), _IN_USE),
}


class SerialTransport:
    """A serial port, locked for this process. RTS and DTR stay low: on a Create, RTS moves the wake-up line. An adapter
    that holds bytes back (FTDI: for 16 ms) is asked to hand them over at once. Raises DeviceNotFound with the remedy
    when the port is absent, forbidden or in use. Every method raises DeviceError once the port is lost."""

    def __init__(self, port: str, baud: int) -> None:
        self.port = port
        self._serial = serial.Serial(baudrate=baud, timeout=0.0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        self._serial.port = port
        self._serial.rts = False
        self._serial.dtr = False
        try:
            self._serial.open()
        except (OSError, termios.error) as error:
            remedy = _REMEDIES.get(getattr(error, "errno", 0), f"cannot be opened ({error})")
            raise DeviceNotFound(f"{port}: {remedy}") from error
        with contextlib.suppress(OSError, ValueError):  # ports without such an adapter refuse it
            self._serial.set_low_latency_mode(True)

    def read(self, timeout_s: float) -> bytes:
        """Returns all bytes that have arrived. Waits at most timeout_s for the first one; empty when none came."""
        try:
            self._serial.timeout = timeout_s
            first: bytes = self._serial.read(1)
            return first + self._serial.read(self._serial.in_waiting) if first else b""
        except (OSError, termios.error, TypeError) as error:
            raise DeviceError(f"{self.port}: lost while reading ({error}); check cable and power") from error

    def write(self, data: bytes) -> None:
        """Send everything or raise; never blocks longer than WRITE_TIMEOUT_S."""
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException as error:
            raise DeviceTimeout(
                f"{self.port}: did not take {len(data)} bytes in {WRITE_TIMEOUT_S} s; unplug and replug it"
            ) from error
        except (OSError, termios.error) as error:
            raise DeviceError(f"{self.port}: lost while writing ({error}); check cable and power") from error

    def close(self) -> None:
        """Release the device; may be called twice."""
        try:
            self._serial.close()
        except (OSError, termios.error):
            return
