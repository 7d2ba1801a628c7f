"""The command ``vsx go``: send the robot to a place, as any client of move_base would."""

import math
import sys
import time

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_srvs.srv import Trigger

from vsx_ros.errors import ConfigError
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import OperatorHold
from vsx_ros.ros import calls, convert, headers, operator_command, topics
from vsx_ros.ros.callbacks import hear_operator_hold, subscribe
from vsx_ros.ros.goal_preview import goal_pose
from vsx_ros.ros.goal_sender import GoalSender
from vsx_ros.runs.process import DONE, FAILED, Progress

_ANSWER_S = 5.0  # for a pose, for move_base and for the exploration
_TICK_S = 0.1  # so that Ctrl-C takes effect at once


class _Heard:
    """What is known of the robot on its way."""

    def __init__(self) -> None:
        self.pose: SE2 | None = None
        self.hold: OperatorHold | None = None
        subscribe(topics.POSE, PoseWithCovarianceStamped, self._on_pose, queue_size=1)
        hear_operator_hold(self._on_hold)

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        self.pose = convert.se2(msg.pose.pose)

    def _on_hold(self, hold: OperatorHold | None) -> None:
        self.hold = hold


@operator_command.command
def go(x: float, y: float, heading_rad: float | None, *, stay: bool) -> int:
    """Drive there and wait for the end; Ctrl-C ends the drive. stay: pause the exploration first. Raises ConfigError
    without a master, move_base, a pose in the map, or (with stay) an exploration."""
    operator_command.join("go")
    headers.adopt_prefix()
    heard, goals = _Heard(), GoalSender()
    deadline_s = time.monotonic() + _ANSWER_S
    while (heard.pose is None or not goals.is_served) and time.monotonic() < deadline_s:
        time.sleep(_TICK_S)
    if not goals.is_served:
        raise ConfigError(f"nobody serves {rospy.resolve_name(topics.MOVE_BASE_ACTION)}; start the robot first")
    if heard.pose is None:
        raise ConfigError("the robot does not know where it is in the map; 'vsx status' tells what it waits for")
    if stay:
        _pause()
    goal = goal_pose(x, y, heading_rad, heard.pose)
    goals.send(headers.now_ns(), topics.MAP_FRAME, goal)
    progress, served_s = Progress(sys.stderr), time.monotonic()
    try:
        while (end := goals.state())[0] is NavigationState.ACTIVE and not rospy.is_shutdown():
            time.sleep(_TICK_S)
            served_s = time.monotonic() if goals.is_served else served_s
            if time.monotonic() - served_s > _ANSWER_S:
                end = NavigationState.LOST, "move_base has ended"
                break
            if progress.is_due:
                words = f"{heard.pose.distance_to(goal):.1f} m left; Ctrl-C ends the drive"
                progress.show(heard.hold.words() if heard.hold is not None else words)
    except KeyboardInterrupt:
        goals.cancel()
        time.sleep(_TICK_S)  # the message is under way
        raise
    progress.clear()
    if rospy.is_shutdown() or end[0] is not NavigationState.SUCCEEDED:
        sys.stderr.write(f"vsx: not reached: {end[1] or 'the ROS master has ended'}\n")
        return FAILED
    sys.stdout.write(f"reached {goal.x:.2f}, {goal.y:.2f}, {math.degrees(goal.theta):.0f} deg\n")
    return DONE


def _pause() -> None:
    try:
        calls.service(topics.EXPLORE_PAUSE, Trigger, within_s=_ANSWER_S)
    except (rospy.ROSException, rospy.ServiceException) as error:
        raise ConfigError(f"--stay: no exploration answers ({error}); leave it out") from error
