"""The Kinect's colour camera: opens it, starts the stream, revives it, and hands over complete images."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from vsx_hw.clock import DeviceClock
from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_hw.kinect.assembler import FrameAssembler
from vsx_hw.kinect.protocol import (
    CLOCK_BITS,
    CLOCK_HZ,
    REPLY_BYTES,
    START_VGA_BAYER,
    STOP,
    Register,
    check_write_reply,
    encode_write,
)
from vsx_hw.kinect.transport import KinectTransport
from vsx_hw.readings import ImageReading, LinkStatus

logger = logging.getLogger(__name__)

REPLY_TIMEOUT_S = 0.5
REVIVE_AFTER_S = 5.0
BACKOFF_S = (0.5, 1.0, 2.0)


class KinectCamera:
    """640 x 480 Bayer images at 30 Hz to ``on_image``, called on the transport's thread.

    A stream that delivers nothing for five seconds is stopped and started again; a camera that vanishes is opened
    again with growing pauses. Usable as a context manager.
    """

    def __init__(
        self, open_transport: Callable[[], KinectTransport], device: str, on_image: Callable[[ImageReading], None]
    ) -> None:
        self._open_transport = open_transport
        self._device = device
        self._on_image = on_image
        self._closing = threading.Event()
        self._tag = 0
        self._assembler = FrameAssembler()
        self._clock = DeviceClock(CLOCK_HZ, CLOCK_BITS)
        self._last_image_s = 0.0
        self._connected = False
        self._message = "not started"
        self._counters = {"connections": 0, "revivals": 0, "frames": 0, "torn_frames": 0, "bad_packets": 0}
        self.serial = ""
        self._thread = threading.Thread(target=self._run, name=f"camera {device}", daemon=True)

    def __enter__(self) -> KinectCamera:
        """Start."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the stream and close."""
        self.close()

    def start(self) -> None:
        """Begin connecting; returns at once."""
        self._thread.start()

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        return LinkStatus(self._connected, self._message, self.serial or self._device, dict(self._counters))

    def close(self) -> None:
        """Stop the stream and release the camera."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def _run(self) -> None:
        failures = 0
        while not self._closing.is_set():
            try:
                transport = self._open_transport()
                try:
                    self._serve(transport)
                    failures = 0
                finally:
                    self._leave(transport)
            except DeviceError as error:
                failures = 0 if self._connected else failures + 1
                self._report(False, str(error))
                self._closing.wait(BACKOFF_S[min(failures, len(BACKOFF_S) - 1)])

    def _serve(self, transport: KinectTransport) -> None:
        """One connection: until the driver closes or the camera fails."""
        self.serial = transport.serial
        self._counters["connections"] += 1
        self._begin(transport)
        while not self._closing.wait(0.1):
            if transport.failure():
                raise DeviceError(transport.failure())
            if time.monotonic() - self._last_image_s > REVIVE_AFTER_S:
                self._counters["revivals"] += 1
                self._report(False, f"{self._device}: no image for {REVIVE_AFTER_S:.0f} s; starting the stream again")
                self._end(transport)
                self._begin(transport)

    def _begin(self, transport: KinectTransport) -> None:
        """Receive first, then switch on: the other way round the first packets are lost."""
        self._assembler = FrameAssembler()
        self._clock = DeviceClock(CLOCK_HZ, CLOCK_BITS)
        self._last_image_s = time.monotonic()
        transport.start_iso(self._on_packets)
        self._write(transport, START_VGA_BAYER)

    def _end(self, transport: KinectTransport) -> None:
        """Switch off first, then stop receiving."""
        try:
            self._write(transport, STOP)
        finally:
            transport.stop_iso()

    def _leave(self, transport: KinectTransport) -> None:
        try:
            self._end(transport)
        except DeviceError as error:
            logger.debug("%s: not stopped properly (%s)", self._device, error)
        transport.close()

    def _write(self, transport: KinectTransport, registers: Iterable[Register]) -> None:
        for register in registers:
            transport.control_out(encode_write(register, self._tag))
            check_write_reply(self._reply(transport), register, self._tag)
            self._tag = (self._tag + 1) & 0xFFFF

    def _reply(self, transport: KinectTransport) -> bytes:
        """The camera says nothing until it is done; ask again, but not for ever."""
        deadline = time.monotonic() + REPLY_TIMEOUT_S
        while time.monotonic() < deadline:
            reply = transport.control_in(REPLY_BYTES)
            if reply:
                return reply
            time.sleep(0.001)
        raise DeviceTimeout(f"{self._device}: no answer in {REPLY_TIMEOUT_S} s; check its 12 V supply and replug it")

    def _on_packets(self, arrival_ns: int, packets: NDArray[np.uint8], lengths: NDArray[np.int64]) -> None:
        before = dict(self._assembler.counters)
        for frame in self._assembler.feed(arrival_ns, packets, lengths):
            self._last_image_s = time.monotonic()
            self._report(True, "streaming")
            stamp_ns = self._clock.host_ns(frame.clock_ticks, frame.first_arrival_ns)
            self._on_image(ImageReading(stamp_ns, frame.image))
        for name, value in self._assembler.counters.items():
            self._counters[name] += value - before[name]

    def _report(self, connected: bool, message: str) -> None:
        if message != self._message:
            logger.log(logging.INFO if connected else logging.WARNING, "%s: %s", self._device, message)
            self._connected, self._message = connected, message
