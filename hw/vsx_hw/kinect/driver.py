"""The Kinect's colour camera: opens it, starts the stream, revives it, and hands over complete images."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol

import cv2
import numpy as np

from vsx_hw.cameras import FROZEN, FrozenImageDetector
from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceNotFound, DeviceTimeout
from vsx_hw.kinect import protocol
from vsx_hw.kinect.protocol import CLOCK_BITS, CLOCK_HZ, FrameAssembler, PacketHandler, RawFrame
from vsx_hw.readings import DeviceClock, ImageReading, LinkStatus

logger = logging.getLogger(__name__)

REPLY_TIMEOUT_S = 0.5  # of a control message
REVIVE_AFTER_S = 5.0  # without an image: the stream is restarted
LOCK_AFTER_S = 2.0  # of images: the automatic exposure has settled
BACKOFF_S = (0.5, 1.0, 2.0)  # between tries to open it

_USB_PORT = "usb-"
"""Begins what stands for a serial number that cannot be read (``video_names.port_name``)."""

_FULL_RANGE = np.clip((np.arange(256) - 16) * 255.0 / 219.0 + 0.5, 0, 255).astype(np.uint8)
"""Maps luma 16..235 of the camera's UYVY to 0..255 (ITU-R BT.601)."""


class KinectTransport(Protocol):
    """An open camera. Every method raises DeviceError once the camera is lost."""

    serial: str
    """Serial number or a substitute; names the calibration file."""
    failure: str
    """Why the stream has ended; empty while it runs."""

    def control_out(self, data: bytes) -> None:
        """Send a control message."""

    def control_in(self, size: int) -> bytes:
        """The answer, at most size bytes; empty while the camera has none."""

    def start_iso(self, handler: PacketHandler) -> None:
        """Begin to receive packets."""

    def stop_iso(self) -> None:
        """Stop receiving; the handler is not called after the return."""

    def close(self) -> None:
        """Release the camera; may be called twice."""


class KinectCamera(ConnectionThread):
    """Calls ``on_image`` with images of one mode, on the transport's thread.

    A stream without a new image for five seconds is restarted. A camera that vanishes is reopened with growing pauses.
    A repeated image is not delivered. Exposure and white balance are automatic in a new stream; lock_exposure: after
    two seconds of images they are locked.

    ``serial`` is that of the first camera; another one that comes in its place is refused."""

    def __init__(
        self, open_transport: Callable[[], KinectTransport], device: str, on_image: Callable[[ImageReading], None],
        mode: protocol.StreamMode = protocol.VGA_BAYER, lock_exposure: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(device, self._open, BACKOFF_S)
        self._open_transport, self._on_image, self._mode = open_transport, on_image, mode
        self._lock_wanted = self._lock_pending = lock_exposure
        self._tag = 0
        self._counters = Counter(revivals=0, frames=0, torn_frames=0, bad_packets=0, frozen_frames=0)
        self._restart()
        self._fault: Exception | None = None
        self._frozen_detector = FrozenImageDetector()
        self.serial = ""

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        counters = {**self._counters, "exposure_locked": int(self._locked)}
        return self._status(self.serial or self._name, counters)

    def _open(self) -> KinectTransport:
        transport = self._open_transport()
        found = transport.serial
        if _surely_another(self.serial, found):
            transport.close()
            raise DeviceNotFound(f"{self._name} is {found} now; plug {self.serial} in as before, or start anew")
        if not self.serial or self.serial.startswith(_USB_PORT):
            self.serial = found or self.serial
        return transport

    def _serve(self, transport: KinectTransport) -> None:
        self._fault = None
        self._begin(transport)
        while not self.closing.wait(0.1):
            if self._fault is not None:
                raise self._fault
            if transport.failure:
                raise DeviceError(transport.failure)
            if time.monotonic() - self._last_image_s > REVIVE_AFTER_S:
                self._revive(transport)
            elif self._lock_pending and 0.0 < self._streaming_since_s < time.monotonic() - LOCK_AFTER_S:
                self._lock_pending = False
                self._locked = self._set_automatic(transport, False)

    def _restart(self) -> None:
        """Reset the state for a new stream."""
        self._assembler = FrameAssembler(self._mode, self._counters)
        self._clock = DeviceClock(CLOCK_HZ, CLOCK_BITS)
        self._last_image_s, self._streaming_since_s = time.monotonic(), 0.0
        self._lock_pending, self._locked = self._lock_wanted, False

    def _revive(self, transport: KinectTransport) -> None:
        self._counters["revivals"] += 1
        self.report(False, f"{self._name}: no image for {REVIVE_AFTER_S:.0f} s; starting the stream again")
        self._leave(transport)
        self._begin(transport)

    def _begin(self, transport: KinectTransport) -> None:
        """Receive first, then switch on; in the other order the first packets are lost."""
        self._restart()
        transport.start_iso(self._on_packets)
        self._write(transport, self._mode.start)
        self._set_automatic(transport, True)  # an earlier stream or program may have locked it

    def _leave(self, transport: KinectTransport) -> None:
        """Switch off first, then stop receiving. What was locked is automatic for the next program: the sensor would
        keep it until it loses its power."""
        if self._locked and self.closing.is_set():
            self._set_automatic(transport, True)
        try:
            self._write(transport, protocol.STOP)
        finally:
            transport.stop_iso()

    def _set_automatic(self, transport: KinectTransport, on: bool) -> bool:
        """Switch automatic exposure and white balance on, or off: locked. Returns whether the sensor says that they
        are; one that refuses is left as it is."""
        address, bits = protocol.EXPOSURE_MODES, protocol.AUTOMATIC_EXPOSURE | protocol.AUTOMATIC_WHITE_BALANCE
        wanted, problem = bits if on else 0, "the sensor keeps its modes"
        try:
            modes = self._ask(transport, protocol.CMOS_REGISTER, 1, address, 0)[2]
            if modes & bits == wanted:
                return True
            self._ask(transport, protocol.CMOS_REGISTER, 1, address | protocol.CMOS_WRITE, modes & ~bits | wanted)
            if self._ask(transport, protocol.CMOS_REGISTER, 1, address, 0)[2] & bits == wanted:
                return True
        except (DeviceError, IndexError) as error:
            problem = str(error)
        logger.warning("%s: exposure cannot be made %s (%s)", self._name, "automatic" if on else "fixed", problem)
        return False

    def _write(self, transport: KinectTransport, registers: Iterable[protocol.Register]) -> None:
        for register in registers:
            self._ask(transport, protocol.WRITE_REGISTER, *register)

    def _ask(self, transport: KinectTransport, command: int, *words: int) -> tuple[int, ...]:
        """Send a message and return the words of its reply. The camera has no reply until it is done: poll until the
        timeout."""
        transport.control_out(protocol.encode_message(command, self._tag, *words))
        deadline = time.monotonic() + REPLY_TIMEOUT_S
        while time.monotonic() < deadline:
            reply = transport.control_in(protocol.REPLY_BYTES)
            if reply:
                answer = protocol.decode_reply(reply, command, self._tag)
                self._tag = (self._tag + 1) & 0xFFFF
                return answer
            time.sleep(0.001)
        raise DeviceTimeout(f"{self._name}: no answer in {REPLY_TIMEOUT_S} s; check its 12 V supply and replug it")

    def _on_packets(self, arrival_ns: int, packets: list[bytes]) -> None:
        """Runs on the transport's thread, where an exception would be lost: the driver's own thread raises it."""
        try:
            for frame in self._assembler.feed(arrival_ns, packets):
                self._hand_over(frame)
        except Exception as error:
            self._fault = error

    def _hand_over(self, frame: RawFrame) -> None:
        if self._frozen_detector.is_frozen(frame.image):
            self._counters["frozen_frames"] += 1
            self.report(False, f"{self._name}: {FROZEN}")
            return
        self._last_image_s = time.monotonic()
        self._streaming_since_s = self._streaming_since_s or self._last_image_s
        self.report(True, "streaming")
        stamp_ns = self._clock.host_ns(frame.clock_ticks, frame.first_arrival_ns)
        if frame.image.ndim == 2:
            self._on_image(ImageReading(stamp_ns, frame.image))
        else:
            luma = cv2.cvtColor(frame.image, cv2.COLOR_YUV2GRAY_UYVY)
            self._on_image(ImageReading(stamp_ns, _FULL_RANGE[luma], "mono8"))


def _surely_another(first: str, found: str) -> bool:
    """Whether these serial numbers are of two cameras. A number and a port tell nothing of each other: the audio part,
    which may have the number, can be late or fail."""
    is_same_kind = first.startswith(_USB_PORT) == found.startswith(_USB_PORT)
    return bool(first and found) and is_same_kind and found != first
