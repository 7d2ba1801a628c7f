"""Node ``mobile_base``: driver, command mux and the last decision before the wheels, in one small process.

Two more processes stop the wheels when this one is killed or hangs (vsx_hw.guardian). Without both, or where the ROS
master that answers does not have all that this node offers, the emergency stop above all, they stand.

Subscribers: cmd_vel_mux/input/{safety_controller,teleop,navi} (priority in this order; each has its own timeout).
Publishers: odom (50 Hz), /tf odom -> base_footprint, joint_states, mobile_base/hazards (UInt8, the low bits of
    vsx_hw.readings.Hazard, latched, on change), mobile_base/buttons (UInt8, those pressed, latched, on change; Kobuki:
    1, 2, 4 are B0, B1, B2; Create: 1 Play, 4 Advance; Create 2: 1 Clean, 2 Spot, 4 Dock), battery (1 Hz),
    cmd_vel_mux/active (latched, on change), mobile_base/sensors/imu_data (where the base has a gyro) and imu_data_raw
    (Kobuki: 100 samples a second of its three axes, the zero not taken off),
    mobile_base/sensors/bumper_pointcloud (while a bumper is pressed or a cliff seen, and once after).
Services: mobile_base/estop (true stops, false allows; outlives a restart of the node), mobile_base/reset_odometry.
Parameters: ~robot_type (auto: which one answers; kobuki, create, create2; ros or ros:ODOMETRY,COMMAND: a base with a
    driver of its own, by its topics, odom and cmd_vel), ~port (/dev/kobuki),
    ~cmd_vel_timeout (s, 0.25: navi and the driver), ~max_vel (m/s), ~max_angular_vel (rad/s): the wheels
    never turn faster (0.5 and 1.5, or what limits.v_m_s and limits.omega_rad_s say if that is more),
    ~odom_linear_scale_correction, ~odom_angular_scale_correction (as configured under robot.odometry),
    ~publish_tf (bool, true; false: somebody else, an EKF, says where base_footprint is in odom),
    ~allow_unknown_firmware (bool, false: a Kobuki with firmware, hardware or a protocol that is not known stands).
    ~estopped is the emergency stop as this node remembers it.
"""

from __future__ import annotations

import threading
import time

import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse, Trigger, TriggerRequest, TriggerResponse

from vsx_hw.detect import detect_base
from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, Hazard, Signal
from vsx_hw.safety import SOURCES, Decision, SpeedLimits, Supervisor
from vsx_ros.config import Config, LimitsConfig
from vsx_ros.ros import clock, logs, node, service_manager, threads, topics
from vsx_ros.ros.base_drivers import BaseSettings, Listeners, base_driver, base_guardians
from vsx_ros.ros.base_topics import BaseTopics
from vsx_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics
from vsx_ros.ros.master_watch import master_watch
from vsx_ros.ros.topic_base import own_driver_odometry

_INPUTS = {
    "safety_controller": topics.COMMAND_SAFETY,
    "teleop": topics.COMMAND_TELEOP,
    "navi": topics.COMMAND_NAVI,
}
LINK_PERIOD_S = 0.2
_MASTER_PERIOD_S = 0.1
_BATTERY_LEVELS = {"low": WARN, "critical": ERROR}


class MobileBaseNode:
    """Every report of the base is answered with a decision in the same cycle; commands only leave their word."""

    def __init__(self, config: Config) -> None:
        timeout_s = float(rospy.get_param("~cmd_vel_timeout", 0.25))
        sources = tuple(s._replace(timeout_s=timeout_s) if s.name == "navi" else s for s in SOURCES)
        self._supervisor = Supervisor(speed_limits(config.limits), sources)
        self._lock = threading.Lock()
        self._latest: tuple[BaseReading, Decision] | None = None
        self._troubles: tuple[str, ...] = ()
        self._doubt = ""
        self._supervisor.emergency_stop(bool(rospy.get_param("~estopped", False)))
        self._master = master_watch()
        self._master.period_s = _MASTER_PERIOD_S
        kind = str(rospy.get_param("~robot_type", "auto"))
        self._topics = BaseTopics(own_driver_odometry(kind))
        port = str(rospy.get_param("~port", "/dev/kobuki"))
        self._diagnostics = Diagnostics(port)
        settings = BaseSettings(
            self._find_base(kind, port),
            port,
            timeout_s,
            float(rospy.get_param("~odom_linear_scale_correction", config.robot.odometry.linear_scale)),
            float(rospy.get_param("~odom_angular_scale_correction", config.robot.odometry.angular_scale)),
            bool(rospy.get_param("~allow_unknown_firmware", False)),
        )
        self._guardians = base_guardians(settings.robot_type, port)
        self._driver = base_driver(settings, Listeners(self._on_reading, self._on_link, self._guardians.beat))
        for source, topic in _INPUTS.items():
            rospy.Subscriber(topic, Twist, self._on_command, source, queue_size=1, tcp_nodelay=True)
        rospy.Service(topics.ESTOP, SetBool, self._on_estop)
        rospy.Service(topics.RESET_ODOMETRY, Trigger, self._on_reset_odometry)
        self._driver.start()
        service_manager.notify(service_manager.READY)
        threads.every(1.0, "health", self._report)
        threads.every(LINK_PERIOD_S, "link", self._report_link)

    def _find_base(self, robot_type: str, port: str) -> str:
        """~robot_type; with auto the node waits until a base answers."""
        while robot_type == "auto":
            if threads.is_ending():
                raise KeyboardInterrupt
            try:
                robot_type = detect_base(port)
                rospy.loginfo("%s: found a %s", port, robot_type)
            except DeviceError as error:
                self._diagnostics.set("link", ERROR, str(error), device=port)
                if logs.due("base", 10.0):
                    rospy.logwarn("%s", error)
                time.sleep(1.0)
        return robot_type

    def _on_command(self, msg: Twist, source: str) -> None:
        with self._lock:
            accepted = self._supervisor.command(source, msg.linear.x, msg.angular.z, time.monotonic_ns())
        if not accepted and logs.due("command", 1.0):
            rospy.logwarn("%s: command refused, not finite or absurd:\n%s", _INPUTS[source], msg)

    def _on_reading(self, reading: BaseReading) -> None:
        """On the driver's thread: decide first, talk later."""
        now_ns = time.monotonic_ns()
        odometry = reading.odometry
        with self._lock:
            self._supervisor.hold = self._reason_to_stand() or reading.refusal
            decision = self._supervisor.decide(now_ns, reading.hazards)
            self._supervisor.observe(odometry.fault)
            locked = self._supervisor.locked
        self._driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)
        held = bool(decision.reason and decision.source)
        self._driver.show(Signal.ALARM if locked else Signal.HELD if held else Signal.READY)
        self._topics.tell(reading, decision.source)
        if odometry.doubt != self._doubt:
            self._doubt = odometry.doubt
            rospy.logwarn("odometry: %s", self._doubt or "all sensors agree again")
        self._latest = reading, decision

    def _reason_to_stand(self) -> str:
        if not self._guardians.answer:
            return "a guardian of the wheels does not answer; a new one starts"
        return self._master.trouble

    def _on_link(self, connected: bool, message: str) -> None:
        """On the driver's thread. Commands of before a reconnection do not count; a base that is away touches
        nothing."""
        with self._lock:
            self._supervisor.forget_commands()
        if not connected:
            self._topics.tell_hazards(Hazard.NONE, clock.now_ns())

    def _on_estop(self, request: SetBoolRequest) -> SetBoolResponse:
        with self._lock:
            self._supervisor.emergency_stop(bool(request.data))
        self._master.keep({"~estopped": bool(request.data)})
        rospy.logwarn("emergency stop %s", "set" if request.data else "cleared")
        return SetBoolResponse(True, "stopped" if request.data else "free to drive")

    def _on_reset_odometry(self, _: TriggerRequest) -> TriggerResponse:
        try:
            self._driver.reset_odometry()
        except DeviceError as error:
            return TriggerResponse(False, str(error))
        return TriggerResponse(True, "odometry starts at the origin")

    def _report_link(self) -> None:
        """Often: a silent base is to be known within a second."""
        status = self._driver.status()
        if not status.alive:
            raise DeviceError(f"{status.device}: the driver's thread has ended; the node begins anew")
        level = OK if status.connected else ERROR
        self._diagnostics.set("link", level, status.message, device=status.device, **status.counters)

    def _report(self) -> None:
        """Once a second: battery and health."""
        with self._lock:
            service_manager.notify(service_manager.ALIVE)
        self._guardians.revive()
        latest = self._latest
        if latest is None or not self._driver.status().connected:
            return
        reading, decision = latest
        battery = reading.battery
        self._topics.tell_battery(reading)
        self._diagnostics.set(
            "battery", _BATTERY_LEVELS.get(battery.state, OK), battery.state, voltage_v=battery.voltage_v,
            fraction=round(battery.fraction, 3), charging=battery.charging, docked=battery.docked,
        )  # fmt: skip
        odometry = reading.odometry
        self._diagnostics.set(
            "odometry", OK if odometry.trusted else WARN,
            odometry.doubt or ("all sensors agree" if odometry.trusted else "pushed: the direction is not known"),
            gaps=odometry.gaps,
        )  # fmt: skip
        blocked = bool(decision.reason) and decision.source != ""
        troubles = reading.warnings + ((reading.refusal,) if reading.refusal else ())
        for trouble in set(troubles) - set(self._troubles):
            rospy.logwarn("%s", trouble)
        self._troubles = troubles
        message = "; ".join([decision.reason or f"driving for {decision.source}", *reading.warnings])
        self._diagnostics.set(
            "safety", WARN if blocked or reading.hazards or troubles else OK, message,
            hazards=reading.hazards.name or "NONE", estop=self._supervisor.estopped,
            refused_commands=self._supervisor.refused, mode=reading.mode,
        )  # fmt: skip

    def close(self) -> None:
        """Stop the wheels and leave the base safe; where that failed, the guardians do it after this process."""
        if self._driver.close():
            self._guardians.release()


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


def main() -> None:
    """Entry point of scripts/mobile_base."""
    node.run("mobile_base", MobileBaseNode)
