"""The follower's node drives by what is new: odometry that cannot be used is as good as none."""

import json

import pytest

pytest.importorskip("rospy")

from driving import open_floor, with_post
from move_base_msgs.msg import MoveBaseGoal
from std_msgs.msg import String
from std_srvs.srv import TriggerRequest
from wires import BEGIN_NS, OverError, Wires

from vsx_ros.config import Config
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import FollowerReport, decode_report
from vsx_ros.planning.path import certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.ros import convert, driving, topics
from vsx_ros.ros.nodes.follower import FollowerNode
from vsx_ros.ros.nodes.move_base import MoveBaseNode

pytestmark = pytest.mark.changes_rospy

LIMITS = Config().limits
_AHEAD = certified(SE2(), SE2(3.0, 0.0, 0.0), (arc_piece(SE2(), 0.0, 3.0, 1),), "arcs and lines")
WAY = time_scale(_AHEAD, LIMITS)


@pytest.fixture
def wires(monkeypatch: pytest.MonkeyPatch) -> Wires:
    """The node at full speed on a straight way."""
    wires = Wires(monkeypatch)
    FollowerNode(Config())
    wires.at_each_step = lambda: wires.say(topics.FOLLOWER_LEASE, String("move_base"))
    wires.go_on(0.1)
    wires.say(topics.TRAJECTORY, driving.trajectory_msg(WAY, topics.MAP_FRAME, wires.base.now_ns))
    wires.go_on(2.5)
    assert wires.told[-1].v == pytest.approx(LIMITS.v_m_s, abs=0.02)
    return wires


def report(wires: Wires) -> FollowerReport:
    return decode_report(wires.said[topics.FOLLOWER_STATUS][-1].data)


def test_odometry_that_is_refused_is_as_good_as_none(wires: Wires) -> None:
    wires.ahead_ns = 3600 * 10**9
    wires.go_on(0.44)
    assert wires.told[-1].v > 0.2, "on busy machines a reading may be late"
    wires.go_on(0.1)
    assert wires.told[-1].v == 0.0
    assert "no odometry" in report(wires).reason
    wires.go_on(4.0)
    assert report(wires).status is FollowStatus.STALE, "the base may be plugged in again"
    wires.ahead_ns = 0
    wires.go_on(1.0)
    assert wires.told[-1].v > 0.1
    wires.camera = False
    wires.go_on(3.0)
    assert report(wires).reason == "vslam is silent"
    assert report(wires).status is FollowStatus.STOPPED


def test_a_message_without_points_stops_at_once_and_a_deceleration_on_the_way(wires: Wires) -> None:
    wires.say(topics.TRAJECTORY, driving.brake_msg(LIMITS.a_m_s2, topics.MAP_FRAME, wires.base.now_ns))
    stop = report(wires).stop_in(topics.MAP_FRAME)
    assert stop is not None
    wires.go_on(0.3)
    assert 0.1 < wires.told[-1].v < 0.29
    wires.say(topics.TRAJECTORY, driving.brake_msg(float("inf"), topics.MAP_FRAME, wires.base.now_ns))
    wires.go_on(0.04)
    assert wires.told[-1].v == 0.0
    assert report(wires).status is FollowStatus.STOPPED
    assert report(wires).stop is None


def dock_says(wires: Wires, holds: bool, reason: str = "for some reason") -> None:
    wires.say(topics.DOCK_STATUS, String(json.dumps({"state": "any", "holds": holds, "reason": reason})))


@pytest.mark.parametrize(("reason", "words"), [("for some reason",) * 2, ("", "the base stands on it")])
def test_while_the_dock_has_the_wheels_nobody_else_drives(wires: Wires, reason: str, words: str) -> None:
    dock_says(wires, True, reason)
    wires.go_on(0.5)
    assert report(wires).status is FollowStatus.HELD
    assert report(wires).reason == f"the dock has the wheels: {words}"
    wires.told.clear()
    wires.at_each_step = lambda: dock_says(wires, True)
    wires.say(topics.TRAJECTORY, driving.trajectory_msg(WAY, topics.MAP_FRAME, wires.base.now_ns))
    wires.go_on(5.0)
    assert wires.told == [], "not even zeros"


def test_a_dock_that_holds_nothing_leaves_the_wheels_to_navigation(wires: Wires) -> None:
    dock_says(wires, False)
    wires.go_on(0.5)
    assert report(wires).status is FollowStatus.FOLLOWING


def test_a_dock_that_has_ended_holds_nobody(wires: Wires) -> None:
    dock_says(wires, True)
    wires.go_on(2.5)
    assert report(wires).status is FollowStatus.HELD
    wires.go_on(1.0)
    assert report(wires).status is FollowStatus.IDLE


def test_a_goal_waits_until_the_base_has_left_its_dock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planned on the dock, right before a wall, it may be refused."""
    wires, waited_m = Wires(monkeypatch), list[float]()
    FollowerNode(Config())
    MoveBaseNode(Config())
    wires.go_on(0.5)
    wires.say(topics.MAP, convert.grid_msg(open_floor(), topics.MAP_FRAME, wires.base.now_ns))

    def leave() -> None:
        leaves = wires.base.now_ns < BEGIN_NS + 6 * 10**9
        dock_says(wires, leaves)
        waited_m.extend([wires.base.pose.x] * leaves)

    wires.at_each_step, wires.until_ns = leave, BEGIN_NS + 25 * 10**9
    wires.server.send(MoveBaseGoal(convert.pose_stamped(topics.MAP_FRAME, wires.base.now_ns, SE2(1.0, 0.0, 0.0))))
    with pytest.raises(OverError):
        wires.server.run()
    assert max(waited_m) == 0.0
    assert [end for end, _ in wires.server.ended] == ["succeeded"]
    assert wires.base.pose.x == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("when", ["first planning", "driving", "braking to plan again"])
def test_a_cancel_ends_the_goal_whenever_it_comes(when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    wires, cancelled_ns = Wires(monkeypatch), BEGIN_NS + (600 if when == "first planning" else 2200) * 10**6
    FollowerNode(Config())
    MoveBaseNode(Config())
    wires.go_on(0.5)
    wires.say(topics.MAP, convert.grid_msg(open_floor(), topics.MAP_FRAME, wires.base.now_ns))

    def cancel() -> None:
        if wires.base.now_ns == cancelled_ns - 10**8 and when == "braking to plan again":
            wires.say(topics.MAP, convert.grid_msg(with_post(1.6, 0.0), topics.MAP_FRAME, wires.base.now_ns))
        if wires.base.now_ns == cancelled_ns:
            assert (wires.base.odometry.v > 0.1) == (when != "first planning")
            assert (report(wires).stop is not None) == (when == "braking to plan again")
            assert wires.services[topics.FOLLOWER_CANCEL](TriggerRequest()).success
            wires.told.clear()

    wires.at_each_step, wires.until_ns = cancel, BEGIN_NS + 10 * 10**9
    wires.server.send(MoveBaseGoal(convert.pose_stamped(topics.MAP_FRAME, wires.base.now_ns, SE2(3.0, 0.0, 0.0))))
    with pytest.raises(OverError):
        wires.server.run()
    assert [end for end, _ in wires.server.ended] == ["preempted"]
    assert not any(command.v for command in wires.told)


def test_a_cancel_that_move_base_cannot_hear_is_no_success(wires: Wires) -> None:
    wires.deaf.add(topics.MOVE_BASE_CANCEL)
    answer = wires.services[topics.FOLLOWER_CANCEL](TriggerRequest())
    assert not answer.success
    assert topics.MOVE_BASE_CANCEL in answer.message
    wires.go_on(0.04)
    assert wires.told[-1].v == 0.0
