"""Node ``mobile_base``: driver, command mux and the last decision before the wheels, in one small process.

Two more processes stop the wheels when this one is killed or hangs (vsx_hw.watchdog). The wheels stand still if one of
them is missing, or if the ROS master does not know all services and topics of this node, such as the emergency stop.

Subscribers: cmd_vel_mux/input/{safety_controller,teleop,navi} (priority in this order; each has its own timeout).
Publishers: odom (50 Hz), /tf odom -> base_footprint (with the base ros its driver does that; this node only in a
    namespace whose odom is not the driver's), joint_states, mobile_base/hazards (UInt8, the low bits of
    vsx_hw.readings.Hazard, latched, on change), mobile_base/buttons (UInt8, those pressed, latched, on change; Kobuki:
    1, 2, 4 are B0, B1, B2; Create: 1 Play, 4 Advance; Create 2: 1 Clean, 2 Spot, 4 Dock), battery (1 Hz),
    cmd_vel_mux/active (latched, on change), mobile_base/operator_hold (latched String, JSON, on change: by, since_ns;
    "by" is "emergency stop", teleop, safety_controller or empty), mobile_base/odometry_factors (latched: way, turn),
    mobile_base/sensors/imu_data (if the base has a gyro) and imu_data_raw (Kobuki: 100 samples a second of its three
    axes, bias not removed), mobile_base/docked (latched, on change), mobile_base/sensors/dock_ir (UInt8MultiArray: the
    dock's beams on the right, centre, left receiver, bits of vsx_hw.readings.DockBeam; its label: the kind of base),
    mobile_base/sensors/bumper_pointcloud (while a bumper is pressed or a cliff seen, and once after).
Services: mobile_base/estop (true stops, false allows; survives a restart of the node), mobile_base/reset_odometry.
Parameters: ~robot_type (auto: whichever answers; kobuki, create, create2; ros or ros:ODOMETRY,COMMAND: a base with its
    own ROS driver, by its topics, default odom and cmd_vel), ~port (/dev/kobuki), ~cmd_vel_timeout (s, 0.25: navi and
    the driver), ~max_vel (m/s), ~max_angular_vel (rad/s): the wheels never turn faster (0.5 and 1.5, or limits.v_m_s
    and limits.omega_rad_s if those are higher),
    ~odom_linear_scale_correction, ~odom_angular_scale_correction (as configured under robot.odometry),
    ~publish_tf (bool, true; false: another node, e.g. an EKF, publishes base_footprint in odom),
    ~allow_unknown_firmware (bool, false: a Kobuki with unknown firmware, hardware or protocol does not drive).
    ~estopped is where this node stores the emergency stop."""

import time
from contextlib import suppress

import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from vsx_hw.readings import BaseReading, Hazard
from vsx_ros.config import Config
from vsx_ros.ros import calls, headers, logs, node, threads, topics
from vsx_ros.ros.base_drivers import Listeners, base_driver, base_settings, base_watchdogs, supervisor, wait_for_base
from vsx_ros.ros.base_health import BaseHealth, tell_systemd
from vsx_ros.ros.base_messages import BaseTopics
from vsx_ros.ros.callbacks import offer_trigger
from vsx_ros.ros.logs import Diagnostics
from vsx_ros.ros.master_watch import master_watch

LINK_PERIOD_S = 0.2  # a silent base must be noticed within a second
_CLOSE_S = 3.5  # our own drivers answer within 3
_UNGUARDED = "a watchdog of the wheels does not answer; a new one starts"


class MobileBaseNode:
    """Answers each report of the base with a decision in the same cycle."""

    def __init__(self, config: Config) -> None:
        self._master = master_watch()
        self._master.period_s, self._master.topics_every = 0.1, 3
        settings = base_settings(config)
        self._supervisor = supervisor(config, settings)
        self._topics = BaseTopics(settings.robot_type, config.exploration.teleop_quiet_s, settings.factors)
        diagnostics = Diagnostics(settings.hardware_id)
        settings = wait_for_base(settings, diagnostics)
        self._health = BaseHealth(diagnostics, self._supervisor)
        self._watchdogs = base_watchdogs(settings)
        self._driver = base_driver(settings, Listeners(self._on_reading, self._on_link, self._watchdogs.beat))
        for source, topic in topics.COMMANDS.items():
            rospy.Subscriber(topic, Twist, self._on_command, source, queue_size=1, tcp_nodelay=True)
        rospy.Service(topics.ESTOP, SetBool, self._on_estop)
        offer_trigger(topics.RESET_ODOMETRY, self._reset_odometry)
        self._driver.start()
        tell_systemd("READY=1")
        threads.every(1.0, "health", self._report)
        threads.every(LINK_PERIOD_S, "link", lambda: self._health.check(self._driver))

    def _on_command(self, msg: Twist, source: str) -> None:
        accepted = self._supervisor.command(source, msg.linear.x, msg.angular.z, time.monotonic_ns())
        if not accepted and logs.due("command", 1.0):
            rospy.logwarn("%s: command refused, not finite or absurd:\n%s", topics.COMMANDS[source], msg)

    def _on_reading(self, reading: BaseReading) -> None:
        """On the driver's thread: send the decision first, then publish."""
        hold = self._master.trouble if self._watchdogs.answer else _UNGUARDED
        decision, signal = self._supervisor.answer(time.monotonic_ns(), reading, hold)
        self._driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)
        self._driver.show(signal)
        self._topics.tell(reading, decision.source)
        self._topics.tell_hold(self._supervisor.estopped, decision.source)
        self._health.heard(reading, decision)

    def _on_link(self, connected: bool, message: str) -> None:
        """On the driver's thread. Old commands become invalid; a disconnected base has no contacts."""
        self._supervisor.forget_commands()
        if not connected:
            self._topics.tell_hazards(Hazard.NONE, headers.now_ns())

    def _on_estop(self, request: SetBoolRequest) -> SetBoolResponse:
        self._supervisor.emergency_stop(bool(request.data))
        self._master.keep({"~estopped": bool(request.data)})
        self._topics.tell_hold(bool(request.data))
        rospy.logwarn("emergency stop %s", "set" if request.data else "cleared")
        return SetBoolResponse(True, "stopped" if request.data else "free to drive")

    def _reset_odometry(self) -> str:
        self._driver.reset_odometry()
        return "odometry starts at the origin"

    def _report(self) -> None:
        """Report battery and health; called once a second."""
        self._watchdogs.revive()
        if (reading := self._health.report()) is not None:
            self._topics.tell_battery(reading)

    def close(self) -> None:
        """Stop the wheels. If that fails or hangs, or a silent driver claims it, the watchdogs do it once this process
        has ended."""
        with suppress(calls.NoAnswer):
            if calls.within(_CLOSE_S, self._driver.close, "the driver") and not self._health.silence:
                self._watchdogs.release()


def main() -> None:
    """Entry point of scripts/mobile_base."""
    node.run("mobile_base", MobileBaseNode)
