"""While the operator holds the wheels the follower stands aside, and a goal waits without using up a try."""

import pytest
from test_navigation_follower import Drive as FollowerDrive
from test_navigation_follower import ahead
from test_navigation_goal_execution import SECOND
from test_navigation_goal_execution import Drive as GoalDrive

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import FollowerReport
from vsx_ros.navigation.goal_execution import Done, Follow, PlanRequest

WHY = "the operator holds the wheels (teleop)"


def test_the_follower_ends_its_drive_and_begins_no_other() -> None:
    drive = FollowerDrive()
    drive.go_on(1.0)
    assert drive.status is FollowStatus.FOLLOWING
    command = drive.follower.hold(drive.base.now_ns, WHY)
    assert command is not None
    assert command.v == 0.0
    assert drive.follower.report.reason == WHY
    drive.go_on(0.5)
    drive.follower.follow(drive.base.now_ns, ahead(SE2()), "map", 2)
    drive.told.clear()
    drive.go_on(60.0)
    assert drive.status is FollowStatus.HELD
    assert drive.follower.report.trajectory == 2
    assert set(drive.told) == {None}, "others drive"


def test_after_the_hold_the_follower_drives_again() -> None:
    drive = FollowerDrive()
    drive.follower.hold(drive.base.now_ns, WHY)
    drive.follower.hold(drive.base.now_ns, "")
    drive.go_on(0.5)
    assert drive.status is FollowStatus.IDLE
    drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose), "map", 2)
    drive.go_on(1.0)
    assert drive.status is FollowStatus.FOLLOWING
    assert drive.base.odometry.v == pytest.approx(0.3, abs=0.05)


def test_a_goal_waits_for_the_operator_and_is_planned_anew_as_often_as_he_likes() -> None:
    drive = GoalDrive()
    drive.at_full_speed()
    for k in range(20):
        identity = drive.report.trajectory
        drive.report = FollowerReport(identity, FollowStatus.HELD, WHY, "map")
        drive.pose, drive.v = SE2(0.5, 0.02 * k, 0.1), 0.0
        for _ in range(400):
            assert drive.step() == []
        drive.report = FollowerReport(identity, FollowStatus.IDLE, "", "map")
        drive.step()
        (request,) = drive.acts
        assert isinstance(request, PlanRequest)
        assert request.start.y == pytest.approx(0.02 * k)
        drive.plan()
        (follow,) = drive.step()
        assert isinstance(follow, Follow)
        drive.report = FollowerReport(follow.identity, FollowStatus.FOLLOWING, "", "map")
        assert drive.step() == []
    drive.report = FollowerReport(drive.report.trajectory, FollowStatus.ARRIVED, "arrived", "map")
    assert drive.step() == [Done(True, "arrived")]


def test_a_hold_between_two_looks_is_noticed_and_blames_no_goal() -> None:
    """An emergency stop that is set and released at once: the follower has dropped its trajectory, and waits."""
    drive = GoalDrive()
    drive.at_full_speed()
    drive.report = FollowerReport(drive.report.trajectory, FollowStatus.IDLE, "let go", "map")
    assert drive.step() == []
    drive.v = 0.0
    requests = [act for _ in range(40) for act in drive.step(follower_age_s=2.0)]
    assert [type(act) for act in requests] == [PlanRequest], "planned anew, once"


def test_a_trajectory_begins_without_the_end_of_the_one_before() -> None:
    """What is told between the message and the next step of the control loop."""
    drive = FollowerDrive()
    drive.go_on(60.0)
    assert drive.status is FollowStatus.ARRIVED
    drive.follower.follow(drive.base.now_ns, ahead(drive.base.pose), "map", 7)
    drive.follower.take_hazards(drive.base.now_ns, frozenset())
    assert drive.follower.report.trajectory == 7
    assert drive.follower.report.status is FollowStatus.FOLLOWING


def test_a_client_that_leaves_meanwhile_ends_the_goal() -> None:
    drive = GoalDrive()
    drive.at_full_speed()
    drive.report = FollowerReport(drive.report.trajectory, FollowStatus.HELD, WHY, "map")
    drive.step()
    assert drive.step(client="explore") == [Done(False, "the client explore is silent")]


def test_a_goal_cancelled_meanwhile_ends() -> None:
    drive = GoalDrive()
    drive.at_full_speed()
    drive.report = FollowerReport(drive.report.trajectory, FollowStatus.HELD, WHY, "map")
    drive.step()
    drive.execution.cancel(drive.now_ns, "cancelled")
    drive.v = 0.0
    acts = [act for _ in range(2 * SECOND // (SECOND // 20)) for act in drive.step()]
    assert acts[-1] == Done(False, "cancelled")
