"""A lease proves that its holder's deciding thread goes on, not only that the process lives."""

import pytest

pytest.importorskip("rospy")

from std_msgs.msg import String

from vsx_ros.ros import driving
from vsx_ros.ros.driving import Lease, LeaseWatch


class Topic:
    """What was said on it."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def publish(self, msg: String) -> None:
        self.said.append(msg.data)


@pytest.fixture
def topic(monkeypatch: pytest.MonkeyPatch) -> Topic:
    heard = Topic()
    monkeypatch.setattr(driving.rospy, "Publisher", lambda *_, **__: heard)
    return heard


def test_a_lease_is_kept_only_as_long_as_it_was_promised(topic: Topic, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr(driving.time, "monotonic", lambda: now_s[0])
    held = Lease("any/lease", "explore")
    held.keep()
    assert topic.said == [], "nobody has decided anything yet"
    held.promise(5.0)
    for now_s[0] in (100.0, 102.0, 104.9):
        held.keep()
    assert topic.said == ["explore"] * 3
    for now_s[0] in (105.1, 200.0):
        held.keep()
    assert len(topic.said) == 3, "the thread that promised hangs"
    held.promise(1.0)
    held.keep()
    assert len(topic.said) == 4
    held.promise(0.0)
    held.keep()
    assert len(topic.said) == 4, "taken back"


def test_a_holder_that_leaves_keeps_no_promise(topic: Topic) -> None:
    held = Lease("any/lease", "explore")
    held.promise(1e6)
    held.release()
    held.keep()
    held.renew()
    assert topic.said == []


def test_a_goal_is_a_sign_of_life_of_one_who_renews_and_of_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """The dock renews only while it docks: its second goal comes before its first renewal."""
    now_s = [100.0]
    monkeypatch.setattr(driving.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(driving.rospy, "Subscriber", lambda *_, **__: None)
    watch = LeaseWatch("any/lease")
    watch.grant("/dock")
    now_s[0] = 700.0
    assert watch.age_s("/dock") == 600.0
    for client in ("/dock", "/rviz"):
        watch.heard(client)
    assert watch.age_s("/dock") == 0.0
    assert not watch.is_known("/rviz"), "who never renews is not waited for"
