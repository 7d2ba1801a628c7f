"""A base that falls silent is an ERROR on /diagnostics within a second."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from lone_base import LoneBase
from waiting import PATIENCE_S, Lateness

from vsx_hw.bases import BASES

pytestmark = pytest.mark.ros

LISTENER = """
import json, sys, threading, time
import rospy
from diagnostic_msgs.msg import DiagnosticArray

rospy.init_node("listener", anonymous=True)
levels, heard = [], threading.Condition()

def on_diagnostics(array):
    for status in array.status:
        if status.name == "mobile_base: link":
            with heard:
                levels.append((time.monotonic(), status.level, status.message))
                heard.notify_all()

def wait(level, after_s):
    def words():
        return [said for said in levels if said[0] > after_s and said[1] == level]

    with heard:
        assert heard.wait_for(words, 400.0), levels[-3:]
        return words()[0]

rospy.Subscriber("/diagnostics", DiagnosticArray, on_diagnostics, queue_size=50, tcp_nodelay=True)
wait(0, 0.0)
print("connected", flush=True)
print(json.dumps(wait(2, float(sys.stdin.readline()))), flush=True)
"""


@pytest.fixture(params=list(BASES))
def base(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[LoneBase]:
    made = LoneBase(tmp_path, request.param)
    made.start("mobile_base", f"_robot_type:={request.param}", f"_port:={made.port}")
    yield made
    made.close()


def test_a_silent_base_is_an_error_within_a_second(base: LoneBase) -> None:
    command, lateness = [sys.executable, "-c", LISTENER], Lateness()
    with subprocess.Popen(
        command, env=base.processes.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as listener:
        assert listener.stdout.readline() == "connected\n", base.processes.logs()
        silent_s = time.monotonic()  # one clock for all processes of a machine
        base.emulator.paused = True
        told_s, _, words = json.loads(listener.communicate(f"{silent_s}\n", timeout=PATIENCE_S)[0])
    assert told_s - silent_s < 1.0 + lateness.between(silent_s, told_s)
    lateness.close()
    assert "no data for" in words
