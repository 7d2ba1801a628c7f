"""What reading a Kinect costs, and whether it keeps up while the machine is busy.

python benchmarks/kinect_reader.py [--seconds 60] [--burners N]

The emulated camera sends 30 images a second; the real driver reads them in a process of its own beside N busy processes
(as many as cores). Prints images lost or torn, and processor time of the reader.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import tempfile
import time

import numpy as np

from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectEmulator
from vsx_hw.kinect.socket_transport import SocketTransport


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--burners", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
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
