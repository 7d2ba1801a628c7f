"""A goal in the map (X Y DEG) for a running robot, as any move_base client sends it; the exploration pauses meanwhile.

scripts/vsx explore --world lab &
python examples/send_a_goal.py 0.5 0.0 0
"""

import math
import sys

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_srvs.srv import Trigger

PATIENCE_S = 30.0


def main(x: float, y: float, heading: float) -> int:
    rospy.init_node("send_a_goal", anonymous=True, disable_signals=True)
    client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
    if not client.wait_for_server(rospy.Duration(PATIENCE_S)):
        sys.exit(f"no robot took part within {PATIENCE_S:g} s; start one with 'scripts/vsx explore --world lab'")
    pause, go_on = (rospy.ServiceProxy(f"explore/{word}", Trigger) for word in ("pause", "resume"))
    pause.wait_for_service(PATIENCE_S)
    pause()
    goal = MoveBaseGoal()
    goal.target_pose.header.frame_id, goal.target_pose.header.stamp = "map", rospy.Time.now()
    goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
    goal.target_pose.pose.orientation.z = math.sin(0.5 * heading)
    goal.target_pose.pose.orientation.w = math.cos(0.5 * heading)
    state = client.send_goal_and_wait(goal, rospy.Duration(60.0))
    print(f"{GoalStatus.to_string(state)}: {client.get_goal_status_text()}")
    go_on()
    return 0 if state == GoalStatus.SUCCEEDED else 1


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), float(sys.argv[2]), math.radians(float(sys.argv[3]))))
