"""Frame names with and without a namespace, the clock of stamps, and whose warnings are ours."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Log

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, headers, logs, node
from vsx_ros.ros.monitor import Monitor


@pytest.fixture(params=["", "a", "fleet/a"])
def prefix(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(headers, "_prefix", request.param)
    return str(request.param)


def test_what_is_said_is_understood(prefix: str) -> None:
    for name in ("map", "odom", "base_footprint"):
        assert headers.bare(headers.own(name)) == name
        assert headers.bare(f"/{headers.own(name)}") == name
        assert headers.bare(name) == name
    assert headers.own("") == ""


def test_messages_carry_the_prefix(prefix: str) -> None:
    said = f"{prefix}/map" if prefix else "map"
    pose: PoseStamped = convert.pose_stamped("map", 0, SE2())
    edge = convert.transform_stamped("map", "odom", 0, SE2())
    assert pose.header.frame_id == edge.header.frame_id == said
    assert edge.child_frame_id == said.replace("map", "odom")


def test_another_robots_map_is_not_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "_prefix", "a")
    assert headers.bare("b/map") == "b/map"


@pytest.mark.parametrize(
    ("namespace", "parameter", "expected"),
    [("/", None, ""), ("/a/", None, "a"), ("/fleet/a/", None, "fleet/a"), ("/a/", "", ""), ("/", "robot1/", "robot1")],
)
def test_the_parameter_goes_before_the_namespace(
    namespace: str, parameter: str | None, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(headers, "_prefix", "before")
    monkeypatch.setattr("rospy.get_namespace", lambda: namespace)
    monkeypatch.setattr("rospy.search_param", lambda _: None if parameter is None else "/tf_prefix")
    monkeypatch.setattr("rospy.get_param", lambda _: parameter)
    assert headers.adopt_prefix() == ({} if parameter is None else {"/tf_prefix": parameter})
    assert headers.own("map") == (f"{expected}/map" if expected else "map")


def test_the_parameter_is_kept_for_a_later_master(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that starts again there would use other frames than those that have run on."""
    kept: dict[str, object] = {}
    for there, name in (
        (rospy, "init_node"), (node, "_await_parameters"), (logs, "bridge_logging"), (logs, "log_without_master"),
        (node, "load_plugins"), (node, "configuration"),
    ):  # fmt: skip
        monkeypatch.setattr(there, name, lambda *_, **__: None)
    monkeypatch.setattr(headers, "adopt_prefix", lambda: {"/r1/tf_prefix": "a"})
    monkeypatch.setattr(node, "master_watch", lambda: SimpleNamespace(remember=kept.update))
    node._start("vslam", lambda _: SimpleNamespace(close=lambda: None))
    assert kept == {"/r1/tf_prefix": "a"}


def test_a_clock_that_stands_is_named_instead_of_the_future(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 0)
    with pytest.raises(InputError, match="rosparam delete /use_sim_time"):
        headers.refuse_future(1_700_000_000_000_000_000)


@pytest.mark.parametrize(
    ("namespace", "name", "ours"),
    [
        ("/", "/vslam", True), ("/", "/robot2/vslam", False), ("/robot2/", "/robot2/vslam", True),
        ("/robot2/", "/vslam", False), ("/robot2/", "/robot21/vslam", False),
    ],
)  # fmt: skip
def test_a_run_tells_no_warnings_of_another_robot(
    namespace: str, name: str, ours: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rospy.get_namespace", lambda: namespace)
    run = Monitor.__new__(Monitor)
    run._lock, run._warnings, run._warned, run._last_words = threading.Lock(), [], set(), {}
    run._on_log(Log(level=Log.WARN, name=name, msg="it is dark"))
    assert len(run.new_warnings()) == ours
