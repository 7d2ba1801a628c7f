"""Frame names with and without a namespace, and the clock of stamps."""

import pytest

pytest.importorskip("rospy")

from geometry_msgs.msg import PoseStamped

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import convert, headers


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
    headers.adopt_prefix()
    assert headers.own("map") == (f"{expected}/map" if expected else "map")


def test_a_clock_that_stands_is_named_instead_of_the_future(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 0)
    with pytest.raises(InputError, match="rosparam delete /use_sim_time"):
        headers.refuse_future(1_700_000_000_000_000_000)
