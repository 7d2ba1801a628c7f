"""The dense map of the process beside the tracker is the one that would be made here."""

import dataclasses
import os
import signal
import struct
import time
import weakref
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from waiting import PATIENCE_S

from vsx_ros.arrays import GrayImage
from vsx_ros.config import DenseConfig
from vsx_ros.dense.densify import DenseMap, Densifier
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.errors import VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.ros import dense_process
from vsx_ros.ros.dense_process import DenseProcess
from vsx_ros.slam.snapshot import MapSnapshot

CAMERA = PinholeCamera(160, 120, 130.0, 130.0, 79.5, 59.5)
MOUNT = mount_pose(-0.09, 0.0, 0.31, 0.0)


def _picture(T_world_cam: SE3) -> GrayImage:
    """The wall, with waves on it."""
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    rays = np.column_stack([(u.ravel() - 79.5) / 130.0, (v.ravel() - 59.5) / 130.0, np.ones(u.size)])
    rays = rays @ T_world_cam.rotation.T
    y, z = (T_world_cam.translation + rays * ((2.0 - T_world_cam.translation[0]) / rays[:, 0])[:, None])[:, 1:].T
    grey = 128.0 + 50.0 * np.sin(40.0 * y + 9.0 * z) + 50.0 * np.sin(33.0 * z - 15.0 * y)
    return np.asarray(grey.reshape(120, 160), np.uint8)


def seen(n: int) -> MapSnapshot:
    """n keyframes before a wall at x = 2 with a hundred points."""
    rng = np.random.default_rng(3)
    points = np.column_stack([np.full(100, 2.0), rng.uniform(-0.7, 0.7, 100), rng.uniform(0.0, 0.6, 100)])
    cameras = tuple(SE3.from_se2(SE2(-0.1 * k, 0.15 * k, 0.0)) @ MOUNT for k in range(n))
    keyframe, point = np.repeat(np.arange(n), 100), np.tile(np.arange(100), n)
    in_camera = [T.inverse() @ points for T in cameras]
    uv = np.vstack([130.0 * p[:, :2] / p[:, 2:] + [79.5, 59.5] for p in in_camera])
    ids = np.arange(n)
    return MapSnapshot(
        n,
        ids,
        ids,
        cameras,
        tuple(map(_picture, cameras)),
        np.arange(100),
        points,
        keyframe,
        point,
        uv,
        np.zeros(100 * n, np.int64),
    )


def test_it_answers_as_the_densifier_would_and_is_sent_each_image_once() -> None:
    config = DenseConfig()
    beside, here = DenseProcess(CAMERA, MOUNT, config, 1), Densifier(CAMERA, MOUNT, config, 1)
    for n in (3, 5):
        (dense, spots), wanted = beside.update(partial(seen, n)), here.update(seen(n))
        assert dense.version == n
        assert len(dense.cells.plane) > 20
        assert all(np.array_equal(a, b) for a, b in zip(dense.cells, wanted.cells))
        expected = AnchoredSurface.of(wanted, seen(n), config.cell_m)
        assert all(np.array_equal(a, b) for a, b in zip(spots, expected))
    later = dataclasses.replace(seen(5), images=(None,) * 5)
    assert len(beside.update(lambda: later)[0].planes) == len(dense.planes)


def test_it_keeps_no_second_copy_of_the_images(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are most of the memory of a map: 0.3 MB a keyframe at 640 x 480, 0.9 MB at 1280 x 720."""
    sizes: list[list[int]] = []
    update = Densifier.update

    def watched(self: Densifier, snapshot: MapSnapshot) -> DenseMap:
        sizes.append([image.size for image in snapshot.images])
        return update(self, snapshot)

    monkeypatch.setattr(Densifier, "update", watched)
    requests: list[object] = [(CAMERA, MOUNT, DenseConfig(), 1)]
    for n, first in ((5, 0), (6, 5)):
        snapshot = seen(n)
        requests.append((dataclasses.replace(snapshot, images=()), dict(enumerate(snapshot.images[first:], first))))
    answers: list[tuple[DenseMap, AnchoredSurface]] = []
    wires: list[Any] = [SimpleNamespace(recv=iter(requests).__next__), SimpleNamespace(send=answers.append)]
    with pytest.raises(StopIteration):  # no further request
        dense_process.serve(*wires)
    cells = [dense.cells for dense, _ in answers]
    assert sizes == [[160 * 120] * 5, [0] * 3 + [160 * 120] * 3]
    once = Densifier(CAMERA, MOUNT, DenseConfig(), 1)
    for n, found in zip((5, 6), cells, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(found, update(once, seen(n)).cells, strict=True))


def test_when_it_is_gone_one_is_told() -> None:
    beside = DenseProcess(CAMERA, MOUNT, DenseConfig(), 1)
    os.kill(beside._child.pid, signal.SIGKILL)
    time.sleep(0.2)
    with pytest.raises(VsxError, match="has ended"):
        beside.update(lambda: seen(3))


def test_when_nobody_asks_any_more_it_ends_without_words(capfd: pytest.CaptureFixture[str]) -> None:
    beside = DenseProcess(CAMERA, MOUNT, DenseConfig(), 1)
    child = beside._child
    beside._requests.send((dataclasses.replace(seen(3), images=()), dict(enumerate(seen(3).images))))
    del beside  # and with it who would hear the answer
    assert child.wait(PATIENCE_S) == 0
    assert capfd.readouterr() == ("", "")


def test_when_who_asks_dies_in_the_middle_of_a_question_it_ends_without_words(
    capfd: pytest.CaptureFixture[str],
) -> None:
    beside = DenseProcess(CAMERA, MOUNT, DenseConfig(), 1)
    child = beside._child
    os.write(beside._requests.fileno(), struct.pack("!i", 1000) + b"half of it")
    del beside
    assert child.wait(PATIENCE_S) == 0
    assert capfd.readouterr() == ("", "")


def test_a_process_that_hangs_is_ended_and_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dense_process, "_FIRST_ANSWER_S", 0.5)
    beside = DenseProcess(CAMERA, MOUNT, DenseConfig(), 1)
    os.kill(beside._child.pid, signal.SIGSTOP)
    with pytest.raises(VsxError, match="has ended"):
        beside.update(lambda: seen(3))
    assert beside._child.wait(PATIENCE_S) == -signal.SIGKILL


def test_while_it_works_the_snapshot_is_not_held() -> None:
    beside, points = DenseProcess(CAMERA, MOUNT, DenseConfig(), 1), []
    answers = beside._answers

    def take() -> MapSnapshot:
        snapshot = seen(3)
        points.append(weakref.ref(snapshot.points_world))
        return snapshot

    def recv() -> Any:
        points.append(points[0]())
        return answers.recv()

    beside._answers = SimpleNamespace(recv=recv)
    dense, _ = beside.update(take)
    assert dense.version == 3
    assert points[1] is None
