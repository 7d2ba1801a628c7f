"""Bags as other programs read them, and what happens when the disk does not take them."""

import argparse
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

pytest.importorskip("rospy")

import rospy
from rosbags.rosbag1 import Reader
from waiting import PATIENCE_S

from vsx_ros.cli.option_values import Size
from vsx_ros.errors import InputError
from vsx_ros.ros import record, topics
from vsx_ros.ros.record import BagWriter, Serialized

STRING = {
    "type": "std_msgs/String", "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1", "message_definition": "string data\n"
}  # fmt: skip


def message(text: bytes, caller: str = "/talker", latching: bool = False) -> Serialized:
    said = {**STRING, "callerid": caller, "latching": "1" if latching else "0"}
    return Serialized("/chatter", 7, said, len(text).to_bytes(4, "little") + text)


def test_what_was_put_is_read(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "a.bag")
    for text in (b"one", b"two"):
        writer.put(message(text))
    writer.put(message(b"three", "/other", latching=True))
    assert writer.close() == tmp_path / "a.bag"
    with Reader(tmp_path / "a.bag") as bag:
        read = [
            (connection.ext.callerid, connection.ext.latching, bytes(data)[4:])
            for connection, _, data in bag.messages()
        ]
    assert read == [("/talker", 0, b"one"), ("/talker", 0, b"two"), ("/other", 1, b"three")]
    assert writer.counts == {"/chatter": 3}
    assert not list(tmp_path.glob("*.active"))


def test_nothing_heard_leaves_nothing(tmp_path: Path) -> None:
    BagWriter(tmp_path / "a.bag").close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [OSError(28, "No space left"), ValueError("No space left")])
def test_a_disk_that_is_full_is_told_and_does_not_hang(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    writer = BagWriter(tmp_path / "a.bag")
    writer.put(message(b"one"))
    monkeypatch.setattr(writer._writer, "write", Mock(side_effect=error))
    for _ in range(1000):
        writer.put(message(b"two"))
    assert writer.close().name in ("a.bag.active", "a.bag")
    assert "No space left" in writer.failure


@pytest.mark.parametrize("waiting", [1, 600])
def test_a_disk_that_hangs_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waiting: int) -> None:
    writer, taken = BagWriter(tmp_path / "a.bag"), threading.Event()
    monkeypatch.setattr(record, "_STUCK_S", 0.1)
    monkeypatch.setattr(writer._writer, "write", lambda *_: taken.wait(PATIENCE_S))
    for _ in range(waiting):
        writer.put(message(b"one"))
    closed = threading.Thread(target=writer.close, daemon=True)
    closed.start()
    closed.join(PATIENCE_S / 2.0)  # the disk takes it later
    assert not closed.is_alive()
    assert writer.failure == "it took nothing for 0.1 s"
    taken.set()


@pytest.mark.parametrize(("image_s", "waited_s"), [(7.0, 7.0), (None, 20.0)])
def test_recording_begins_with_the_first_image_whatever_the_camera_says_before(
    monkeypatch: pytest.MonkeyPatch, image_s: float | None, waited_s: float
) -> None:
    """A driver tells the calibration at once; the first image may take seconds, or never come."""
    clock_s, listening = [0.0], dict[str, Callable[[object], None]]()

    def sleep(seconds: float) -> None:
        clock_s[0] += seconds
        for topic, due_s in ((topics.CAMERA_INFO, 0.0), (topics.IMAGE, image_s)):
            if due_s is not None and clock_s[0] >= due_s and topic in listening:
                listening[topic](object())

    def subscribe(topic: str, _: type, take: Callable[[object], None], **__: object) -> Mock:
        listening[topic] = take
        return Mock()

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    monkeypatch.setattr(record, "time", SimpleNamespace(monotonic=lambda: clock_s[0], sleep=sleep))
    record._await_camera(Mock(came=None), Mock(is_due=False))
    assert clock_s[0] == pytest.approx(waited_s, abs=0.2)


def test_a_folder_that_was_deleted_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "bags"
    folder.mkdir()
    writer = BagWriter(folder / "a.bag")
    writer.put(message(b"one"))
    shutil.rmtree(folder)
    assert writer.close().name == "a.bag.active"
    assert "No such file" in writer.failure


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none/a\.bag cannot be written"):
        BagWriter(tmp_path / "none" / "a.bag")


@pytest.mark.parametrize(("text", "size"), [("4GB", 4e9), ("1.5 MB", 1.5e6), ("800kB", 8e5)])
def test_sizes(text: str, size: float) -> None:
    assert Size.parse(text) == (text, size)


@pytest.mark.parametrize("text", ["", "GB", "4", "4 GiB", "-1GB", "nanGB", "infMB"])
def test_sizes_that_are_none(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="size"):
        Size.parse(text)
