"""Commands of the page that move the robot: to a place on the map, and by hand."""

import json
import threading
import time

import rospy
from actionlib_msgs.msg import GoalID, GoalStatusArray
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseGoal
from std_msgs.msg import String

from vsx_ros.control.joystick import Joystick, StickAnswer
from vsx_ros.errors import VsxError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import calls, convert, headers, topics
from vsx_ros.ros.callbacks import json_number, json_object
from vsx_ros.ros.dashboard.commands import answer_of
from vsx_ros.ros.dashboard.server import Answer, Command
from vsx_ros.ros.situation import LIVE_GOAL

_PLAN_S = 10.0  # a long way on a busy machine
_GOALS_S = 10.0  # move_base tells its goals five times a second, but a busy machine has to connect first
_TICKETS = 2**53  # JavaScript counts exactly as far


class Drives:
    """Publishers: move_base/goal, move_base/cancel, cmd_vel_mux/input/teleop; all silent until somebody drives."""

    def __init__(self, v_m_s: float, omega_rad_s: float) -> None:
        """Full speeds of the stick."""
        self._goal_pub = rospy.Publisher(topics.MOVE_BASE_GOAL, MoveBaseActionGoal, queue_size=2)
        self._cancel_pub = rospy.Publisher(topics.MOVE_BASE_CANCEL, GoalID, queue_size=5)
        self._teleop_pub = rospy.Publisher(topics.COMMAND_TELEOP, Twist, queue_size=1, tcp_nodelay=True)
        self._lock, self._stick = threading.Lock(), Joystick(v_m_s, omega_rad_s)
        self._planning, self._asked = threading.Lock(), 0

    def commands(self) -> dict[str, Command]:
        """As ``commands.commands``."""
        return {"plan?": self.plan, "go?": self.go, "end-drive": self.end, "drive?": self.drive}

    def plan(self, text: str) -> Answer:
        """The way to a goal, as of ``goal_preview``; nothing moves. Of many that are asked at once the first and the
        last are planned: move_base has to plan its drive, too."""
        self._asked = number = self._asked + 1
        with self._planning:
            if number != self._asked:
                return Answer(False, "another place was chosen meanwhile")
            return self._way(text)

    def _way(self, text: str) -> Answer:
        told = answer_of(topics.PREVIEW_GOAL, AddDiagnostics, text, within_s=_PLAN_S)
        if not told.ok:
            return told
        way = json.loads(told.message)
        return Answer(True, f"{way['length_m']:.1f} m, about {way['seconds']:.0f} s", way)

    def go(self, text: str) -> Answer:
        """Drive to a goal, if there is a way. The exploration waits meanwhile."""
        told = self._way(text)
        if not told.ok or told.data is None:
            return told
        if self._goal_pub.get_num_connections() == 0:
            return Answer(False, f"nobody listens on {self._goal_pub.resolved_name}; is move_base running?")
        goal = SE2(*told.data["goal"])
        place = convert.pose_stamped(topics.MAP_FRAME, headers.now_ns(), goal)
        identity = GoalID(rospy.Time.now(), f"{rospy.get_name()}-{headers.now_ns()}")
        self._goal_pub.publish(MoveBaseActionGoal(goal_id=identity, goal=MoveBaseGoal(place)))
        return Answer(True, f"the robot drives to {goal.x:.2f}, {goal.y:.2f}: {told.message}")

    def end(self) -> Answer:
        """Cancel the goals that are not the exploration's, whoever sent them."""

        def goals() -> GoalStatusArray:
            return rospy.wait_for_message(topics.MOVE_BASE_STATUS, GoalStatusArray, timeout=_GOALS_S)

        if self._cancel_pub.get_num_connections() == 0:
            return Answer(False, f"nobody listens on {self._cancel_pub.resolved_name}; is move_base running?")
        try:
            told = calls.within(2.0 * _GOALS_S, goals, topics.MOVE_BASE_STATUS)
        except rospy.ROSException:
            return Answer(False, "move_base does not say what it drives to; end the exploration, or stop the wheels")
        explorer = f"{rospy.resolve_name('explore')}-"
        ours = [status.goal_id for status in told.status_list if status.status in LIVE_GOAL]
        ours = [goal for goal in ours if not goal.id.startswith(explorer)]
        for goal in ours:
            self._cancel_pub.publish(GoalID(id=goal.id))  # with its stamp it would end all older ones, also later
        return Answer(bool(ours), "the drive is ended" if ours else "the robot drives to no goal of an operator")

    def drive(self, text: str) -> Answer:
        """Move the stick: forward and left, -1 to 1, and the ticket of the last answer. The base forgets it after half
        a second, so the page says it again while a thumb holds the stick."""
        try:
            tree = json_object(String(text), "forward", "left", "ticket")
            forward, left = (json_number(tree, name, 1.0, "") for name in ("forward", "left"))
            ticket = int(json_number(tree, "ticket", _TICKETS, ""))
        except VsxError as error:
            return Answer(False, str(error))
        with self._lock:
            moved = self._stick.move(time.monotonic(), forward, left, ticket)
            if moved.command is not None:
                self._teleop_pub.publish(convert.twist(moved.command))
        return self._said(moved)

    def _said(self, moved: StickAnswer) -> Answer:
        if self._teleop_pub.get_num_connections() == 0:
            return Answer(False, "no base listens to the stick; is mobile_base running?", {"ticket": moved.ticket})
        return Answer(not moved.reason, moved.reason, {"ticket": moved.ticket})
