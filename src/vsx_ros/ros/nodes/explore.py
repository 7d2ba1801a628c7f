"""Node ``explore``: chooses the next view and lets move_base drive there.

Subscribers: map, zones, vslam/{map_points,keyframe_places,pose,state}, odom, mobile_base/{hazards,operator_hold},
    camera/rgb/camera_info (its field of view), battery (nearly empty: the robot goes home, once, if no dock is known),
    dock/pose, follower/lease, move_base/{goal,status} (goals of others come first).
Publishers: explore/frontiers (as explore_lite), explore/status (latched String, JSON, 1 Hz and on change),
    explore/events (String, JSON: every change of state and every choice, with its reason), explore/coverage (known
    area, m2), move_base/lease.
Services: explore/pause, explore/resume, explore/stop, explore/home.
Actions: client of move_base. If somebody else cancels its goal it is paused, as by explore/pause.
Parameters: ~config (tree of 'vsx config'), ~run_dir (folder of the run, where the mission stores its memory for a
    session that resumes it; auto: the one of the launch file; none)."""

import threading

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState

from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, NavigationState
from vsx_ros.exploration.mission import Mission
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.planning.planner import Planner
from vsx_ros.ros import energy_messages, headers, node, threads, topics
from vsx_ros.ros.callbacks import hear_view, subscribe
from vsx_ros.ros.driving import PERIOD_S, Lease
from vsx_ros.ros.goal_sender import GoalSender
from vsx_ros.ros.logs import OK, WARN, Diagnostics
from vsx_ros.ros.mission_output import MissionTopics, MissionWriter
from vsx_ros.ros.mission_requests import MissionRequests
from vsx_ros.ros.situation import HeardSituation

_DECIDE_WITHIN_S = 5.0
"""Choosing a view takes some tenths of a second; if it takes this long, the mission hangs and the base stops."""


class ExploreNode:
    """Runs the mission, by default five times a second."""

    def __init__(self, config: Config) -> None:
        ways = Planner(config.planner, config.robot)
        self._mission = Mission(config, ways.travel_costs)
        warm_up("planning", "ground")
        self._lock = threading.Lock()
        self._battery_empty = False
        self._heard = HeardSituation(config)
        hear_view(self._mission.view_selector.look_with)
        self._diagnostics = Diagnostics()
        self._lease = Lease(topics.NAVIGATION_LEASE, rospy.get_name())
        self._topics = MissionTopics(self._mission, config.exploration.stop_cost_m)
        self._goals = GoalSender()
        self._requests = MissionRequests(self._mission, self._goals.cancel)
        self._charges = False  # the node dock takes care of the battery
        if config.docking.return_to_charge:
            subscribe(topics.DOCK_POSE, PoseStamped, self._on_dock, queue_size=1)
        subscribe(topics.BATTERY, BatteryState, self._on_battery, queue_size=1)
        self._writer = MissionWriter(self._mission, self._lock, self._heard.where, self._topics)
        threads.every(PERIOD_S, "lease", self._lease.keep)
        threads.every(config.exploration.decide_s, "mission", self._decide)

    def _on_dock(self, _: PoseStamped) -> None:
        self._charges = True

    def _on_battery(self, msg: BatteryState) -> None:
        empty = energy_messages.is_nearly_empty(msg) and not self._charges
        if empty and not self._battery_empty:
            rospy.logwarn("battery at %.1f V is nearly empty: going home", msg.voltage)
            self._requests.send_home("the battery")
        self._battery_empty = self._battery_empty or empty

    def _decide(self) -> None:
        self._lease.promise(_DECIDE_WITHIN_S)
        now_ns, navigation = headers.timer_ns(), self._goals.state()  # first: a pause that comes now ends the goal
        with self._lock:
            self._requests.tell_next(now_ns)
        ready = self._heard.has_seen and self._goals.is_served
        if not ready and self._mission.outcome is None:
            self._diagnostics.set("mission", WARN, "waiting for vslam to see images and for move_base")
            return
        situation = self._heard.at(now_ns, *navigation)
        with self._lock:
            self._writer.restore(now_ns, situation.T_odom_base)
            decision = self._mission.decide(now_ns, situation)
            if decision.action is Action.GO and self._heard.is_claimed_since(situation):
                # Somebody took the robot while a view was chosen; our goal would end theirs. It is not sent: what
                # became of the goal before says nothing of it.
                decision = self._mission.decide(now_ns, self._heard.at(now_ns, NavigationState.IDLE, ""))
            elif decision.action is Action.GO and self._goals.is_cancelled_since(navigation[0]):
                decision = decision._replace(action=Action.WAIT)  # or the mission would never hear of it
            events = self._mission.drain_events()
        self._requests.unless_to_stand(lambda: self._goals.act(headers.now_ns(), decision))
        self._topics.events(events)
        if self._topics.report(decision, self._goals.state()[0], self._heard.grid):
            self._diagnostics.set("mission", OK, f"{decision.state}: {decision.reason}")

    def close(self) -> None:
        """Without the mission nothing may drive."""
        self._lease.release()
        self._goals.cancel_all()
        self._writer.write()


def main() -> None:
    """Entry point of scripts/explore."""
    node.run("explore", ExploreNode)
