"""What the execution of a goal wants done, step by step: who must speak and does not, what comes too late, how hard to
brake."""

import math

import msgspec
import pytest
from driving import CONFIG, open_floor, with_post

from vsx_ros.control.localization import UNLOCALIZED, LocalizationState
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import FollowerReport
from vsx_ros.navigation.goal_execution import Act, Brake, Done, ExecutionInput, Follow, GoalExecution, PlanRequest
from vsx_ros.navigation.navigator import GoalPlanner
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Refusal, RefusalKind, TimedPlan
from vsx_ros.robot import Odometry

SECOND = 10**9
GOAL = SE2(3.0, 0.0, 0.0)
LIMITS = CONFIG.limits


class Drive:
    """An execution whose base is wherever it is put. acts: of the last step."""

    def __init__(self) -> None:
        self.execution, self.planner = GoalExecution(CONFIG), GoalPlanner(CONFIG, "fov", 0)
        self.now_ns, self.pose, self.v = SECOND, SE2(), 0.0
        self.grid: OccupancyGrid = open_floor()
        self.planner.take_grid(self.grid, 0)
        self.report = FollowerReport(0, FollowStatus.IDLE, "", "map")
        self.acts: list[Act] = []

    def where(self) -> LocalizationState:
        return UNLOCALIZED._replace(T_map_base=self.pose, odometry=Odometry(self.now_ns, self.pose, self.v, 0.0))

    def step(self, seconds: float = 0.05, follower_age_s: float = 0.0, client: str = "") -> list[Act]:
        self.now_ns += round(seconds * SECOND)
        seen = ExecutionInput(self.where(), self.grid, self.report, follower_age_s, client)
        self.acts = self.execution.step(self.now_ns, seen)
        return self.acts

    def plan(self) -> TimedPlan | Refusal:
        (request,) = self.acts
        assert isinstance(request, PlanRequest)
        answer = self.planner.timed(request.start, request.goal, request.frame)
        self.execution.planned(self.now_ns, request.number, answer)
        return answer

    def at_full_speed(self) -> None:
        """Half a metre on the way to the goal."""
        self.pose, self.v = SE2(), 0.0
        self.execution.begin(self.now_ns, GOAL, "map")
        self.step()
        self.plan()
        (follow,) = self.step()
        assert isinstance(follow, Follow)
        times = follow.way.trajectory.times_s
        on_the_way = next(float(t) for t in times if follow.way.trajectory.at(t)[0].x >= 0.5)
        self.report = FollowerReport(follow.identity, FollowStatus.FOLLOWING, "", "map", at_s=on_the_way)
        self.pose, self.v = SE2(0.5, 0.0, 0.0), 0.3
        assert self.step() == []


def test_a_goal_in_odom_ends_when_the_odometry_restarts_and_begins_in_any_epoch() -> None:
    begun = Drive()
    place = UNLOCALIZED._replace(odometry=Odometry(begun.now_ns, SE2(), odom_epoch=3))
    begun.execution.begin(begun.now_ns, SE2(1.0, 0.0, 0.0), "odom")
    seen = ExecutionInput(place, begun.grid, begun.report)
    (request,) = begun.execution.step(begun.now_ns, seen)
    assert isinstance(request, PlanRequest)
    begun.execution.planned(begun.now_ns, 1, begun.planner.timed(request.start, request.goal, request.frame))
    (follow,) = begun.execution.step(begun.now_ns, seen)
    assert isinstance(follow, Follow)
    moving = FollowerReport(follow.identity, FollowStatus.FOLLOWING, "", "odom", at_s=1.0)
    assert begun.execution.step(begun.now_ns, seen._replace(follower=moving)) == []
    again = seen._replace(where=place._replace(odometry=Odometry(begun.now_ns, SE2(), odom_epoch=4)), follower=moving)
    assert any(isinstance(act, Brake) for act in begun.execution.step(begun.now_ns, again))
    assert ended(begun.execution.step(begun.now_ns, again), False, "the odometry has restarted")


@pytest.fixture
def drive() -> Drive:
    begun = Drive()
    begun.at_full_speed()
    return begun


def ended(acts: list[Act], arrived: bool, reason: str) -> bool:
    return len(acts) == 1 and isinstance(acts[0], Done) and acts[0].arrived is arrived and reason in acts[0].reason


def test_a_silent_client_and_a_silent_follower_end_the_goal_at_once(drive: Drive) -> None:
    assert ended(drive.step(client="explore"), False, "the client explore is silent")
    drive.at_full_speed()
    drive.now_ns += 2 * SECOND
    assert ended(drive.step(follower_age_s=1.1), False, "the follower is silent")
    assert drive.step() == []


def test_a_drive_that_the_follower_never_takes_is_given_up() -> None:
    drive = Drive()
    drive.execution.begin(drive.now_ns, GOAL, "map")
    drive.step()
    drive.plan()
    (follow,) = drive.step()
    assert isinstance(follow, Follow)
    assert drive.step(4.9) == []
    assert ended(drive.step(0.2), False, "the drive has not reached the follower")


def test_a_planner_that_hangs_is_given_up() -> None:
    drive = Drive()
    drive.execution.begin(drive.now_ns, GOAL, "map")
    (request,) = drive.step()
    assert drive.step(14.0) == []
    assert ended(drive.step(2.0), False, "the planner has not answered within 15 s")
    assert isinstance(request, PlanRequest)
    drive.execution.begin(drive.now_ns, GOAL, "map")
    drive.step()
    late = drive.planner.timed(SE2(), GOAL, "map")
    drive.execution.planned(drive.now_ns, request.number, late)
    assert drive.step() == [], "an answer to an older question"


def test_a_refusal_ends_the_goal_with_its_reason_and_one_cancelled_while_planned_is_never_driven() -> None:
    drive = Drive()
    drive.execution.begin(drive.now_ns, GOAL, "map")
    (request,) = drive.step()
    assert isinstance(request, PlanRequest)
    drive.execution.planned(drive.now_ns, request.number, Refusal(RefusalKind.BLIND, "too dark"))
    assert ended(drive.step(), False, "too dark")
    drive.execution.begin(drive.now_ns, GOAL, "map")
    drive.step()
    drive.plan()
    drive.execution.cancel(drive.now_ns, "cancelled")
    assert ended(drive.step(), False, "cancelled")
    assert drive.step() == []


def test_a_frame_without_a_pose_is_named() -> None:
    drive = Drive()
    drive.execution.begin(drive.now_ns, GOAL, "kitchen")
    assert ended(drive.step(), False, "'kitchen'")


@pytest.mark.parametrize(("status", "arrived"), [(FollowStatus.ARRIVED, True), (FollowStatus.STOPPED, False)])
def test_the_word_of_the_follower_ends_the_goal_if_it_is_about_this_trajectory(
    drive: Drive, status: FollowStatus, arrived: bool
) -> None:
    mine = drive.report
    drive.report = FollowerReport(mine.trajectory - 1, status, "that was it", "map")
    assert drive.step() == []
    drive.report = FollowerReport(mine.trajectory, status, "that was it", "map")
    assert ended(drive.step(), arrived, "that was it")


@pytest.mark.parametrize(("post_x", "a_m_s2"), [(1.6, LIMITS.a_m_s2), (1.05, LIMITS.a_stop_m_s2), (0.85, math.inf)])
def test_an_obstacle_is_braked_for_as_hard_as_it_is_near_and_planned_around(
    drive: Drive, post_x: float, a_m_s2: float
) -> None:
    drive.grid = with_post(post_x, 0.0)
    assert drive.step() == [Brake(a_m_s2)]
    assert drive.step() == [], "the follower has not told yet where the base will stand"
    drive.report = FollowerReport(
        drive.report.trajectory, FollowStatus.FOLLOWING, "", "map", at_s=drive.report.at_s, stop=(0.6, 0.0, 0.0)
    )
    (request,) = drive.step()
    assert isinstance(request, PlanRequest)
    assert request.start == SE2(0.6, 0.0, 0.0)
    assert "an obstacle has come to light" in request.again


@pytest.mark.parametrize(("step_m", "plans"), [(1.2, 5), (0.3, 3)])
def test_a_base_that_comes_nearer_each_time_is_not_given_up(step_m: float, plans: int) -> None:
    """A long way is disturbed more often than a short one."""
    drive, made = Drive(), 0
    drive.pose = SE2(-3.0, 0.0, 0.0)
    drive.execution.begin(drive.now_ns, GOAL, "map")
    drive.step()
    while isinstance(drive.acts[0], PlanRequest) and made < 5:
        made += isinstance(drive.plan(), TimedPlan)
        (follow,) = drive.step()
        assert isinstance(follow, Follow)
        drive.pose = SE2(drive.pose.x + step_m, 0.0, 0.0)
        drive.report = FollowerReport(follow.identity, FollowStatus.DIVERGED, "0.13 m beside the path", "map")
        drive.step()
    assert made == plans


def test_while_the_base_brakes_gently_it_brakes_harder_for_what_comes_to_light_nearer(drive: Drive) -> None:
    drive.execution.cancel(drive.now_ns, "cancelled")
    assert drive.step() == [Brake(LIMITS.a_m_s2)]
    drive.grid = with_post(1.05, 0.0)
    assert drive.step() == [Brake(LIMITS.a_stop_m_s2)]
    drive.grid = with_post(1.06, 0.0)
    assert drive.step() == [], "as hard already"
    drive.v = 0.0
    assert ended(drive.step(), False, "cancelled")


def test_a_base_that_does_not_stand_where_it_was_predicted_is_planned_for_anew(drive: Drive) -> None:
    drive.execution.begin(drive.now_ns, SE2(1.0, 1.0, 1.5), "map")
    assert drive.step() == [Brake(LIMITS.a_m_s2)]
    stopping = FollowerReport(drive.report.trajectory, FollowStatus.FOLLOWING, "", "map", stop=(0.62, 0.0, 0.0))
    drive.report = stopping
    drive.step()
    drive.plan()
    assert drive.step() == [], "it does not stand yet"
    drive.v, drive.pose = 0.0, SE2(0.66, 0.0, 0.0)
    (follow,) = drive.step()
    assert isinstance(follow, Follow)
    drive.execution.begin(drive.now_ns, GOAL, "map")
    drive.v = 0.3
    drive.report = stopping
    assert drive.step()[0] == Brake(LIMITS.a_m_s2)
    drive.acts = drive.acts[1:]
    drive.plan()
    drive.v, drive.pose = 0.0, SE2(0.62, 0.06, 0.0)
    (request,) = drive.step()
    assert isinstance(request, PlanRequest)
    assert request.start == drive.pose


@pytest.mark.parametrize("post_x", [round(0.9 + 0.05 * k, 2) for k in range(8)])
def test_with_an_old_report_it_brakes_as_hard_as_with_a_new_one(post_x: float) -> None:
    """At 0.3 m/s the base drives 6 cm in the 0.2 s between two reports."""
    told = []
    for age_s in (0.0, 0.2):
        drive = Drive()
        drive.at_full_speed()
        drive.report = msgspec.structs.replace(drive.report, at_s=drive.report.at_s - age_s)
        drive.grid = with_post(post_x, 0.0)
        told.append(drive.step(follower_age_s=age_s))
    assert told[0] == told[1] != []
