"""A Kinect on the USB: control transfers and 32 isochronous transfers of 32 packets in flight (128 ms), by libusb1.

The audio part of newer models (1473, for Windows) has the lamp, and the serial number that their camera lacks. Source:
libfreenect (facts only). The camera streams without it; some units freeze unless the lamp is lit once."""

import contextlib
import logging
import struct
import threading
import time
from typing import Any

import usb1

from vsx_hw.errors import DeviceError, DeviceNotFound, DeviceTimeout
from vsx_hw.kinect.protocol import PACKET_BYTES, PacketHandler
from vsx_hw.video_names import port_name

logger = logging.getLogger(__name__)

FIRST_MODEL = 0x010B  # bcdDevice of the camera of model 1414; every other value is a newer one
AUDIO_PARTS = ((0x045E, 0x02AD), (0x045E, 0x02BE), (0x045E, 0x02BB), (0x045E, 0x02C3))  # USB ids
_LAMP_MAGIC, _SET_LAMP, GREEN = 0x06022009, 0x10, 3  # libfreenect
_LAMP_TIMEOUT_MS = 200  # a lamp is not worth waiting for

XBOX = (0x045E, 0x02AE)  # USB vendor and product
KINECT_FOR_WINDOWS = (0x045E, 0x02BF)  # as above
VIDEO_ENDPOINT = 0x81  # isochronous, to the host
TRANSFERS, PACKETS = 32, 32  # each of 4 ms: a host may be late by 128 ms
CONTROL_TIMEOUT_MS = 500  # answers take some ms

_REMEDIES = {
    usb1.USBErrorAccess: "permission denied; install the udev rule (hw/udev) and replug the camera",
    usb1.USBErrorBusy: "in use, probably by the kernel's gspca_kinect; run 'sudo rmmod gspca_kinect' and blacklist it",
    usb1.USBErrorNoDevice: "unplugged; check the cable and the 12 V supply",
    usb1.USBErrorNotFound: "vanished while opening; check the 12 V supply and replug it",
    usb1.USBErrorIO: "no bandwidth or a bad cable; give it a USB port of its own, without a hub",
    usb1.USBErrorNoMem: "no USB memory; raise /sys/module/usbcore/parameters/usbfs_memory_mb",
}
ABSENT = "no Kinect on the USB; plug it in and check its 12 V supply (on a TurtleBot 1 the base must be awake)"


def remedy(error: usb1.USBError) -> str:
    """One sentence for a libusb error."""
    return _REMEDIES.get(type(error), f"USB error {error}; replug the camera")


def lamp_message(tag: int, color: int) -> bytes:
    """Five little-endian words: magic, tag, length of data, command, colour (1 off, 2 blinking, 3 green, 4 red)."""
    return struct.pack("<5I", _LAMP_MAGIC, tag, 0, _SET_LAMP, color)


def light_lamp(context: Any) -> str:
    """Light the lamp and return the serial number of the audio part, empty without one. A failure is only logged: a
    number that was read before it stays."""
    for device in context.getDeviceIterator(skip_on_error=True):
        if (device.getVendorID(), device.getProductID()) in AUDIO_PARTS:
            serial = ""
            try:
                with contextlib.closing(device.open()) as handle:
                    serial = str(handle.getSerialNumber() or "")
                    handle.claimInterface(0)
                    handle.bulkWrite(0x01, lamp_message(1, GREEN), _LAMP_TIMEOUT_MS)
                    handle.bulkRead(0x81, 512, _LAMP_TIMEOUT_MS)
            except usb1.USBError as error:
                lacking = "lamp is" if serial else "lamp and serial number are"
                logger.warning("Kinect: %s out of reach (%s); the camera works without", lacking, error)
            return serial
    logger.warning("Kinect: its audio part is missing (lamp, serial number); the camera works without")
    return ""


class UsbTransport:
    """The first Kinect found, or the one with the given serial number; see ``KinectTransport``. Raises DeviceNotFound
    with the remedy when there is none or it cannot be opened."""

    def __init__(self, serial: str = "") -> None:
        self._context = usb1.USBContext()
        try:
            self._context.open()
        except OSError as error:
            raise DeviceNotFound("Kinect: libusb is missing; 'apt-get install libusb-1.0-0' brings it") from error
        except usb1.USBError as error:
            raise DeviceNotFound(f"Kinect: {remedy(error)}") from error
        self._transfers: list[Any] = []
        self._in_flight, self._counting = 0, threading.Lock()
        self.failure = ""
        self._running = threading.Event()
        self._handler: PacketHandler | None = None
        self._handle: Any = None
        self._thread: threading.Thread | None = None
        try:
            self._handle = self._open(serial)
            self._handle.setAutoDetachKernelDriver(True)
            self._handle.claimInterface(0)
            if self._ids == KINECT_FOR_WINDOWS:
                self._handle.setInterfaceAltSetting(0, 1)
        except usb1.USBError as error:
            self.close()
            raise DeviceNotFound(f"Kinect: {remedy(error)}") from error
        except DeviceNotFound:
            self.close()
            raise
        self._running.set()
        self._thread = threading.Thread(target=self._events, name="usb events", daemon=True)
        self._thread.start()

    def _open(self, serial: str) -> Any:
        others = []
        for device in self._context.getDeviceIterator(skip_on_error=True):
            self._ids = (device.getVendorID(), device.getProductID())
            if self._ids not in (XBOX, KINECT_FOR_WINDOWS):
                continue
            handle = device.open()
            self.serial = self._serial_number(device, handle)
            if serial in ("", self.serial):
                return handle
            others.append(self.serial)
            handle.close()
        raise DeviceNotFound(f"no Kinect with serial number {serial}; found {others}" if others else ABSENT)

    def _serial_number(self, device: Any, handle: Any) -> str:
        """The camera's own number; on newer models, whose cameras report zero, that of the audio part. Without either,
        the USB port."""
        serial = str(handle.getSerialNumber() or "")
        if device.getbcdDevice() != FIRST_MODEL:
            serial = light_lamp(self._context) or serial
        if serial.strip("0"):
            return serial
        return port_name(device.getBusNumber(), ".".join(map(str, device.getPortNumberList())))

    def control_out(self, data: bytes) -> None:
        """See KinectTransport."""
        self._control(lambda: self._handle.controlWrite(0x40, 0, 0, 0, data, CONTROL_TIMEOUT_MS))

    def control_in(self, size: int) -> bytes:
        """See KinectTransport."""
        return bytes(self._control(lambda: self._handle.controlRead(0xC0, 0, 0, 0, size, CONTROL_TIMEOUT_MS)))

    @staticmethod
    def _control(action: Any) -> Any:
        try:
            return action()
        except usb1.USBErrorTimeout as error:
            raise DeviceTimeout(f"Kinect: no answer in {CONTROL_TIMEOUT_MS} ms; check its 12 V supply") from error
        except usb1.USBError as error:
            raise DeviceError(f"Kinect: {remedy(error)}") from error

    def start_iso(self, handler: PacketHandler) -> None:
        """See KinectTransport."""
        self._handler = handler
        self.failure = ""
        try:
            for _ in range(TRANSFERS):
                transfer = self._handle.getTransfer(iso_packets=PACKETS)
                transfer.setIsochronous(VIDEO_ENDPOINT, PACKETS * PACKET_BYTES, callback=self._on_transfer)
                self._transfers.append(transfer)
                self._count(+1)
                try:
                    transfer.submit()
                except usb1.USBError:
                    self._count(-1)
                    raise
        except usb1.USBError as error:
            self.stop_iso()
            raise DeviceError(f"Kinect: {remedy(error)}") from error

    def _on_transfer(self, transfer: Any) -> None:
        """Runs on the event thread: hands over the packets and submits the transfer again."""
        arrival_ns = time.time_ns()
        status = transfer.getStatus()
        if status == usb1.TRANSFER_COMPLETED and (handler := self._handler) is not None:
            slots = transfer.iterISO()
            handler(arrival_ns, [bytes(data) for slot_status, data in slots if slot_status == usb1.TRANSFER_COMPLETED])
            try:
                transfer.submit()
                return
            except usb1.USBError as error:
                self.failure = f"Kinect: {remedy(error)}"
        elif status == usb1.TRANSFER_NO_DEVICE:
            self.failure = "Kinect: unplugged; check the cable and the 12 V supply"
        elif status not in (usb1.TRANSFER_COMPLETED, usb1.TRANSFER_CANCELLED):
            self.failure = f"Kinect: transfer ended with status {status}; give it a USB port of its own"
        self._count(-1)

    def _count(self, change: int) -> None:
        with self._counting:
            self._in_flight += change

    def stop_iso(self) -> None:
        """Cancel, and wait for every callback: freeing a transfer in flight crashes. A callback may just have submitted
        its transfer again, so all are cancelled until none is left."""
        self._handler = None
        deadline = time.monotonic() + 2.0
        while self._in_flight > 0 and time.monotonic() < deadline and self._running.is_set():
            for transfer in self._transfers:
                with contextlib.suppress(usb1.USBError):
                    if transfer.isSubmitted():
                        transfer.cancel()
            time.sleep(0.005)
        self._transfers.clear()
        self._in_flight = 0

    def _events(self) -> None:
        try:
            while self._running.is_set():
                self._context.handleEventsTimeout(0.1)
        except usb1.USBError as error:
            self.failure = f"Kinect: {remedy(error)}"
            self._running.clear()

    def close(self) -> None:
        """See KinectTransport."""
        if self._thread is not None:
            self.stop_iso()
            self._running.clear()
            self._thread.join(timeout=1.0)
            self._thread = None
        if self._handle is not None:
            with contextlib.suppress(usb1.USBError):  # gone, or not claimed
                self._handle.releaseInterface(0)  # gives it back to the kernel's driver; closing alone does not
            self._handle.close()
            self._handle = None
        self._context.close()
