"""What the parameters of the node mobile_base say: which base, how it is driven, how fast at most."""

from __future__ import annotations

import time

import rospy

from vsx_hw.detect import detect_base
from vsx_hw.errors import DeviceError
from vsx_hw.safety import SOURCES, SpeedLimits, Supervisor
from vsx_ros.config import Config, LimitsConfig
from vsx_ros.ros import logs, threads
from vsx_ros.ros.base_drivers import BaseSettings
from vsx_ros.ros.diagnostics import ERROR, Diagnostics


def base_settings(config: Config) -> BaseSettings:
    """The base, maybe auto, and its calibration."""
    return BaseSettings(
        robot_type=str(rospy.get_param("~robot_type", "auto")),
        port=str(rospy.get_param("~port", "/dev/kobuki")),
        command_timeout_s=float(rospy.get_param("~cmd_vel_timeout", 0.25)),
        linear_scale=float(rospy.get_param("~odom_linear_scale_correction", config.robot.odometry.linear_scale)),
        angular_scale=float(rospy.get_param("~odom_angular_scale_correction", config.robot.odometry.angular_scale)),
        allow_unknown_firmware=bool(rospy.get_param("~allow_unknown_firmware", False)),
    )


def wait_for_base(settings: BaseSettings, diagnostics: Diagnostics) -> BaseSettings:
    """Of auto, wait until a base answers, and name it."""
    while settings.robot_type == "auto":
        if threads.is_ending():
            raise KeyboardInterrupt
        try:
            settings = settings._replace(robot_type=detect_base(settings.port))
            rospy.loginfo("%s: found a %s", settings.port, settings.robot_type)
        except DeviceError as error:
            diagnostics.set("link", ERROR, str(error), device=settings.port)
            if logs.due("base", 10.0):
                rospy.logwarn("%s", error)
            time.sleep(1.0)
    return settings


def supervisor(config: Config, settings: BaseSettings) -> Supervisor:
    """With the emergency stop as it was when the node ended."""
    timeout_s = settings.command_timeout_s
    sources = tuple(s._replace(timeout_s=timeout_s) if s.name == "navi" else s for s in SOURCES)
    made = Supervisor(speed_limits(config.limits), sources)
    made.emergency_stop(bool(rospy.get_param("~estopped", False)))
    return made


def speed_limits(limits: LimitsConfig) -> SpeedLimits:
    """~max_vel and ~max_angular_vel; by default the follower is never held back."""
    caps = []
    for name, default, wanted in (("~max_vel", 0.5, limits.v_m_s), ("~max_angular_vel", 1.5, limits.omega_rad_s)):
        caps.append(float(rospy.get_param(name, max(default, wanted))))
        if caps[-1] < wanted:
            rospy.logwarn(
                "%s is %g, less than the configured limit of %g: the base will lag behind its plans; lower the limit",
                rospy.resolve_name(name), caps[-1], wanted,
            )  # fmt: skip
    return SpeedLimits(*caps)
