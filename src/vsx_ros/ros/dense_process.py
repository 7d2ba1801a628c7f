"""The densifier in a separate process: parts of it hold Python's global lock and would delay the tracker.

The child compiles the kernels for surfaces, if that is still to be done, while the robot begins to drive. It then
answers each request and ends when its pipes close. The first request holds the settings. Each later one holds
a snapshot without images, plus the images that the child lacks, by keyframe. No ROS in here."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import cv2
import numpy as np

from vsx_ros.arrays import GrayImage
from vsx_ros.config import DenseConfig
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.errors import VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.runs import memory
from vsx_ros.slam.snapshot import MapSnapshot

_NICE = 5  # SLAM has priority
_FIRST_ANSWER_S = 600.0  # It may have to compile
_ANSWER_S = 60.0  # A map of a large building takes some seconds on a slow machine
_STORED = np.zeros((0, 0), np.uint8)  # instead of an image that the densifier has stored


class DenseProcess:
    """``Densifier.update`` in a child; use one thread. The child ends after its current work when this is deleted."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: DenseConfig, seed: int) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        requests, self._requests = Pipe(duplex=False)
        self._answers, answers = Pipe(duplex=False)
        self._sent: set[int] = set()
        self._patience_s = _FIRST_ANSWER_S
        with requests, answers:
            self._requests.send((camera, T_base_cam, config, seed))
            ends = requests.fileno(), answers.fileno()
            command = [sys.executable, "-m", "vsx_ros.ros.dense_process", *map(str, ends)]
            self._child = subprocess.Popen(command, pass_fds=ends, env=environment)

    def update(self, take: Callable[[], MapSnapshot]) -> tuple[DenseMap, AnchoredSurface]:
        """The dense map of a snapshot and its surface points. take: gives the snapshot, which is not held while the
        child works, for seconds. Raises VsxError if the child ended; kills a hung one."""
        snapshot = take()
        ids = snapshot.keyframe_ids.tolist()
        images = {number: snapshot.images[k] for k, number in enumerate(ids) if number not in self._sent}
        self._sent = set(ids)
        patience = threading.Timer(self._patience_s, self._child.kill)
        patience.daemon = True
        patience.start()
        try:
            self._requests.send((dataclasses.replace(snapshot, images=()), images))
            del snapshot, images
            answer: tuple[DenseMap, AnchoredSurface] = self._answers.recv()
        except (EOFError, OSError) as error:
            raise VsxError(
                f"the dense mapping process has ended (exit code {self._child.poll()}); "
                "the ground map goes on without surfaces; see the log above, or set dense.enabled to false"
            ) from error
        finally:
            patience.cancel()
        self._patience_s = _ANSWER_S
        return answer


def serve(requests: Connection, answers: Connection) -> None:
    """Receive the settings, then answer requests. Raises EOFError or OSError when the parent has gone, also in the
    middle of a request."""
    camera, T_base_cam, config, seed = requests.recv()
    densifier = Densifier(camera, T_base_cam, config, seed)
    warm_up("surfaces")
    images: dict[int, GrayImage] = {}
    while True:
        without, new = requests.recv()
        images = {**images, **new}
        images = {number: images[number] for number in without.keyframe_ids.tolist()}
        snapshot = dataclasses.replace(without, images=tuple(images.values()))
        dense = densifier.update(snapshot)
        answers.send((dense, AnchoredSurface.of(dense, snapshot, config.cell_m)))
        images = {number: _STORED if number in densifier.stored else image for number, image in images.items()}
        del dense, snapshot, without, new
        memory.trim()


def main() -> None:
    """The arguments are the file descriptors of the child's ends of the two pipes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICE)
    memory.return_freed_memory()
    cv2.setNumThreads(1)
    with contextlib.suppress(EOFError, OSError):
        serve(*(Connection(int(descriptor)) for descriptor in sys.argv[1:]))


if __name__ == "__main__":
    main()
