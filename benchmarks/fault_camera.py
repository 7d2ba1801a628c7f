"""How long an exploring robot's wheels turn after its camera fails, measured at the emulator's end of the base's wire.

python benchmarks/fault_camera.py [--repetitions 5] [--faults off stuck ...]
                                  [--out benchmarks/results/fault_camera.jsonl]

The real nodes explore an office; a faulty cable lies between the emulated Kinect and its real driver. Each repetition
waits until the robot maps, tracks and drives, starts the fault, watches the wheels for four seconds, and repairs the
cable. A row is one repetition: when the wheels first stood for the fault's sake (``turned_s``; -1: never), why they
stood before that for another reason (``others``: an arrival, another goal, a turn on the way), how long they turned in
all of the four seconds (``moved_s``), the follower's report of that stop and the other ones a moment after it, and what
the robot says and does at the end (``later``). benchmarks/tables.py makes the table from the rows.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import queue
import re
import socket
import threading
import time
from collections import namedtuple
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from exploring_robot import ExploringRobot, new_stack

from vsx_hw.errors import DeviceError
from vsx_hw.kinect import socket_transport as wire
from vsx_hw.kinect.protocol import FLAG_START, HEADER_BYTES

FAULTS = ("unplugged", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
Failing = namedtuple("Failing", "fault repetition")
WATCH_S, SETTLED_S = 4.0, 1.0
NEAR_S, THEN_S = 0.15, 0.3
"""NEAR_S: within so long of a stop the follower says why. THEN_S: so long after it the others' reports are kept."""
SLOW, DELAY_S, ON_S, OFF_S = 8, 1.0, 0.4, 0.6
"""slow: one image in so many; delay [s]; seconds with and without images."""


class FaultyCable:
    """A cable between the driver, which opens ``path``, and the emulated Kinect at ``camera``; ``fault`` is its current
    fault."""

    def __init__(self, path: str, camera: str) -> None:
        self.fault, self.since_s = "", 0.0
        self._camera = camera
        self._rng = np.random.default_rng(0)
        self._frame = self._row = 0
        self._picture: dict[int, bytes] = {}
        self._ends: list[socket.socket] = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(path)
        self._listener.listen(1)
        threading.Thread(target=self._accept, daemon=True).start()

    @classmethod
    def below(cls, stack: Any) -> FaultyCable:
        """A cable between camera and driver of a stack that is not started yet."""
        node = stack.nodes["camera"]
        camera = str(node.params["device"]).partition(":")[2]
        cable = cls(camera + "-cable", camera)
        Path(camera + "-cable.yaml").symlink_to(camera + ".yaml")
        stack.nodes["camera"] = node._replace(params={**node.params, "device": f"emulator:{camera}-cable"})
        return cable

    def inject(self, fault: str) -> None:
        """Start this fault now; an empty name repairs the cable."""
        self.fault, self.since_s = fault, time.monotonic()
        if fault == "unplugged":
            for end in self._ends:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while True:
            driver, _ = self._listener.accept()
            camera = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                if self.fault == "unplugged":
                    raise OSError("unplugged")
                camera.connect(self._camera)
            except OSError:
                driver.close()
                continue
            self._ends = [driver, camera]
            late: queue.Queue[tuple[float, bytes, bytes]] = queue.Queue()
            for work in ((self._to_camera, driver, camera), (self._from_camera, camera, late), (_send, late, driver)):
                threading.Thread(target=work[0], args=work[1:], daemon=True).start()

    @staticmethod
    def _to_camera(driver: socket.socket, camera: socket.socket) -> None:
        with contextlib.suppress(DeviceError):
            while True:
                wire.send(camera, *wire.receive(driver))
        camera.close()

    def _from_camera(self, camera: socket.socket, late: queue.Queue[tuple[float, bytes, bytes]]) -> None:
        with contextlib.suppress(DeviceError):
            while True:
                kind, body = wire.receive(camera)
                if kind == wire.PACKETS:
                    body = self._spoil(body)
                if body or kind != wire.PACKETS:
                    delay_s = DELAY_S if self.fault == "delayed" and kind == wire.PACKETS else 0.0
                    late.put((time.monotonic() + delay_s, kind, body))
        late.put((0.0, b"", b""))

    def _spoil(self, body: bytes) -> bytes:
        """The packets after this fault; empty if they are lost."""
        start_ns, packets = wire.decode_packets(body)
        since_s = time.monotonic() - self.since_s
        for k, packet in enumerate(packets):
            if packet[3] == FLAG_START:
                self._frame, self._row = self._frame + 1, 0
            header, data = packet[:HEADER_BYTES], packet[HEADER_BYTES:]
            if self.fault == "stuck":
                data = self._picture.get(self._row, data)
            elif self.fault == "garbage":
                data = self._rng.bytes(len(data))
            elif self.fault == "wrong":
                data = bytes(len(data))
            else:
                self._picture[self._row] = data
            packets[k] = header + data
            self._row += 1
        silent = (
            self.fault == "off"
            or (self.fault == "slow" and self._frame % SLOW)
            or (self.fault == "intermittent" and since_s % (ON_S + OFF_S) < OFF_S)
        )
        return b"" if silent else wire.encode_packets(start_ns, packets)


def _send(late: queue.Queue[tuple[float, bytes, bytes]], driver: socket.socket) -> None:
    with contextlib.suppress(DeviceError):
        while True:
            when_s, kind, body = late.get()
            if not kind:
                break
            time.sleep(max(0.0, when_s - time.monotonic()))
            wire.send(driver, kind, body)
    driver.close()


def stack_with_cable(folder: Path) -> Any:
    stack = new_stack(folder)
    stack.cable = FaultyCable.below(stack)
    return stack


class Report(NamedTuple):
    """What ``who`` ("slam", "follower" or "mission") said at this time [s, monotonic]."""

    at_s: float
    who: str
    words: str


def said(reports: Sequence[Report], who: str, at_s: float) -> str:
    """The last words of these until then."""
    return next((report.words for report in reversed(reports) if report.who == who and report.at_s <= at_s), "")


def is_reaction(follower: str, slam: str, mission: str) -> bool:
    """Whether the wheels stand because images, pose or tracking are missing; not for an arrival or another goal."""
    status, _, reason = follower.partition(" ")
    if status == "arrived" or reason.startswith("waiting: "):  # for what hides the way
        return False
    if re.search(r"image|vslam|pose|tracking", reason):
        return True
    return status == "stopped" and not (slam.startswith("TRACKING") and mission.startswith("mapping"))


def why(reports: Sequence[Report], stop_s: float) -> str:
    """What the follower says of a stop: of its words near it the first that are not of following."""
    near = [r.words for r in reports if r.who == "follower" and abs(r.at_s - stop_s) < NEAR_S]
    return next((words for words in near if not words.startswith("following")), said(reports, "follower", stop_s))


def judged(changes: Sequence[tuple[float, bool]], end_s: float, reports: Sequence[Report]) -> dict[str, object]:
    """A row, without the robot's last reports. changes: whether the wheels turned from this time on [s, monotonic], of
    which the first is the beginning of the fault."""
    begin_s, turned_s, others, words = changes[0][0], -1.0, [], ""
    for stop_s in [at_s for at_s, turn in changes[1:] if not turn]:
        words = why(reports, stop_s)
        if is_reaction(words, *(said(reports, who, stop_s + NEAR_S) for who in ("slam", "mission"))):
            turned_s = max(0.0, stop_s - begin_s)
            break
        others.append(words)
    ends = [at_s for at_s, _ in changes[1:]] + [end_s]
    moved_s = sum(max(0.0, after_s - at_s) for (at_s, turn), after_s in zip(changes, ends) if turn)
    then_s = begin_s + turned_s + THEN_S if turned_s >= 0.0 else end_s
    told = {who: said(reports, who, then_s) for who in ("slam", "follower", "mission")}
    told["follower"] = words if turned_s >= 0.0 else told["follower"]
    return {"turned_s": round(turned_s, 3), "moved_s": round(moved_s, 3), "others": others, **told}


class Ear:
    """The robot's reports. Create it once a stack is running."""

    def __init__(self, stack: Any) -> None:
        import rospy
        from diagnostic_msgs.msg import DiagnosticStatus
        from std_msgs.msg import String

        from vsx_ros.ros import operator_command, topics

        self._stack = stack
        self._reports: list[Report] = []
        operator_command.join("ear")
        rospy.Subscriber(f"/{topics.SLAM_STATE}", DiagnosticStatus, self._on_slam)
        rospy.Subscriber(f"/{topics.FOLLOWER_STATUS}", String, self._on_follower)
        rospy.Subscriber(f"/{topics.EXPLORE_STATUS}", String, self._on_mission)

    def _hear(self, who: str, words: str) -> None:
        self._reports.append(Report(time.monotonic(), who, words))

    def _on_slam(self, msg: object) -> None:
        self._hear("slam", f"{msg.name}: {msg.message}" if msg.message else msg.name)

    def _on_follower(self, msg: object) -> None:
        status = json.loads(msg.data)
        self._hear("follower", f"{status['status']} {status['reason']}".strip())

    def _on_mission(self, msg: object) -> None:
        status = json.loads(msg.data)
        self._hear("mission", f"{status['state']}: {status['reason']}")

    def _now(self, who: str) -> str:
        return said(self._reports, who, time.monotonic())

    def _settled(self) -> bool:
        """Whether for a second the robot maps, tracks and drives, as before any fault."""
        end_s = time.monotonic() + SETTLED_S
        while self._now("mission").startswith("mapping") and self._now("slam").startswith("TRACKING"):
            if not self._stack.plant.moving:
                return False
            if time.monotonic() > end_s:
                return True
            time.sleep(0.02)
        return False

    def trial(self, task: Failing) -> dict[str, object] | None:
        """One row; None if the robot is not well, or does not drive, when the fault should begin."""
        self._reports = [Report(0.0, who, self._now(who)) for who in ("slam", "follower", "mission")]
        if not self._settled():
            return None
        plant, cable, begin_s = self._stack.plant, self._stack.cable, time.monotonic()
        cable.inject(task.fault)
        changes = [(begin_s, True)]
        while time.monotonic() - begin_s < WATCH_S:
            if (moving := plant.moving) != changes[-1][1]:
                changes.append((plant.started_s if moving else plant.stopped_s, moving))
            time.sleep(0.005)
        later = f"{'driving' if plant.moving else 'standing'}; {self._now('slam')}; {self._now('mission')}"
        cable.inject("")
        return {**judged(changes, begin_s + WATCH_S, self._reports), "later": later}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--faults", nargs="+", default=list(FAULTS), choices=FAULTS)
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/fault_camera.jsonl")
    args = parser.parse_args()
    tasks = list(map(Failing._make, product(args.faults, range(args.repetitions))))
    ExploringRobot(lambda stack: Ear(stack).trial, stack_with_cable).campaign("fault_camera", tasks, args.out)


if __name__ == "__main__":
    main()
