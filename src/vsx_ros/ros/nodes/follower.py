"""Node ``follower``: drives along the trajectory of move_base, 30 times a second.

Subscribers: move_base/trajectory (frame map: by camera and odometry; frame odom: by odometry alone), odom, vslam/pose,
    vslam/state, mobile_base/{hazards,operator_hold}, dock/status (while it holds the base, goals wait),
    follower/lease.
Publishers: cmd_vel_mux/input/navi, follower/status (latched String, JSON: trajectory, status, reason, frame, error,
    at_s: the current time within the trajectory, stop: while it brakes for move_base, the pose x, y, theta where it
    will stand), move_base/cancel (for follower/cancel).
Services: follower/cancel (ends the drive and all goals, also one that is still planned, as move_base/cancel).
Parameters: ~config (tree of 'vsx config').

The wheels turn only while vslam and move_base renew their leases and odometry comes. After a stop the node sends zero
for a moment and then nothing, so that other inputs of the mux are not disturbed."""

import threading
import time

import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import Twist
from std_msgs.msg import String, UInt8
from trajectory_msgs.msg import MultiDOFJointTrajectory

from vsx_ros.config import Config
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.errors import VsxError
from vsx_ros.navigation.follower import Follower, FollowerReport, MessageAges
from vsx_ros.robot import STOP, OperatorHold, VelocityCommand
from vsx_ros.ros import convert, driving, headers, node, threads, topics
from vsx_ros.ros.callbacks import hear_operator_hold, offer_trigger, subscribe
from vsx_ros.ros.dock_hold import DockHold
from vsx_ros.ros.driving import LeaseWatch
from vsx_ros.ros.logs import OK, WARN, Diagnostics
from vsx_ros.ros.situation import LocalizationSubscriber

_PERIOD_S = 1.0 / 30.0  # the rate of images at 30 Hz; eight commands during the lifetime of one (0.25 s)
_STATUS_PERIOD_S = 0.2  # in addition to every change
_BAD = FollowStatus.DIVERGED, FollowStatus.STALE, FollowStatus.STOPPED


class FollowerNode:
    """One control loop; callbacks only pass data under the lock."""

    def __init__(self, config: Config) -> None:
        self._follower = Follower(config)
        self._lock, self._held, self._dock = threading.Lock(), "", DockHold()
        self._reported: FollowerReport | None = None
        self._reported_s = 0.0
        self._where = LocalizationSubscriber()
        self._leases = LeaseWatch(topics.FOLLOWER_LEASE)
        self._diagnostics = Diagnostics()
        self._command_pub = rospy.Publisher(topics.COMMAND_NAVI, Twist, queue_size=1, tcp_nodelay=True)
        self._status_pub = rospy.Publisher(topics.FOLLOWER_STATUS, String, queue_size=5, latch=True, tcp_nodelay=True)
        self._cancel_pub = rospy.Publisher(topics.MOVE_BASE_CANCEL, GoalID, queue_size=5)
        self._tell(None)
        offer_trigger(topics.FOLLOWER_CANCEL, self._cancel)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5, tcp_nodelay=True)
        hear_operator_hold(self._on_hold)
        subscribe(topics.TRAJECTORY, MultiDOFJointTrajectory, self._on_trajectory, queue_size=2)
        threads.every(_PERIOD_S, "control", self._control)

    def _on_trajectory(self, msg: MultiDOFJointTrajectory) -> None:
        wanted, now_ns = driving.wanted(msg), headers.timer_ns()
        with self._lock:
            if isinstance(wanted, float):
                self._tell(self._follower.brake(now_ns, wanted))
            else:
                self._leases.grant("move_base")
                self._follower.follow(now_ns, wanted, headers.bare(msg.header.frame_id), msg.header.stamp.to_nsec())

    def _on_hazards(self, msg: UInt8) -> None:
        words = convert.hazard_words(msg.data)
        with self._lock:
            self._tell(self._follower.take_hazards(headers.timer_ns(), frozenset(words.split(", ") if words else [])))

    def _on_hold(self, hold: OperatorHold | None) -> None:
        with self._lock:
            self._held = hold.words() if hold is not None else ""
            self._tell(self._follower.hold(headers.timer_ns(), self._held or self._dock.words))

    def _cancel(self) -> str:
        with self._lock:
            self._tell(self._follower.end(headers.timer_ns(), driving.FOLLOWER_CANCELLED))
        if not self._cancel_pub.get_num_connections():
            raise VsxError(
                f"the base stops, but no move_base hears {topics.MOVE_BASE_CANCEL} to end its goal; try again"
            )
        self._cancel_pub.publish(GoalID())
        return "stopped"

    def _control(self) -> None:
        with self._lock:
            now_ns, age_s = headers.timer_ns(), self._leases.age_s
            self._tell(self._follower.hold(now_ns, self._held or self._dock.words))
            ages = MessageAges(age_s("vslam"), self._where.odometry_age_s, age_s("move_base"))
            self._tell(self._follower.step(now_ns, self._where.at(headers.now_ns()), ages))

    def _tell(self, command: VelocityCommand | None) -> None:
        """Publish the command and the status for move_base: on change, and repeatedly while following."""
        if command is not None and not threads.is_ending():
            self._command_pub.publish(convert.twist(command))
        report, now_s = self._follower.report, time.monotonic()
        again = command is not None and now_s - self._reported_s >= _STATUS_PERIOD_S
        if not again and not report.says_more_than(self._reported):
            return
        self._reported, self._reported_s = report, now_s
        self._status_pub.publish(report.encode())
        level = WARN if report.status in _BAD else OK
        self._diagnostics.set("control", level, ": ".join(filter(None, (report.status.value, report.reason))))

    def close(self) -> None:
        """Send zero before the node ends."""
        self._command_pub.publish(convert.twist(STOP))


def main() -> None:
    """Entry point of scripts/follower."""
    node.run("follower", FollowerNode)
