"""The health of the base, in the diagnostics and the log of the node mobile_base, and for systemd."""

import contextlib
import os
import socket
import time
from concurrent import futures

import rospy

from vsx_hw.base_driver import SILENT_NS
from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, LinkStatus
from vsx_hw.safety import Decision, Supervisor
from vsx_ros.ros.base_drivers import Base
from vsx_ros.ros.calls import NoAnswer, begin, within
from vsx_ros.ros.logs import ERROR, OK, WARN, Diagnostics

_ANSWER_S = 0.1  # the answer of a slower driver is taken by a later check
LATE_NS = 500_000_000  # the drivers here call themselves connected for no longer without a reading
_BATTERY_LEVELS = {"low": WARN, "critical": ERROR}


class BaseHealth:
    """Reports link, battery, odometry and safety to the diagnostics, and logs changes. silence: why the wheels must
    stand although the driver says that it is connected; empty while readings come."""

    def __init__(self, diagnostics: Diagnostics, supervisor: Supervisor) -> None:
        self._diagnostics, self._supervisor = diagnostics, supervisor
        self._latest: tuple[BaseReading, Decision] | None = None
        self._heard_ns = self._late_since_ns = 0
        self._connected, self._status = False, LinkStatus(False, "the driver has not answered yet", "the base", {})
        self._asked: futures.Future[LinkStatus] | None = None
        self._asked_ns, self._heard_since_answer = 0, False
        self._troubles: tuple[str, ...] = ()
        self._doubt = self.silence = ""

    def heard(self, reading: BaseReading, decision: Decision) -> None:
        """A reading was answered with this decision; any thread. Logs which sensor the others contradict."""
        self._latest, self._heard_ns, self._heard_since_answer = (reading, decision), time.monotonic_ns(), True
        doubt = reading.odometry.doubt
        if doubt != self._doubt:
            self._doubt = doubt
            rospy.logwarn("odometry: %s", doubt or "all sensors agree again")

    def check(self, driver: Base) -> None:
        """Report the link; called a few times a second. Late readings set ``silence``, make old commands invalid and
        let the wheels stand. Raises DeviceError, which ends the node, if they stay away: the driver's thread is dead or
        hangs, maybe inside a lock that these calls need, too."""
        self._ask(driver)
        self._link(self._status)
        if self.silence:
            with contextlib.suppress(NoAnswer):
                within(_ANSWER_S, lambda: driver.drive(0.0, 0.0), "the driver")

    def _ask(self, driver: Base) -> None:
        """Take what the driver says, or will say to the one call that is under way. Until then what it said last
        counts; but if it is late, and sends readings, it is connected."""
        if self._asked is None:
            self._asked, self._asked_ns = begin(driver.status, "the driver"), time.monotonic_ns()
        if futures.wait([self._asked], _ANSWER_S).done:
            answer, self._asked, self._heard_since_answer = self._asked, None, False
            self._status = answer.result()
        elif self._heard_since_answer and not self._status.connected and time.monotonic_ns() - self._asked_ns > LATE_NS:
            self._status = self._status._replace(connected=True, message="connected; its status is awaited")

    def _link(self, status: LinkStatus) -> None:
        now_ns = time.monotonic_ns()
        self._heard_ns = self._heard_ns or now_ns
        silent_ns = now_ns - self._heard_ns
        if not status.connected or silent_ns <= LATE_NS:
            self.silence, self._late_since_ns = "", 0
        else:
            self._late_since_ns = self._late_since_ns or now_ns  # as noticed: this process may have been halted
            told = f"no reading for {silent_ns * 1e-9:.1f} s though the driver says {status.message!r}"
            self.silence = f"{told}; the wheels are told to stand"
            self._supervisor.forget_commands()
            if now_ns - self._late_since_ns >= SILENT_NS:
                raise DeviceError(f"{status.device}: {told}; the node begins again")
            status = status._replace(connected=False, message=self.silence)
        self._connected = status.connected
        self._diagnostics.device("link", status)

    def report(self) -> BaseReading | None:
        """Report the latest reading, which is returned; None while the base is not connected. Called once a second,
        and tells systemd that commands are still decided."""
        with self._supervisor.lock:
            tell_systemd("WATCHDOG=1")
        if not self._connected or self._latest is None:
            return None
        reading, decision = self._latest
        battery, odometry = reading.battery, reading.odometry
        self._diagnostics.set(
            "battery", _BATTERY_LEVELS.get(battery.state, OK), battery.state, voltage_v=battery.voltage_v,
            fraction=round(battery.fraction, 3), charging=battery.charging, docked=battery.docked,
        )  # fmt: skip
        agree = "all sensors agree" if odometry.trusted else "pushed, or not sure of its heading"
        level = OK if odometry.trusted else WARN
        self._diagnostics.set("odometry", level, odometry.doubt or agree, gaps=odometry.gaps)
        troubles = (*reading.warnings, *filter(None, (reading.refusal, reading.disobeys)))
        for trouble in set(troubles) - set(self._troubles):
            rospy.logwarn("%s", trouble)
        self._troubles = troubles
        blocked = bool(decision.reason) and decision.source != ""
        message = "; ".join([decision.reason or f"driving for {decision.source}", *reading.warnings])
        self._diagnostics.set(
            "safety", WARN if blocked or reading.hazards or troubles else OK, message,
            hazards=reading.hazards.name or "NONE", estop=self._supervisor.estopped,
            refused_commands=self._supervisor.refused, mode=reading.mode,
        )  # fmt: skip
        return reading


def tell_systemd(state: str) -> None:
    """Send a state to the service manager (sd_notify). No effect unless a unit of Type=notify started the process."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as connection:
        connection.sendto(state.encode(), "\0" + address[1:] if address.startswith("@") else address)
