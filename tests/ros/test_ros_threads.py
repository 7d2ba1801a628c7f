"""What nodes do alike, without a master: threads that fail, logging that must not, diagnostics."""

import logging
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rospy
import rospy.core
from waiting import PATIENCE_S

from vsx_hw import base_driver
from vsx_hw.errors import DeviceError
from vsx_ros.errors import InputError
from vsx_ros.ros import headers, logs, threads
from vsx_ros.ros.logs import ERROR, OK, WARN, DiagnosticArray, Diagnostics
from vsx_ros.ros.nodes import mobile_base


def refuse() -> None:
    raise rospy.ROSException("publish() to a closed topic")


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    reasons: list[str] = []
    monkeypatch.setattr(rospy, "signal_shutdown", reasons.append)
    return reasons


@pytest.mark.parametrize("ending", [True, False])
def test_topics_that_close_at_the_end_are_no_failure(
    ending: bool, told: list[str], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(rospy.core, "is_shutdown_requested", lambda: ending)
    with caplog.at_level(logging.ERROR, threads.__name__):
        threads.worker("mission", refuse).join(PATIENCE_S)
    assert told == ([] if ending else ["thread 'mission' failed: publish() to a closed topic"])
    assert bool(caplog.records) != ending


def unplugged() -> None:
    raise DeviceError("no base")


@pytest.mark.parametrize(
    ("loop", "reason", "code"),
    [(lambda: [][0], "list index out of range", 1), (unplugged, "no base", 2), (lambda: None, "", 0)],
)
def test_a_thread_that_fails_ends_the_node_with_an_exit_code(
    loop: Callable[[], None], reason: str, code: int, told: list[str], monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    monkeypatch.setattr(threads, "_failures", [])
    monkeypatch.setattr(rospy, "logfatal", lambda *_: None)
    threads.worker("sums", loop).join(PATIENCE_S)
    assert told == ([f"thread 'sums' failed: {reason}"] if reason else [])
    assert threads.exit_code() == code


@pytest.mark.parametrize("ros_time", [None, rospy.Time(), rospy.Time(1)], ids=["wall", "not begun", "stands"])
def test_what_is_done_every_so_often_goes_on_while_ros_time_stands_and_ends_with_the_node(
    ros_time: rospy.Time | None, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[int] = []
    monkeypatch.setattr(rospy.core, "is_shutdown_requested", lambda: len(steps) >= 3)
    monkeypatch.setattr(rospy.rostime, "_rostime_current", ros_time)
    rospy.rostime.set_rostime_initialized(True)
    threads.every(0.001, "steps", lambda: steps.append(1)).join(PATIENCE_S)
    assert len(steps) == 3
    assert told == []


@pytest.mark.changes_rospy
def test_what_is_due_now_and_then_is_due_again_while_ros_time_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(logs.time, "monotonic", lambda: now_s)
    assert logs.due("this", 10.0)
    assert logs.due("that", 10.0)
    assert not logs.due("this", 10.0)
    now_s += 10.5
    assert logs.due("this", 10.0)


def test_no_node_waits_for_ros_time() -> None:
    """It stands where a clock was promised that nobody sets; stamps are made of it, patience is not."""
    waits = re.compile(r"rospy\.(Rate|sleep|Timer)\b|_throttle\(|\.wait_for_(server|result|action)")
    files = sorted(Path(threads.__file__).parent.rglob("*.py"))
    assert [str(file) for file in files if waits.search(file.read_text(encoding="utf-8"))] == []


def test_nothing_outside_of_the_nodes_waits_without_end() -> None:
    """Of examples, scripts and experiments: neither for a server or service nor for another program."""
    root = Path(__file__).parents[2]
    rooms = root / "examples", root / "scripts", root / "src/vsx_ros/experiments", root / "src/vsx_ros/cli"
    files = sorted(file for room in rooms for file in room.rglob("*") if file.is_file() and file.suffix in ("", ".py"))
    calls = re.compile(r"(wait_for_\w+|subprocess\.(?:run|check_\w+))\(((?:[^()]|\((?:[^()]|\([^()]*\))*\))*)\)")
    limits = re.compile(r"timeout|_S\b|_s\b|Duration\(")
    texts = {str(file): file.read_text(encoding="utf-8") for file in files}
    found = [(file, *call) for file, text in texts.items() for call in calls.findall(text)]
    assert found
    assert [call for call in found if not limits.search(call[2])] == []


NODE = """
import logging, logging.config, os, sys
import rospy
from vsx_ros.ros import headers, logs, threads
from vsx_ros.ros.logs import DiagnosticArray, Diagnostics, ERROR, OK, WARN

logs.quiet_failures()
os.environ["ROS_LOG_FILENAME"] = sys.argv[1]
logging.config.fileConfig(os.environ["ROS_PYTHON_LOG_CONFIG_FILE"], disable_existing_loggers=False)
rospy.logerr("it is said all the same")
rospy.logwarn("this, too")
print("goes on")
"""


@pytest.mark.parametrize("log", ["/dev/full", "/no/such/folder/node.log"])
def test_a_node_whose_words_nobody_takes_goes_on(log: str) -> None:
    command = [sys.executable, "-c", NODE, log]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, env=paths, stdout=subprocess.PIPE, stderr=full, text=True, check=True)
    assert done.stdout == "goes on\n"


def test_a_line_that_is_logged_asks_no_master(monkeypatch: pytest.MonkeyPatch) -> None:
    """rospy would, with every line."""
    asked: list[str] = []
    monkeypatch.setattr(rospy.impl.paramserver, "_param_server_cache", None)
    monkeypatch.setattr(rospy.client, "_init_param_server", lambda: None)
    monkeypatch.setattr(rospy.client, "_param_server", rospy.msproxy.MasterProxy("http://127.0.0.1:1"))
    monkeypatch.setattr(rospy, "get_param", lambda name, default: asked.append(name) or default)
    logs.log_without_master()
    assert rospy.get_param_cached(asked[0], "asked the master") is False


def test_a_reading_from_the_future_is_refused_and_one_from_a_clock_a_little_ahead_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(headers, "now_ns", lambda: 5_000_000_000)
    for stamp_ns in (0, 5_000_000_000, 6_000_000_000):
        headers.refuse_future(stamp_ns)
    with pytest.raises(InputError, match=r"stamp 1\.5 s ahead"):
        headers.refuse_future(6_500_000_000)


def test_an_error_is_told_at_once_and_the_rest_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays: list[list[tuple[str, int]]] = []
    monkeypatch.setattr(threads, "every", lambda *_: None)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1, 0))
    monkeypatch.setattr(rospy, "get_name", lambda: "/mobile_base")

    class Heard:
        def __init__(self, *_: object, **__: object) -> None:
            pass

        def publish(self, array: DiagnosticArray) -> None:
            arrays.append([(status.name, status.level) for status in array.status])

    monkeypatch.setattr(rospy, "Publisher", Heard)
    diagnostics = Diagnostics("a base")
    for level in (OK, WARN, OK, ERROR, ERROR, OK):
        diagnostics.set("link", level, "words")
        diagnostics.set("battery", OK, "words")
    assert arrays == [[("mobile_base: link", ERROR)]]
    assert base_driver.TOLD_NS * 1e-9 + mobile_base.LINK_PERIOD_S < 1.0, "a silent base is told within a second"


HEARS_MAPS = """
import ctypes, sys
import numpy as np
from vsx_ros.runs import memory

class Heap(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in "arena ordblks smblks hblks hblkhd a b c d e".split()]

mallinfo = ctypes.CDLL(None).mallinfo2
mallinfo.restype = Heap
if sys.argv[1] == "returns":
    memory.return_freed_memory()
MAP = 20_000_000  # larger than any gap that imports leave in the heap, smaller than what never goes on it
np.ones(MAP, np.uint8)
before = mallinfo().hblks
newer_map = np.ones(MAP, np.uint8)
print(mallinfo().hblks - before)
"""


BETWEEN_SMALL_BLOCKS = """
from pathlib import Path
import numpy as np
from vsx_ros.runs import memory

def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6

memory.return_freed_memory()
frames = [np.ones(60_000, np.uint8) for _ in range(2000)]
full_mb = resident_mb()
keyframes = frames[::20]
del frames
memory.trim()
print(full_mb - resident_mb())
"""


def output_of(program: str, *arguments: str) -> str:
    others = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}  # dask sets some
    paths = {**others, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.check_output([sys.executable, "-c", program, *arguments], env=paths, text=True)


@pytest.mark.parametrize(("how", "maps_beside_the_heap"), [("keeps", 0), ("returns", 1)])
def test_a_map_that_was_replaced_goes_back_to_the_system(how: str, maps_beside_the_heap: int) -> None:
    """By itself malloc puts the second large array on the heap, where smaller ones keep its memory."""
    assert int(output_of(HEARS_MAPS, how)) == maps_beside_the_heap


def test_what_frames_freed_between_keyframes_goes_back_to_the_system() -> None:
    assert float(output_of(BETWEEN_SMALL_BLOCKS)) > 0.8 * 0.95 * 2000 * 0.06
