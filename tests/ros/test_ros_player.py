"""The order in which a recording reaches the nodes."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

from std_msgs.msg import Float32

from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.recording import Recording
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import headers, player, topics

MS = 1_000_000
IMAGE = np.zeros((16, 16), np.uint8)


def recording(images_ms: list[int], odometry_ms: list[int]) -> Recording:
    odometry = [Odometry(t * MS, SE2(), 0.0, 0.0) for t in odometry_ms]
    frames = [Frame(t * MS, IMAGE) for t in images_ms]
    return Recording(Path("x"), None, None, len(frames), None, odometry, [], lambda: iter(frames))


def order(images_ms: list[int], odometry_ms: list[int]) -> list[str]:
    told = player._deliveries(recording(images_ms, odometry_ms), [])
    return [f"{'i' if isinstance(m, Frame) else 'o'}{m.stamp_ns // MS}" for m in told]


@pytest.mark.parametrize(
    ("images_ms", "odometry_ms", "expected"),
    [
        ([30, 60], [0, 20, 40, 60], "o0 o20 o40 i30 o60 i60"),
        ([30, 60], [], "i30 i60"),
        ([0, 30], [20, 40], "o20 o40 i30"),
        ([5000], [0, 3900, 4100, 5010], "o4100 o5010 i5000"),
        ([30, 60, 200, 230], [0, 20], "o0 o20 i30 i60 i200 i230"),
        ([], [0, 20], ""),
    ],
)
def test_an_image_follows_the_odometry_of_its_instant(
    images_ms: list[int], odometry_ms: list[int], expected: str
) -> None:
    assert order(images_ms, odometry_ms) == expected.split()


def test_of_a_recording_that_breaks_all_that_could_be_read_is_played() -> None:
    def images() -> Iterator[Frame]:
        yield from (Frame(t * MS, IMAGE) for t in (0, 30, 60))
        raise InputError("bag x is damaged")

    broken: list[str] = []
    whole = replace(recording([], [0, 20, 40]), open_frames=images)
    for odometry in (whole.odometry, []):
        told = player._deliveries(replace(whole, odometry=odometry), broken)
        assert [m.stamp_ns // MS for m in told if isinstance(m, Frame)] == [0, 30, 60]
    assert broken == ["bag x is damaged"] * 2


@pytest.mark.parametrize("rate", [0.0, 10.0])
def test_ros_time_has_begun_before_the_first_image(rate: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a recording that begins at stamp 0: the SLAM refuses images while the clock is there."""
    heard: list[tuple[str, int]] = []

    class Topic:
        def __init__(self, name: str, *_: object, **__: object) -> None:
            self.name = name

        def publish(self, msg: Any) -> None:
            if self.name == topics.CLOCK:
                monkeypatch.setattr(headers, "now_ns", msg.clock.to_nsec)
                heard.append(("clock", msg.clock.to_nsec()))
            elif self.name == topics.IMAGE:
                headers.refuse_future(msg.header.stamp.to_nsec())
                heard.append(("image", msg.header.stamp.to_nsec()))
                played._on_answer(Float32())

    monkeypatch.setattr(player.rospy, "Publisher", Topic)
    monkeypatch.setattr(player.rospy, "Subscriber", Topic)
    monkeypatch.setattr(player, "_CALIBRATION_LEAD_S", 0.0)
    monkeypatch.setattr(player, "_END_NS", 0)
    camera = PinholeCamera(16, 16, 10.0, 10.0, 8.0, 8.0)
    played = player.Player(replace(recording([0, 33, 66], []), camera=camera))
    played.play(rate, lambda: True)
    assert [stamp_ns for kind, stamp_ns in heard if kind == "image"] == [0, 33 * MS, 66 * MS]
    clock_ns = [stamp_ns for kind, stamp_ns in heard if kind == "clock"]
    assert clock_ns == sorted(clock_ns)


def test_a_recording_waits_for_the_slam_and_not_for_others_who_listen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run's own monitor hears odometry, too; what is played before vslam does is lost."""
    listeners = {"/monitor"}

    class Topic:
        def __init__(self, *_: object, **__: object) -> None:
            self.impl = self

        def get_stats_info(self) -> list[tuple[int, str, str]]:
            return [(number, name, "o") for number, name in enumerate(listeners)]

        def get_num_connections(self) -> int:
            return len(listeners)

    monkeypatch.setattr(player.rospy, "Publisher", Topic)
    monkeypatch.setattr(player.rospy, "Subscriber", Topic)
    played = player.Player(recording([0], [0]))
    assert not played.ready
    listeners.add("/vslam")
    assert played.ready
