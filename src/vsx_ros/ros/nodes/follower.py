"""Node ``follower``: drives along the trajectory of move_base, 30 times a second.

Subscribers: move_base/trajectory (frame map: by camera and wheels; frame odom: by the wheels alone), odom, vslam/pose,
    vslam/state, mobile_base/hazards, follower/lease.
Publishers: cmd_vel_mux/input/navi, follower/status (latched String, JSON: trajectory, status, reason, error, at_s: how
    far it is in the trajectory's own time; while it is stopping on the way because move_base wants so, also stop: where
    it will stand, x, y, theta, and frame).
Services: follower/cancel.
Parameters: ~config (tree of config.py).

The wheels turn only while vslam and move_base renew their leases and odometry comes. After a stop the node sends zero
for a moment and then nothing, so that other inputs of the mux are not disturbed.
"""

from __future__ import annotations

import json
import threading
import time

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import String, UInt8
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
from trajectory_msgs.msg import MultiDOFJointTrajectory

from vsx_hw.readings import Hazard
from vsx_ros.config import Config
from vsx_ros.control.caution import Caution
from vsx_ros.control.trajectory_tracker import FollowResult, FollowStatus, TrajectoryTracker
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.ros import convert, frames, process, topics, trajectory_messages
from vsx_ros.ros.lease import LeaseWatch
from vsx_ros.ros.localization import Localization

_PERIOD_S = 1.0 / 30.0
_ZERO_FOR_S = 0.3
_PATIENCE_S = 2.0
_STATUS_PERIOD_S = 0.2
_WHEELS_SILENT_S = 0.5


class FollowerNode:
    """One loop; callbacks only hand over under the lock."""

    def __init__(self, config: Config) -> None:
        self._tracker = TrajectoryTracker(config.follower, config.limits)
        self._lock = threading.Lock()
        self._id, self._frame, self._following = 0, topics.MAP_FRAME, False
        self._stop: SE2 | None = None
        self._caution = Caution(config.follower)
        self._status, self._reported_s = "", 0.0
        self._hazards, self._was_stuck = Hazard.NONE, False
        self._zero_until_s = self._heard_vslam_s = 0.0
        self._where = Localization()
        self._leases = LeaseWatch(topics.FOLLOWER_LEASE)
        self._diagnostics = process.Diagnostics()
        self._command_pub = rospy.Publisher(topics.COMMAND_NAVI, Twist, queue_size=1, tcp_nodelay=True)
        self._status_pub = rospy.Publisher(topics.FOLLOWER_STATUS, String, queue_size=5, latch=True, tcp_nodelay=True)
        self._report(FollowResult(STOP, FollowStatus.IDLE, "nothing to follow"))
        rospy.Service(topics.FOLLOWER_CANCEL, Trigger, self._on_cancel)
        process.subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5, tcp_nodelay=True)
        process.subscribe(topics.TRAJECTORY, MultiDOFJointTrajectory, self._on_trajectory, queue_size=2)
        process.every(_PERIOD_S, "control", self._control)

    def _on_trajectory(self, msg: MultiDOFJointTrajectory) -> None:
        """A new trajectory replaces the old one; one without points is a stop at once, one of a single pose, without
        motion, a stop on the way as fast as the limits allow."""
        trajectory = trajectory_messages.trajectory(msg)
        with self._lock:
            if trajectory is None:
                self._end("cancelled")
                return
            if self._following and len(trajectory.times_s) == 1:
                self._stop = self._stop or self._tracker.predicted_stop()
                return
            self._stop = None
            self._id, self._frame, self._following = msg.header.stamp.to_nsec(), frames.bare(msg.header.frame_id), True
            self._heard_vslam_s = time.monotonic()
            self._was_stuck = self._where.stuck is not None  # what it pushes against already may be backed away from
            self._leases.grant("move_base")
            self._tracker.start(trajectory, process.now_ns())

    def _on_hazards(self, msg: UInt8) -> None:
        """A hazard that was not there before ends the drive; one that is still there may be backed away from."""
        hazards = Hazard(msg.data)
        with self._lock:
            new, self._hazards = hazards & ~self._hazards, hazards
            if new:
                self._end(f"hazard: {convert.hazard_words(new)}")

    def _on_cancel(self, _: TriggerRequest) -> TriggerResponse:
        with self._lock:
            self._end("cancelled by service")
        return TriggerResponse(True, "stopped")

    def _control(self) -> None:
        with self._lock:
            if self._following:
                self._follow()
            elif time.monotonic() < self._zero_until_s:
                self._send(STOP)

    def _follow(self) -> None:
        """One command. Silence of vslam or of the wheels stops at once and is waited for, the former not for long;
        silence of move_base is the end."""
        now_s, silence = time.monotonic(), self._silence()
        if self._leases.is_fresh("vslam"):
            self._heard_vslam_s = now_s
        if not self._leases.is_fresh("move_base"):
            self._end("move_base is silent")
            return
        if now_s - self._heard_vslam_s > _PATIENCE_S:
            self._end("vslam is silent")
            return
        stuck = self._where.stuck
        was_stuck, self._was_stuck = self._was_stuck, stuck is not None
        if stuck is not None and not was_stuck:
            self._end(stuck.reason)
            return
        now_ns = process.now_ns()
        blind = self._frame == topics.ODOM_FRAME
        age_s = 0.0 if blind else self._where.age_s(now_ns)
        tracking_ok = not silence and (blind or self._where.is_tracking)
        factor = 1.0 if blind else self._caution.speed_factor(now_ns, self._where.slam_state)
        if self._stop is not None:
            factor = 0.0
        result = self._tracker.command(now_ns, self._where.pose(self._frame), age_s, tracking_ok, factor)
        if silence:
            self._tracker.halted()
            result = result._replace(command=STOP, reason=silence)
        self._send(result.command)
        self._report(result)
        if self._stop is not None and self._tracker.stands:
            self._end("cancelled")
            return
        if result.status in (FollowStatus.ARRIVED, FollowStatus.DIVERGED):
            self._rest()

    def _silence(self) -> str:
        """What must come and does not: without it the pose would stand still while the base drives on."""
        if not self._leases.is_fresh("vslam"):
            return "no word from vslam, which may have no images"
        if self._where.wheels_silent_s > _WHEELS_SILENT_S:
            return "no odometry that can be used"
        return ""

    def _end(self, reason: str) -> None:
        """Stop here, for a reason that is not the tracker's."""
        if self._following:
            self._tracker.cancel()
            self._report(FollowResult(STOP, FollowStatus.STOPPED, reason))
            self._rest()

    def _rest(self) -> None:
        self._following, self._stop = False, None
        self._zero_until_s = time.monotonic() + _ZERO_FOR_S
        self._send(STOP)

    def _send(self, command: VelocityCommand) -> None:
        if not process.is_ending():
            self._command_pub.publish(convert.twist(command))

    def _report(self, result: FollowResult) -> None:
        """Status for move_base: on change, and again and again while following."""
        status: dict[str, object] = {
            "trajectory": self._id, "status": result.status.value, "reason": result.reason
        }  # fmt: skip
        if self._stop is not None and result.status is not FollowStatus.STOPPED:
            status |= {"stop": list(self._stop.as_array()), "frame": self._frame}
        key, now_s = json.dumps(status), time.monotonic()
        if key == self._status and now_s - self._reported_s < _STATUS_PERIOD_S:
            return
        self._status, self._reported_s = key, now_s
        error = list(result.error.as_array()) if result.error is not None else None
        self._status_pub.publish(json.dumps({**status, "error": error, "at_s": self._tracker.progress_s}))
        bad = FollowStatus.DIVERGED, FollowStatus.STALE, FollowStatus.STOPPED
        level = process.WARN if result.status in bad else process.OK
        self._diagnostics.set("control", level, ": ".join(filter(None, (result.status.value, result.reason))))

    def close(self) -> None:
        """Leave with the wheels told to stand."""
        self._command_pub.publish(convert.twist(STOP))


def main() -> None:
    """Entry point of scripts/follower."""
    process.run("follower", FollowerNode)
