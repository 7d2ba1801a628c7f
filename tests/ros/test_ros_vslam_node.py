"""The node vslam beside its SLAM: what it does with images that do not fit, and what it leaves behind."""

from __future__ import annotations

import errno
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import threads
from vsx_ros.ros.nodes import vslam
from vsx_ros.ros.nodes.vslam import VslamNode


class Notes:
    """Takes any call, and remembers those that matter by their name."""

    def __init__(self) -> None:
        self.said: list[tuple[str, Any]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *words: self.said.append((name, words[0] if words else None))


def bare_node(**parts: Any) -> VslamNode:
    """The node with nothing but these parts."""
    node = VslamNode.__new__(VslamNode)
    node.__dict__.update(parts)
    return node


def test_an_image_of_another_size_is_as_if_it_had_never_come(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = [(480, 640), (480, 640), (240, 320), (480, 640)]
    waiting = [(Frame(k, np.zeros(shape, np.uint8)), Odometry(k, None)) for k, shape in enumerate(shapes)]  # type: ignore[arg-type]
    tracked: list[int] = []

    def track(frame: Frame, odometry: Odometry | None) -> SimpleNamespace:
        if frame.image.shape != (480, 640):
            raise InputError("image of 320x240 does not fit")
        tracked.append(frame.stamp_ns)
        return SimpleNamespace(stamp_ns=frame.stamp_ns)

    monkeypatch.setattr(vslam, "ThreadedSlam", lambda *_: SimpleNamespace(track=track))
    monkeypatch.setattr(vslam, "PictureWatch", lambda: SimpleNamespace(is_new=lambda *_: True))
    monkeypatch.setattr(vslam.images, "camera", lambda _: None)
    monkeypatch.setattr(vslam.rospy, "get_param", lambda _, usual: usual)
    monkeypatch.setattr(threads, "is_ending", lambda: not waiting)
    status, lease = Notes(), Notes()
    node = bare_node(
        _config=Config(), _metric=True, _T_base_cam=None, _loaded=None, _counted=None, _dense=Notes(), _status=status,
        _lease=lease, _sync=SimpleNamespace(take=lambda timeout_s: waiting.pop(0), dropped=0),
        _preview=SimpleNamespace(is_due=False), _first_camera_info=lambda: None, _publish_pose=lambda *_: None,
        _remember=lambda *_: None,
    )  # fmt: skip
    node._track()
    assert tracked == [0, 1, 3]
    assert len(lease.said) == 3, "nobody drives by an image that could not be used"
    assert [name for name, _ in status.said] == ["frame", "frame", "refused", "frame"]
    assert "320x240" in status.said[2][1]


@pytest.mark.parametrize(
    "trouble", [OSError(errno.ENOSPC, "full", "summary.json"), InputError("no"), ZeroDivisionError()]
)
def test_results_that_cannot_be_written_cost_neither_the_checkpoint_nor_the_map(
    trouble: Exception, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    saved: list[str] = []
    driven: dict[str, int] = {"bumps": 0}
    monkeypatch.setattr(vslam, "save_slam_map", lambda _, path: saved.append(str(path)))
    monkeypatch.setattr(rospy, "logerr", lambda form, *values: saved.append("logged"))
    mapping = threading.Thread(target=lambda: (time.sleep(0.1), driven.update(bumps=1)))
    mapping.start()

    def finish(*_: Any) -> None:
        raise trouble

    node = bare_node(
        _lease=Notes(), _tracking=threading.current_thread(), _mapping=mapping, _dense=Notes(), _metric=True,
        _ground=SimpleNamespace(grid=None, state=lambda: dict(driven)), _driven={}, _save_map="end.vsxmap",
        _slam=SimpleNamespace(close=lambda: None, slam_map=lambda: "a map", snapshot=lambda: None),
        _keeper=SimpleNamespace(finish=finish, write=lambda ground: saved.append(f"bumps {ground['bumps']}")),
    )  # fmt: skip
    node.close()
    assert [entry for entry in saved if entry != "logged"] == ["bumps 1", "end.vsxmap"]
    assert ("logged" in saved) != ("_write_results failed" in caplog.text), "one sentence, but for a mistake in here"
