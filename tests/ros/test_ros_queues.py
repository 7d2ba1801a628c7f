"""Every queue has a length: rospy's default lets a slow callback see the past, and a slow listener stop its speaker."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rospy

from vsx_ros.robot import SILENCE_NS
from vsx_ros.ros.callbacks import hear_odometry

ROOM = Path(__file__).resolve().parents[2] / "src" / "vsx_ros" / "ros"


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    for file in sorted(ROOM.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in names:
                yield f"{file.relative_to(ROOM)}:{node.lineno}", node


def options(call: ast.Call) -> dict[str | None, str]:
    return {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}


def kind(call: ast.Call) -> str:
    return ast.unparse(call.args[1]) if len(call.args) > 1 else ""


def test_publishers_never_wait() -> None:
    found = list(calls("rospy.Publisher"))
    assert len(found) > 30
    assert [place for place, call in found if options(call).get("queue_size", "None") == "None"] == []


def test_subscribers_drop_what_is_old() -> None:
    found = list(calls("rospy.Subscriber", "subscribe"))
    assert len(found) > 30
    unbounded = [place for place, call in found if "queue_size" not in options(call) and None not in options(call)]
    # the recorder alone wants every message
    assert all(place.startswith("record.py") for place in unbounded), unbounded


@pytest.mark.parametrize("message", ["Image", "PointCloud2", "rospy.AnyMsg"])
def test_big_messages_have_big_buffers(message: str) -> None:
    found = [(place, call) for place, call in calls("rospy.Subscriber", "subscribe") if kind(call) == message]
    assert found
    assert [place for place, call in found if "buff_size" not in options(call)] == []


def test_a_process_that_slept_for_a_second_misses_no_wheels(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would take the gap for a base that restarted."""
    lengths: list[int] = []
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, queue_size, **__: lengths.append(queue_size))
    hear_odometry(lambda _: None)
    assert [50 * SILENCE_NS * 1e-9 < length <= 500 for length in lengths] == [True]
    direct = [
        place
        for place, call in calls("subscribe")
        if not place.startswith("callbacks.py")
        and (kind(call) == "OdometryMsg" or "topics.ODOM" in map(ast.unparse, call.args))
    ]
    assert direct == []
