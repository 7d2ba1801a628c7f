"""The operator's commands join a running ROS graph briefly and leave it unchanged. The shortest ones are here."""

import contextlib
import functools
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, ParamSpec

import rosgraph
import rospy
from nav_msgs.msg import Odometry as OdometryMsg
from std_srvs.srv import SetBool, Trigger

from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.robot import PoseSpeeds
from vsx_ros.ros import calls, convert, logs, topics
from vsx_ros.ros.callbacks import ODOMETRY_QUEUE
from vsx_ros.ros.environment import DEFAULT_MASTER, export_ros_address
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.runs.process import DONE, STOPPED

P = ParamSpec("P")

_LEAVE_S = 3.0  # to unregister from the master
_STOP_S, _STAND_S = 6.0, 2.0  # for the answer to the emergency stop, and for odometry; then to stand still
_LOOK_S = 0.1  # a driver may tell no speeds, and one pose alone tells none either
_OFFERED_S, _SAVED_S = 5.0, 120.0  # The map of a large building is 120 MB, and its disk may be slow


def join(name: str) -> None:
    """Become a node with a unique name. Ctrl-C keeps its usual Python behaviour. Raises ConfigError if no master
    answers."""
    export_ros_address()
    uri = os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
    if not rosgraph.is_master_online():
        raise ConfigError(
            f"no ROS master answers at {uri}, so no robot is running there (a base without its master stands still); "
            "start one with 'vsx explore' or roslaunch, or set ROS_MASTER_URI"
        )
    rospy.init_node(f"vsx_{name}", anonymous=True, disable_signals=True, disable_rosout=True)
    master_watch()


def command(work: Callable[P, int]) -> Callable[P, int]:
    """Wraps ``work``, which joins; leaves at its end. Ctrl-C is the normal end of these commands, no failure."""

    @functools.wraps(work)
    def joining(*args: P.args, **options: P.kwargs) -> int:
        logs.quiet_failures()
        try:
            return work(*args, **options)
        except KeyboardInterrupt:
            return DONE
        finally:
            with contextlib.suppress(calls.NoAnswer):
                calls.within(_LEAVE_S, lambda: rospy.signal_shutdown("the command is done"), "the ROS master")

    return joining


def asked(service: str, kind: type[Any], *arguments: object, within_s: float, remedy: str) -> str:
    """What a service answers. Raises ConfigError with the remedy if nobody offers it, InputError if it refuses."""
    try:
        answer = calls.service(service, kind, *arguments, within_s=within_s)
    except (rospy.ROSException, rospy.ServiceException) as error:
        raise _nobody_offers(service, error, remedy) from error
    if not answer.success:
        raise InputError(str(answer.message))
    return str(answer.message)


def _nobody_offers(service: str, error: Exception, remedy: str) -> ConfigError:
    return ConfigError(f"nobody offers {rospy.resolve_name(service)} ({error}); {remedy}")


@command
def stop(*, release: bool) -> int:
    """The emergency stop of ``vsx stop``: set or release it. After setting it, check that the wheels stand. Raises
    ConfigError without a master or base, DeviceError when the base does not answer or rolls on."""

    try:
        calls.within(calls.MASTER_S, lambda: join("stop"), "the ROS master")
        calls.within(_STOP_S, lambda: rospy.ServiceProxy(topics.ESTOP, SetBool)(not release), "the base")
        if not release:
            _see_it_stand()
    except KeyboardInterrupt:
        sys.stderr.write("vsx: interrupted before the base had confirmed; look whether its wheels stand\n")
        return STOPPED
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
    sys.stdout.write("stopped: the wheels stand until 'vsx stop --release'\n")
    return DONE


def _see_it_stand() -> None:
    """Wait until odometry reports standstill. Raises DeviceError if the wheels still turn or no odometry comes."""
    said, heard = "it sends no odometry", SimpleQueue[OdometryMsg]()
    rospy.Subscriber(topics.ODOM, OdometryMsg, heard.put, queue_size=ODOMETRY_QUEUE, tcp_nodelay=True)
    speeds = PoseSpeeds()
    with contextlib.suppress(Empty):  # what has come counts, however late this thread is
        msg = first = heard.get(timeout=_STOP_S)
        deadline_s = time.monotonic() + _STAND_S
        while said := _why_not_standing(msg, first, speeds):
            msg = heard.get(timeout=max(0.0, deadline_s - time.monotonic()))
    if said:
        raise DeviceError(
            f"the base took the emergency stop, but {said}; look at it, and use its power button if it rolls"
        )


def _why_not_standing(msg: OdometryMsg, first: OdometryMsg, speeds: PoseSpeeds) -> str:
    """An empty string if it stands. first: message. speeds: have seen the messages before this one."""
    try:
        seen = speeds.of(convert.odometry(msg))
    except InputError as error:
        return str(error)
    if not seen.stands:
        return f"its odometry says {seen.v:.2f} m/s, {seen.omega:.2f} rad/s"
    looked_s = (msg.header.stamp - first.header.stamp).to_sec()
    return "" if looked_s >= _LOOK_S else f"its odometry covers only {looked_s:.2f} s"


@command
def save_map(out: Path | None) -> int:
    """``vsx map save`` of a running robot: vslam saves its map. out: the file, or None for the node's default. Raises
    ConfigError if vslam does not run, InputError if the map cannot be saved."""
    join("save_map")
    remedy = "start the robot, or save the map of a run: 'vsx map save RUN'"
    try:
        rospy.wait_for_service(topics.SAVE_MAP, timeout=_OFFERED_S)
    except rospy.ROSException as error:
        raise _nobody_offers(topics.SAVE_MAP, error, remedy) from error
    usual = rospy.get_param(topics.SAVE_MAP_TO, "")
    try:
        if out is not None:
            rospy.set_param(topics.SAVE_MAP_TO, str(out.resolve()))
        sys.stdout.write(f"{asked(topics.SAVE_MAP, Trigger, within_s=_SAVED_S, remedy=remedy)}\n")
    finally:
        rospy.set_param(topics.SAVE_MAP_TO, usual)  # who calls the service himself gets what he is used to
    return DONE
