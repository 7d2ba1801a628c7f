"""The condition of a base in the diagnostics, what is new about it in the log, and signs of life for systemd."""

import contextlib
import os
import socket

import rospy

from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, BatteryReading, LinkStatus, OdometryReading
from vsx_hw.safety import Decision, Supervisor
from vsx_ros.ros.diagnostics import ERROR, OK, WARN, Diagnostics

_BATTERY_LEVELS = {"low": WARN, "critical": ERROR}


class BaseHealth:
    """Components link, battery, odometry and safety."""

    def __init__(self, diagnostics: Diagnostics, supervisor: Supervisor) -> None:
        self._diagnostics, self._supervisor = diagnostics, supervisor
        self._troubles: tuple[str, ...] = ()
        self._doubt = ""

    def link(self, status: LinkStatus) -> None:
        """Raises DeviceError where the driver's thread has ended."""
        if not status.alive:
            raise DeviceError(f"{status.device}: the driver's thread has ended; the node begins anew")
        level = OK if status.connected else ERROR
        self._diagnostics.set("link", level, status.message, device=status.device, **status.counters)

    def doubt(self, doubt: str) -> None:
        """Which sensor the others contradict; empty: none."""
        if doubt != self._doubt:
            self._doubt = doubt
            rospy.logwarn("odometry: %s", doubt or "all sensors agree again")

    def report(self, reading: BaseReading, decision: Decision) -> None:
        """Once a second: all but the link."""
        self._battery(reading.battery)
        self._odometry(reading.odometry)
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

    def _battery(self, battery: BatteryReading) -> None:
        self._diagnostics.set(
            "battery", _BATTERY_LEVELS.get(battery.state, OK), battery.state, voltage_v=battery.voltage_v,
            fraction=round(battery.fraction, 3), charging=battery.charging, docked=battery.docked,
        )  # fmt: skip

    def _odometry(self, odometry: OdometryReading) -> None:
        agree = "all sensors agree" if odometry.trusted else "pushed: the direction is not known"
        level = OK if odometry.trusted else WARN
        self._diagnostics.set("odometry", level, odometry.doubt or agree, gaps=odometry.gaps)


def tell_systemd(state: str) -> None:
    """A word to the service manager (sd_notify); nobody hears it unless a unit of Type=notify started the process."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as connection:
        connection.sendto(state.encode(), "\0" + address[1:] if address.startswith("@") else address)
