"""Where the robot is and what is around it, from topics, for every node except vslam."""

import math
import threading
import time

import numpy as np
import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseActionGoal
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray, UInt8

from vsx_hw.readings import Hazard
from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.control.localization import Localization, LocalizationState
from vsx_ros.exploration.decision import NavigationState, Situation
from vsx_ros.exploration.user_goals import GoalState, UserGoals
from vsx_ros.occupancy.anchored_poses import KeyframePlaces
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Odometry, OperatorHold
from vsx_ros.ros import convert, headers, topics
from vsx_ros.ros.callbacks import hear_odometry, hear_operator_hold, subscribe
from vsx_ros.ros.driving import LeaseWatch
from vsx_ros.ros.zones import ZonedMap

LIVE_GOAL = GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING


class LocalizationSubscriber:
    """A ``Localization`` fed by topics. Subscribers: odom, vslam/pose, vslam/state. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._localization = Localization()
        self._taken_s = -math.inf
        hear_odometry(self._on_odometry)
        subscribe(topics.POSE, PoseWithCovarianceStamped, self._on_pose, queue_size=5, tcp_nodelay=True)
        subscribe(topics.SLAM_STATE, DiagnosticStatus, self._on_state, queue_size=5, tcp_nodelay=True)

    def _on_odometry(self, odometry: Odometry) -> None:
        with self._lock:
            if self._localization.add_odometry(odometry):
                self._taken_s = time.monotonic()

    def _on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        stamp_ns = msg.header.stamp.to_nsec()
        headers.refuse_future(stamp_ns)
        with self._lock:
            self._localization.add_pose(stamp_ns, convert.se2(msg.pose.pose))

    def _on_state(self, msg: DiagnosticStatus) -> None:
        state = convert.tracking_state(msg)
        with self._lock:
            self._localization.add_state(state, msg.message, *convert.ahead_and_stuck(msg))

    def at(self, now_ns: int) -> LocalizationState:
        """What is known now."""
        with self._lock:
            return self._localization.at(now_ns)

    @property
    def odometry_age_s(self) -> float:
        """Time since the last usable odometry [s], on the monotonic clock; infinite before the first."""
        return time.monotonic() - self._taken_s


def hear_user_goals(*own: str) -> UserGoals:
    """The newest goal of other nodes than these. Subscribers: move_base/{goal,status}."""
    goals, lock = UserGoals(*(f"{name}-" for name in own)), threading.Lock()

    def sent(msg: MoveBaseActionGoal) -> None:
        with lock:
            goals.sent(headers.timer_ns(), msg.goal_id.id)

    def told(msg: GoalStatusArray) -> None:
        states = {
            status.goal_id.id: GoalState(
                live=status.status in LIVE_GOAL, reached=status.status == GoalStatus.SUCCEEDED, reason=status.text
            )
            for status in msg.status_list
        }
        with lock:
            goals.told(headers.timer_ns(), states)

    subscribe(topics.MOVE_BASE_GOAL, MoveBaseActionGoal, sent, queue_size=5, tcp_nodelay=True)
    subscribe(topics.MOVE_BASE_STATUS, GoalStatusArray, told, queue_size=5, tcp_nodelay=True)
    return goals


class HeardSituation:
    """Subscribers: map, zones, vslam/{map_points,keyframe_places}, mobile_base/{hazards,operator_hold},
    move_base/{goal,status}, follower/lease, and those of ``LocalizationSubscriber``. grid: the newest map with the
    zones, if any."""

    def __init__(self, config: Config) -> None:
        self.grid: OccupancyGrid | None = None
        self.where = LocalizationSubscriber()
        self._leases = LeaseWatch(topics.FOLLOWER_LEASE)
        self._landmarks: Points3 = np.zeros((0, 3))
        self._keyframes: KeyframePlaces | None = None
        self._hazards = 0
        self._held: OperatorHold | None = None
        self._user_goals = hear_user_goals(rospy.get_name())
        ZonedMap(config, self._on_map)
        subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        subscribe(topics.KEYFRAME_PLACES, Float64MultiArray, self._on_keyframes, queue_size=1, buff_size=2**20)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)
        hear_operator_hold(self._on_hold)

    def _on_map(self, grid: OccupancyGrid, _: int) -> None:
        self.grid = grid

    def _on_points(self, msg: PointCloud2) -> None:
        self._landmarks = convert.cloud_points(msg)

    def _on_keyframes(self, msg: Float64MultiArray) -> None:
        self._keyframes = convert.keyframe_places(msg)

    def _on_hazards(self, msg: UInt8) -> None:
        self._hazards = msg.data

    def _on_hold(self, hold: OperatorHold | None) -> None:
        self._held = hold

    def is_claimed_since(self, situation: Situation) -> bool:
        """Whether the operator holds the wheels, or sent a goal, that this situation does not know."""
        claims = (self._held, situation.held), (self._user_goals.current, situation.user_goal)
        return any(now is not None and now != then for now, then in claims)

    @property
    def has_seen(self) -> bool:
        """Whether vslam has used an image yet."""
        return self._leases.is_known("vslam")

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        """The situation, with the goal's state."""
        where = self.where.at(headers.now_ns())
        return Situation(
            slam_state=where.slam_state, slam_reason=where.slam_reason, T_map_base=where.T_map_base,
            T_odom_base=where.T_odom_base, grid=self.grid, navigation=navigation, navigation_reason=navigation_reason,
            lifted=Hazard(self._hazards) & Hazard.WHEEL_DROP == Hazard.WHEEL_DROP,
            hazard=convert.hazard_words(self._hazards) or where.stuck or None,
            landmarks_world=self._landmarks, odom_epoch=where.odom_epoch, held=self._held,
            user_goal=self._user_goals.current, user_goal_end=self._user_goals.last_end,
            blind_s=self._leases.age_s("vslam") if self.has_seen else 0.0, keyframes=self._keyframes,
        )  # fmt: skip
