"""The emergency stop behind ``vsx stop``."""

from __future__ import annotations

import sys
import time

import rospy
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_ros.errors import ConfigError
from vsx_ros.ros import calls, operator_command, topics
from vsx_ros.runs.exit_codes import DONE

_ANSWER_S = 6.0
_STAND_S = 2.0
_STANDING_M_S, _STANDING_RAD_S = 0.01, 0.02


@operator_command.command
def stop(*, release: bool) -> int:
    """Set or release the emergency stop, and see that the wheels stand.

    Raises ConfigError when there is no master or no base, DeviceError when the base does not answer or rolls on.
    """

    def call() -> None:
        operator_command.join("stop")
        rospy.ServiceProxy(topics.ESTOP, SetBool)(not release)

    try:
        calls.within(_ANSWER_S, call, "the base")
    except calls.NoAnswer as error:
        raise DeviceTimeout(f"{error}; use its power button") from error
    except (rospy.ServiceException, rospy.ROSException) as error:
        name = rospy.resolve_name(topics.ESTOP)
        raise ConfigError(
            f"no base offers {name} ({error}); if wheels turn use its power button, else start it"
        ) from error
    if release:
        sys.stdout.write("released: the robot may drive\n")
        return DONE
    _see_it_stand()
    sys.stdout.write("stopped: the wheels stand until 'vsx stop --release'\n")
    return DONE


def _see_it_stand() -> None:
    """Wait for odometry that says so. Raises DeviceError when the wheels still turn, or nobody knows."""
    said = "it sends no odometry"
    deadline_s = time.monotonic() + _STAND_S
    while (left_s := deadline_s - time.monotonic()) > 0.0:
        try:
            twist = rospy.wait_for_message(topics.ODOM, Odometry, timeout=left_s).twist.twist
        except rospy.ROSException:
            break
        if abs(twist.linear.x) < _STANDING_M_S and abs(twist.angular.z) < _STANDING_RAD_S:
            return
        said = f"its odometry says {twist.linear.x:.2f} m/s, {twist.angular.z:.2f} rad/s"
    raise DeviceError(f"the base took the emergency stop, but {said}; look at it, and use its power button if it rolls")
