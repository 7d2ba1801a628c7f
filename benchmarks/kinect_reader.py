"""Processor time of reading a Kinect, and whether the reader keeps up while the machine is busy.

python benchmarks/kinect_reader.py [--seconds 60] [--burners N] [--usb]

The emulated camera sends 30 images a second; the real driver reads them in a separate process beside N busy processes
(default: number of cores). Prints lost or torn images, and processor time of the reader. With --usb no camera is
emulated: the USB transport's callback and the driver above it process that many seconds of transfers in libusb's own
structures (8000 packet slots a second, 162 of every 267 filled). It prints the processor time per second.
"""

import argparse
import ctypes
import multiprocessing
import os
import tempfile
import time

import numpy as np
import usb1

from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectBoard, KinectEmulator
from vsx_hw.kinect.protocol import PACKET_BYTES
from vsx_hw.kinect.socket_transport import SocketTransport
from vsx_hw.kinect.usb_transport import PACKETS, VIDEO_ENDPOINT, UsbTransport

SLOTS_PER_FRAME = 267
"""Microframes in a thirtieth of a second."""


def burn() -> None:
    while True:
        pass


def read(path: str, done: object, told: object) -> None:
    stamps: list[int] = []
    with KinectCamera(lambda: SocketTransport(path), "camera", lambda image: stamps.append(image.stamp_ns)) as camera:
        while not stamps and not done.wait(0.1):
            pass
        begin_cpu_s, begin_s = time.process_time(), time.monotonic()
        done.wait()
        time.sleep(0.5)
        share = (time.process_time() - begin_cpu_s) / (time.monotonic() - begin_s)
        told.put((len(stamps), share, camera.status().counters))


class Transfer:
    """A finished isochronous transfer in libusb's memory layout; submitting it again does nothing."""

    def __init__(self) -> None:
        kept = usb1.USBTransfer(None, None, PACKETS, None, None, lambda *_, **__: lambda: None, False, False)
        kept.setIsochronous(VIDEO_ENDPOINT, PACKETS * PACKET_BYTES, callback=lambda transfer: None)
        self._kept = kept
        inner = kept._USBTransfer__transfer
        self._descriptors = usb1.libusb1.get_iso_packet_list(inner)
        self._bytes = np.ctypeslib.as_array(
            ctypes.cast(inner.contents.buffer, ctypes.POINTER(ctypes.c_uint8)), (PACKETS, PACKET_BYTES)
        )
        self.iterISO = kept.iterISO

    def fill(self, slots: list[bytes]) -> None:
        for k, slot in enumerate(slots):
            self._descriptors[k].actual_length = len(slot)
            self._bytes[k, : len(slot)] = np.frombuffer(slot, np.uint8)

    def getStatus(self) -> int:  # noqa: N802 - usb1's name
        return int(usb1.TRANSFER_COMPLETED)

    def submit(self) -> None:
        pass


def read_usb(seconds: float) -> None:
    """Processor time of the transport's callback and the code above it."""
    usb1.loadLibrary()
    images: list[int] = []
    camera = KinectCamera(lambda: None, "camera", lambda image: images.append(image.stamp_ns))
    transport = object.__new__(UsbTransport)
    transport._handler, transport._in_flight = camera._on_packets, 1
    board, transfer = KinectBoard(), Transfer()
    picture = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)
    slots: list[bytes] = []
    cpu_s, frames = 0.0, 0
    while frames < 30 * seconds or len(slots) >= PACKETS:
        if len(slots) < PACKETS:
            packets = board.packets(picture ^ np.uint8(frames & 1), 2_000_000 * frames)
            slots += packets + [b""] * (SLOTS_PER_FRAME - len(packets))
            frames += 1
        transfer.fill(slots[:PACKETS])
        del slots[:PACKETS]
        begin_s = time.thread_time()
        transport._on_transfer(transfer)
        cpu_s += time.thread_time() - begin_s
    counters = camera.status().counters
    share = 100 * cpu_s * 30 / frames
    print(f"{frames} sent through the USB transport, {len(images)} received, {share:.1f} % of a core, {counters}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--burners", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--usb", action="store_true")
    args = parser.parse_args()
    if args.usb:
        read_usb(args.seconds)
        return
    context = multiprocessing.get_context("spawn")
    done, told = context.Event(), context.SimpleQueue()
    pictures = np.random.default_rng(0).integers(0, 256, (8, 480, 640), np.uint8)
    with tempfile.TemporaryDirectory() as folder, KinectEmulator(f"{folder}/camera") as emulator:
        reader = context.Process(target=read, args=(f"{folder}/camera", done, told), daemon=True)
        reader.start()
        while not emulator.streaming:
            time.sleep(0.05)
        burners = [context.Process(target=burn, daemon=True) for _ in range(args.burners)]
        for burner in burners:
            burner.start()
        begin_s, sent = time.monotonic(), 0
        while time.monotonic() - begin_s < args.seconds:
            sent += emulator.send_frame(pictures[sent % 8], time.time_ns())
            time.sleep(max(0.0, begin_s + sent / 30.0 - time.monotonic()))
        time.sleep(1.0)
        done.set()
        received, share, counters = told.get()
        for process in (*burners, reader):
            process.terminate()
    print(f"{sent} sent at 30 Hz, {received} received, {100 * share:.1f} % of a core, {counters}")


if __name__ == "__main__":
    main()
