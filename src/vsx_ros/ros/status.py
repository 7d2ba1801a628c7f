"""Collects and prints ``vsx status``."""

import json
import math
import sys
import time
from collections import deque
from datetime import datetime
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import BatteryState, CameraInfo
from std_msgs.msg import Float32, String, UInt8

from vsx_ros.exploration.decision import MissionState
from vsx_ros.exploration.time_left import left_words, whole_minutes
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.robot import OperatorHold
from vsx_ros.ros import convert, operator_command, topics
from vsx_ros.ros.callbacks import hear_operator_hold, json_object, subscribe
from vsx_ros.ros.rooms import heard_rooms
from vsx_ros.ros.silence import Silence
from vsx_ros.ros.zones import heard_zones
from vsx_ros.runs import process
from vsx_ros.runs.process import DONE, FAILED

_LISTEN_S, _PERIOD_S = 2.0, 1.0  # measuring time for rates; time between two outputs
_PATIENCE_S, _TICK_S = 4.0, 0.1  # longest wait for values that nobody has published yet; between looks at them

_TOLD_BY = {
    "explore": ("state", "reason", "left_s"),
    "vslam": ("slam_state", "slam_reason", "tracked_ratio"),
    "mobile_base": (
        "base_reason", "estop", "held_by", "driver", "hazards", "battery_fraction", "battery_v", "charging"
    ),
    "dock": ("docking", "docking_reason", "battery_left_s"),
}  # fmt: skip
"""Node -> facts that are old once it is silent."""


class StatusBoard:
    """Subscribers: explore/status, vslam/state, vslam/stats/tracked_ratio, camera/rgb/camera_info (each image has one),
    battery, cmd_vel_mux/active, mobile_base/{hazards,operator_hold}, dock/status, /diagnostics, zones, rooms."""

    def __init__(self) -> None:
        self._facts: dict[str, Any] = dict.fromkeys(
            ("state", "reason", "slam_state", "slam_reason", "tracked_ratio", "camera_hz", "driver", "base_reason",
             "estop", "held_by", "held_since_ns", "hazards", "battery_fraction", "battery_v", "charging",
             "battery_left_s", "docking", "docking_reason", "zones", "zones_entered", "room", "left_s")
        )  # fmt: skip
        self._silence = Silence()
        self._safety = f"{rospy.resolve_name('mobile_base').lstrip('/')}: safety"
        self._tracking = f"{rospy.resolve_name('vslam').lstrip('/')}: tracking"
        self._first_image_s = math.inf
        self._images: deque[tuple[float, float]] = deque(maxlen=200)  # when heard, and of when
        ratio = f"{topics.STATS}/tracked_ratio"
        self._subscribers = [
            subscribe(topics.EXPLORE_STATUS, String, self._on_explore, queue_size=1),
            subscribe(topics.SLAM_STATE, DiagnosticStatus, self._on_slam, queue_size=1),
            subscribe(ratio, Float32, lambda m: self._set(tracked_ratio=m.data), queue_size=1),
            subscribe(topics.CAMERA_INFO, CameraInfo, self._on_image, queue_size=200),
            subscribe(topics.BATTERY, BatteryState, self._on_battery, queue_size=1),
            subscribe(topics.MUX_ACTIVE, String, lambda m: self._set(driver=m.data), queue_size=1),
            subscribe(topics.HAZARDS, UInt8, lambda m: self._set(hazards=convert.hazard_words(m.data)), queue_size=1),
            subscribe(topics.DOCK_STATUS, String, self._on_dock, queue_size=1),
            hear_operator_hold(self._on_hold),
            subscribe(topics.DIAGNOSTICS, DiagnosticArray, self._on_diagnostics, queue_size=20),
            subscribe(topics.ZONES, String, self._on_zones, queue_size=1),
            subscribe(topics.ROOMS, String, self._on_rooms, queue_size=1),
        ]

    def facts(self) -> dict[str, Any]:
        """What is known now; None for unknown values. The first fact of a node that has spoken before is "silent", the
        others None; the end of a mission stays true."""
        silent = self._silence.names()
        facts = {**self._facts, "camera_hz": self._camera_hz()}
        for node, (first, *others) in _TOLD_BY.items():
            if node in silent and facts[first] != MissionState.DONE.value:
                facts |= {**dict.fromkeys(others), first: "silent"}
        return facts

    def wait(self) -> None:
        """Until all is known, or nobody has been connected for a while. Counted in ticks: a machine that is late gives
        the messages no time either."""
        always = self._facts.keys() - {"left_s", "battery_left_s"}
        connected, left_s = 0, _PATIENCE_S
        while any(self.facts()[name] is None for name in always) and left_s > 0.0:
            before, connected = connected, sum(each.get_num_connections() for each in self._subscribers)
            left_s = _PATIENCE_S if connected > before else left_s - _TICK_S
            time.sleep(_TICK_S)

    def _camera_hz(self) -> float | None:
        """Images a second by their stamps: after a late connection many come at once. None until it is measured."""
        now_s = time.monotonic()
        if now_s - self._first_image_s < _LISTEN_S:
            return None
        stamps_s = [stamp_s for heard_s, stamp_s in list(self._images) if now_s - heard_s < _LISTEN_S]
        if len(stamps_s) < 2:
            return 0.0
        span_s = stamps_s[-1] - stamps_s[0]
        return round((len(stamps_s) - 1) / span_s, 1) if span_s > 0.0 else None

    def _on_image(self, msg: CameraInfo) -> None:
        now_s = time.monotonic()
        self._images.append((now_s, msg.header.stamp.to_sec()))
        self._first_image_s = min(self._first_image_s, now_s)

    def _set(self, **facts: Any) -> None:
        self._facts.update(facts)

    def _on_explore(self, msg: String) -> None:
        status = json_object(msg, "state", "reason")
        left_s = status.get("left_s")
        self._silence.heard("explore")
        self._set(state=status["state"], reason=status["reason"])
        self._set(left_s=left_s if isinstance(left_s, int | float) else None)

    def _on_slam(self, msg: DiagnosticStatus) -> None:
        self._silence.heard("vslam")
        self._set(slam_state=msg.name, slam_reason=msg.message)

    def _on_dock(self, msg: String) -> None:
        status = json_object(msg, "state", "reason", "battery_left_s")
        self._silence.heard("dock")
        self._set(docking=status["state"], docking_reason=status["reason"], battery_left_s=status["battery_left_s"])

    def _on_hold(self, hold: OperatorHold | None) -> None:
        self._set(held_by=hold.by if hold is not None else "", held_since_ns=hold.since_ns if hold is not None else 0)

    def _on_battery(self, msg: BatteryState) -> None:
        charging = msg.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING
        self._set(battery_fraction=round(msg.percentage, 3), battery_v=round(msg.voltage, 2), charging=charging)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            if status.name == self._tracking:
                self._silence.heard("vslam")  # its state comes on change and with each map
            if status.name == self._safety:
                self._silence.heard("mobile_base")
                values = {pair.key: pair.value for pair in status.values}
                self._set(estop=values.get("estop") == "True", base_reason=status.message)

    def _on_zones(self, msg: String) -> None:
        zones, _ = heard_zones(msg)
        entered = json_object(msg).get("entered")
        self._set(zones=[zone.words() for zone in zones], zones_entered=entered if isinstance(entered, list) else [])

    def _on_rooms(self, msg: String) -> None:
        rooms, number = heard_rooms(msg)
        here = [f"{r.name} (number {r.number}), {r.known_ratio:.0%} known" for r in rooms if r.number == number]
        self._set(room=f"{here[0] if here else 'none'}; {len(rooms)} in the map")


def screen(facts: dict[str, Any]) -> str:
    """The facts as readable lines."""

    def shown(name: str, form: str = "{}", unknown: str = "-") -> str:
        return unknown if facts[name] is None else form.format(facts[name])

    def with_reason(state: str, reason: str) -> str:
        return shown(state) + (f": {facts[reason]}" if facts[reason] else "")

    held = ""
    if facts["held_by"] and not facts["estop"]:
        since = datetime.fromtimestamp(facts["held_since_ns"] * 1e-9)
        held = f"HELD BY THE OPERATOR ({facts['held_by']}) since {since:%H:%M:%S}; "
    wheels = "EMERGENCY STOP, 'vsx stop --release' ends it" if facts["estop"] else held + shown("base_reason")
    battery = shown("battery_fraction", "{:.0%}") + shown("battery_v", ", {:.1f} V", "")
    if facts["battery_left_s"] is not None:
        battery += f", lasts about {_words(facts['battery_left_s'])}"
    found = shown("tracked_ratio", "; {:.0%} of the points searched are found", "")
    entered = " and ".join(repr(str(name)) for name in facts["zones_entered"] or [])
    zones = "; ".join(facts["zones"] or []) or shown("zones", "none")
    left = left_words(facts["left_s"])
    lines = {
        "exploration": with_reason("state", "reason") + "; " * bool(left) + left,
        "slam": with_reason("slam_state", "slam_reason") + found,
        "camera": shown("camera_hz", "{:.1f} images a second"),
        "wheels": wheels,
        "hazards": "none" if facts["hazards"] == "" else shown("hazards"),
        "battery": battery + (", charging" if facts["charging"] else ""),
        "zones": (f"THE ROBOT REACHES INTO {entered}; " if entered else "") + zones,
        "room": shown("room"),
    }
    if facts["docking"] not in (None, DockingState.IDLE.value):
        lines["dock"] = with_reason("docking", "docking_reason")
    return "".join(f"{name:12} {text}\n" for name, text in lines.items())


def _words(seconds: float) -> str:
    """A time of minutes or hours."""
    hours, minutes = divmod(whole_minutes(seconds), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


@operator_command.command
def status(*, watch: bool, as_json: bool) -> int:
    """Listen and print, once or until Ctrl-C."""
    operator_command.join("status")
    board = StatusBoard()
    board.wait()
    while True:
        facts = board.facts()
        clear = "\x1b[H\x1b[J" if watch and sys.stdout.isatty() else ""
        sys.stdout.write(json.dumps(facts) + "\n" if as_json else clear + screen(facts))
        if process.lost() is not None:
            return DONE
        if watch:
            time.sleep(_PERIOD_S)
        elif any(value is not None for value in facts.values()):
            return DONE
        else:
            sys.stderr.write(
                "vsx: a ROS master runs, but no robot; start one with 'vsx explore', or set ROS_NAMESPACE\n"
            )
            return FAILED
