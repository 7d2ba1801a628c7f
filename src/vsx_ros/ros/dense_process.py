"""The densifier as a process of its own: what of it holds Python's global lock must not hold up the tracker.

The child reads pickled requests from standard input and answers each on standard output; it ends when its input ends.
First comes what the densifier is made of, then each snapshot without its images, and the images that the child does not
have yet, by keyframe. No ROS in here.
"""

import contextlib
import dataclasses
import os
import pickle
import signal
import subprocess
import sys
import threading
from typing import Any, BinaryIO

import cv2

from vsx_ros.arrays import GrayImage
from vsx_ros.config import DenseConfig
from vsx_ros.dense.anchored_surface import AnchoredSurface
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.errors import VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.snapshot import MapSnapshot

_NICE = 5
_ANSWER_S = 60.0
"""A map of a large building takes some seconds on a slow machine."""


class DenseProcess:
    """``Densifier.update`` in a child; from one thread."""

    def __init__(self, camera: PinholeCamera, T_base_cam: SE3 | None, config: DenseConfig, seed: int) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command, pipe = [sys.executable, "-m", "vsx_ros.ros.dense_process"], subprocess.PIPE
        self._child = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment)
        self._sent: set[int] = set()
        self._say((camera, T_base_cam, config, seed))

    @property
    def pid(self) -> int:
        """Of the child."""
        return self._child.pid

    def update(self, snapshot: MapSnapshot) -> tuple[DenseMap, AnchoredSurface]:
        """The dense map of a snapshot, and its spots. Raises VsxError when the child is gone; a hung one is ended."""
        ids = snapshot.keyframe_ids.tolist()
        images = {number: image for number, image in zip(ids, snapshot.images) if number not in self._sent}
        self._sent = set(ids)
        assert self._child.stdout is not None
        patience = threading.Timer(_ANSWER_S, self._child.kill)
        patience.daemon = True
        patience.start()
        try:
            self._say((dataclasses.replace(snapshot, images=()), images))
            answer: tuple[DenseMap, AnchoredSurface] = pickle.load(self._child.stdout)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise self._gone() from error
        finally:
            patience.cancel()
        return answer

    def close(self) -> None:
        """End the child once it has finished what it is at; one that hangs is not waited for."""
        threading.Thread(target=self._close, daemon=True).start()

    def _close(self) -> None:
        assert self._child.stdin is not None
        with contextlib.suppress(OSError):
            self._child.stdin.close()

    def _say(self, request: tuple[Any, ...]) -> None:
        assert self._child.stdin is not None
        try:
            pickle.dump(request, self._child.stdin, pickle.HIGHEST_PROTOCOL)
            self._child.stdin.flush()
        except (OSError, ValueError) as error:
            raise self._gone() from error

    def _gone(self) -> VsxError:
        return VsxError(
            f"the dense mapping process has ended (exit code {self._child.poll()}); "
            "the ground map goes on without surfaces; see the log above, or set dense.enabled to false"
        )


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Settings first, then one answer for each request until there are no more."""
    camera, T_base_cam, config, seed = pickle.load(requests)
    densifier = Densifier(camera, T_base_cam, config, seed)
    images: dict[int, GrayImage] = {}
    while True:
        try:
            without, new = pickle.load(requests)
        except EOFError:
            return
        images = {**images, **new}
        images = {number: images[number] for number in without.keyframe_ids.tolist()}
        snapshot = dataclasses.replace(without, images=tuple(images.values()))
        dense = densifier.update(snapshot)
        answer = dense, AnchoredSurface.of(dense, snapshot, config.cell_m)
        pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()


def main() -> None:
    """Answers go to what was standard output; anything else that is printed goes to standard error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICE)
    cv2.setNumThreads(1)
    with contextlib.suppress(BrokenPipeError), os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    main()
