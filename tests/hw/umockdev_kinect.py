"""A Kinect below the real libusb: umockdev hands this process the ioctls of its usbfs node. Run under umockdev-wrapper.

``python umockdev_kinect.py FRAMES PACED UNPLUG_AFTER LOSE REPLUG`` starts the real driver on it and prints a JSON line.
struct usbdevfs_urb of Linux on x86-64: u8 type, u8 endpoint, i32 status at 4, u64 buffer at 16, i32 length at 24,
actual at 28, i32 packets at 36, u64 at 48, then per packet u32 length, actual, status from 56 on.
"""

import json
import queue
import struct
import sys
import threading
import time
from collections import deque

import gi
import numpy as np
from waiting import PATIENCE_S, wait_for

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402 - gi wants the version first

from vsx_hw.kinect.driver import KinectCamera  # noqa: E402 - gi wants the version first
from vsx_hw.kinect.emulator import KinectBoard  # noqa: E402 - gi wants the version first
from vsx_hw.kinect.usb_transport import UsbTransport  # noqa: E402 - gi wants the version first

SERIAL = "A00367A00955107A"
SYSFS = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-1"
NODE = "/dev/bus/usb/001/002"
GET_CAPABILITIES, CLAIM, RELEASE, DETACH_AND_CLAIM = 0x8004551A, 0x8004550F, 0x80045510, 0x8108551B
HANDED_BACK = 0xC0105512  # to the kernel's driver
SUBMIT, REAP_NOW, DISCARD = 0x8038550A, 0x4008550D, 0x550B
CAPABILITIES = 0x17
ISO, CONTROL = 0, 2
ENOENT, EAGAIN, ENOTTY, EPIPE, ESHUTDOWN = 2, 11, 25, 32, 108
URB_BYTES, ISO_BYTES = 56, 12
SLOT_S = 125e-6
SLOTS_PER_FRAME = 267
"""Microframes in a thirtieth of a second."""


def descriptors() -> bytes:
    device = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 64, 0x045E, 0x02AE, 0x010B, 2, 1, 3, 1)
    endpoints = b"".join(struct.pack("<BBBBHB", 7, 5, address, 1, 0x0BC0, 1) for address in (0x81, 0x82))
    interface = struct.pack("<9B", 9, 4, 0, 0, 2, 255, 255, 255, 0)
    length = 9 + len(interface + endpoints)
    return device + struct.pack("<BBHBBBBB", 9, 2, length, 1, 1, 0, 0xC0, 8) + interface + endpoints


def picture(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (480, 640), np.uint8)


class Urb:
    """A request in flight: where it lives in the client, and its memory."""

    def __init__(self, address: int, data: object, kind: int, buffer: object, packets: int) -> None:
        self.address, self.data, self.kind, self.buffer, self.packets = address, data, kind, buffer, packets


class Wire:
    """Answers the ioctls of the usbfs node, with a KinectBoard behind them. lose: every how many-th packet is lost."""

    def __init__(self, paced: bool, unplug_after: int, lose: int) -> None:
        self.board = KinectBoard()
        self.paced, self.unplug_after, self.lose = paced, unplug_after, lose
        self.pending: deque[Urb] = deque()
        self.done: deque[Urb] = deque()
        self.slots: deque[bytes] = deque()
        self.frames = self.slots_sent = self.packets = 0
        self.start_s = 0.0
        self.ok = {CLAIM, RELEASE, DETACH_AND_CLAIM, HANDED_BACK}
        self.asked: list[int] = []

    def handle(self, _: object, client: object) -> bool:
        request, argument = client.get_request(), client.get_arg()
        self.asked.append(request)
        if request == GET_CAPABILITIES:
            argument.resolve(0, 4).update(0, list(struct.pack("<I", CAPABILITIES)))
            client.complete(0, 0)
        elif request in self.ok:
            client.complete(0, 0)
        elif request == SUBMIT:
            self.submit(argument)
            client.complete(0, 0)
        elif request == REAP_NOW:
            self.reap(client, argument)
        elif request == DISCARD:
            self.discard(int.from_bytes(bytes(argument.retrieve()), "little"))
            client.complete(0, 0)
        else:
            client.complete(-1, ENOTTY)
        return True

    def submit(self, argument: object) -> None:
        pointer = argument.retrieve()
        head = bytes(argument.resolve(0, URB_BYTES).retrieve())
        kind, packets = head[0], struct.unpack_from("<i", head, 36)[0]
        if kind == ISO:
            argument.reload()
            argument.update(0, pointer)
            data = argument.resolve(0, URB_BYTES + ISO_BYTES * packets)
        else:
            data = argument.resolve(0, URB_BYTES)
        buffer = data.resolve(16, struct.unpack_from("<i", head, 24)[0])
        urb = Urb(int.from_bytes(bytes(pointer), "little"), data, kind, buffer, packets)
        if kind == CONTROL:
            self.control(urb)
            self.done.append(urb)
        else:
            self.pending.append(urb)

    def control(self, urb: Urb) -> None:
        message = bytes(urb.buffer.retrieve())
        direction, request, value, _, size = struct.unpack_from("<BBHHH", message)
        answer, status = b"", 0
        if (direction, request) == (0x40, 0):
            self.board.control_out(message[8:])
            actual = size
        elif (direction, request) == (0xC0, 0):
            answer = self.board.control_in()
            actual = len(answer)
        elif (direction, request) == (0x80, 6) and value >> 8 == 3:
            text = (SERIAL if value & 0xFF else "\u0409").encode("utf-16-le")
            answer = (bytes((2 + len(text), 3)) + text)[:size]
            actual = len(answer)
        else:
            actual, status = 0, -EPIPE
        if answer:
            urb.buffer.update(8, list(answer))
        urb.data.update(4, list(struct.pack("<i", status)))
        urb.data.update(28, list(struct.pack("<i", actual)))

    def discard(self, address: int) -> None:
        for urb in [u for u in self.pending if u.address == address]:
            self.pending.remove(urb)
            self.finish(urb, -ENOENT)

    def finish(self, urb: Urb, status: int) -> None:
        urb.data.update(4, list(struct.pack("<i", status)))
        self.done.append(urb)

    def reap(self, client: object, argument: object) -> None:
        self.transfer()
        if not self.done:
            client.complete(-1, EAGAIN)
            return
        argument.resolve(0, 8).set_ptr(0, self.done.popleft().data)
        client.complete(0, 0)

    def transfer(self) -> None:
        """Fill the requests whose time on the bus has come."""
        if not self.start_s:
            self.start_s = time.monotonic()
        if self.unplug_after and self.frames >= self.unplug_after:
            while self.pending:
                self.finish(self.pending.popleft(), -ESHUTDOWN)
        while self.pending and not self.done:
            end_s = self.start_s + (self.slots_sent + self.pending[0].packets) * SLOT_S
            if self.paced and time.monotonic() < end_s:
                return
            self.fill(self.pending.popleft())

    def fill(self, urb: Urb) -> None:
        memory, entries = bytearray(1920 * urb.packets), b""
        for k in range(urb.packets):
            packet = self.next_slot()
            memory[1920 * k : 1920 * k + len(packet)] = packet
            entries += struct.pack("<III", 1920, len(packet), 0)
        self.slots_sent += urb.packets
        urb.buffer.update(0, list(memory))
        urb.data.update(URB_BYTES, list(entries))
        self.finish(urb, 0)

    def next_slot(self) -> bytes:
        if not self.slots:
            if not self.board.streaming:
                return b""
            packets = self.board.packets(picture(self.frames), 2_000_000 * self.frames)
            self.slots.extend(packets + [b""] * (SLOTS_PER_FRAME - len(packets)))
            self.frames += 1
        packet = self.slots.popleft()
        if packet and self.lose:
            self.packets += 1
            return b"" if self.packets % self.lose == 0 else packet
        return packet


def plug_in(testbed: UMockdev.Testbed, wire: Wire) -> UMockdev.IoctlBase:
    tree = f"""P: {SYSFS.removeprefix("/sys")}
N: bus/usb/001/002
E: DEVNAME=/dev/bus/usb/001/002
E: DEVTYPE=usb_device
E: BUSNUM=001
E: DEVNUM=002
E: MAJOR=189
E: MINOR=1
E: SUBSYSTEM=usb
A: busnum=1\\n
A: devnum=2\\n
A: speed=480\\n
A: bConfigurationValue=1\\n
H: descriptors={descriptors().hex().upper()}
"""
    assert testbed.add_from_string(tree)
    handler = UMockdev.IoctlBase()
    handler.connect("handle-ioctl", wire.handle)
    assert testbed.attach_ioctl(NODE, handler)
    return handler


def replug(testbed: UMockdev.Testbed, camera: KinectCamera) -> tuple[Wire, UMockdev.IoctlBase, str]:
    """The cable is pulled until the driver has noticed, and put back; what the driver said meanwhile."""
    testbed.detach_ioctl(NODE)
    testbed.remove_device(SYSFS)
    wait_for(lambda: "no Kinect" in camera.status().message, "the driver to notice", camera.status)
    said = camera.status().message
    wire = Wire(paced=True, unplug_after=0, lose=0)
    return wire, plug_in(testbed, wire), said


def main() -> None:
    count, paced, unplug_after, lose, back = (int(argument) for argument in sys.argv[1:])
    wire = Wire(bool(paced), unplug_after, lose)
    testbed = UMockdev.Testbed.new()
    threading.Thread(target=GLib.MainLoop().run, daemon=True).start()
    plugged, absent = plug_in(testbed, wire), ""
    images: queue.Queue = queue.Queue()
    good, first_s, last_s = 0, 0.0, 0.0
    camera = KinectCamera(UsbTransport, "kinect", images.put)
    stamps = []
    with camera:
        deadline_s = time.monotonic() + PATIENCE_S
        while good < count and time.monotonic() < deadline_s:
            if unplug_after and not absent and "unplugged" in camera.status().message:
                if not back:
                    break
                wire, plugged, absent = replug(testbed, camera)
            try:
                reading = images.get(timeout=0.2)
            except queue.Empty:
                continue
            last_s = time.monotonic()
            first_s = first_s or last_s
            stamps.append(reading.stamp_ns)
            sent = range(max(0, wire.frames - 40), wire.frames)
            good += any(np.array_equal(reading.image, picture(k)) for k in reversed(sent))
        status = camera.status()
    rate_hz = (good - 1) / (last_s - first_s) if last_s > first_s else 0.0
    steps = [b - a for a, b in zip(stamps, stamps[1:])]
    print(
        json.dumps(
            {"good": good, "delivered": len(stamps), "rate_hz": rate_hz, "message": status.message, "absent": absent,
             "serial": camera.serial, "step_ns": [min(steps), max(steps)] if steps else [], **status.counters,
             "switched_off": wire.board.registers.get(5) == 0,
             "handed_back": [request for request in wire.asked if request in (RELEASE, HANDED_BACK)] == [
                 RELEASE, HANDED_BACK,
             ]}
        )
    )  # fmt: skip
    assert plugged


if __name__ == "__main__":
    main()
