"""The wheels stop although the driver was killed or hangs."""

import contextlib
import math
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from pathlib import Path

import pytest
from hw_plant import FreeWheels
from waiting import PATIENCE_S, wait_for

from vsx_hw.bases import BASES, base_emulator
from vsx_hw.errors import DeviceError
from vsx_hw.kobuki.protocol import BAUD, WHEEL_BASE_M
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import HALTS, RELEASED, STANDING, TURNING, Watchdogs, take_over, watch

STOP = BASES["kobuki"].stop_bytes()

DRIVER = """
import sys, time
from vsx_hw.bases import BASES, base_driver
from vsx_hw.watchdog import Watchdogs
watchdogs = Watchdogs(sys.argv[1], 115200, BASES["kobuki"].stop_bytes())
driver = base_driver("kobuki", sys.argv[1], lambda reading: driver.drive(0.2, 0.0), on_command=watchdogs.beat)
driver.start()
time.sleep(60)
"""


@pytest.fixture
def driven(tmp_path):
    """Wheels that a driver in another process lets turn; this process; their emulator."""
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with base_emulator("kobuki", plant, port) as emulator:
        process = subprocess.Popen([sys.executable, "-c", DRIVER, port], env=environment)
        try:
            wait_for(lambda: plant.speeds[0] > 0.1, "it takes long to start on a busy machine")
            time.sleep(0.5)
            wait_for(lambda: plant.speeds[0] > 0.1, "it to drive on")
            yield plant, process, emulator
        finally:
            process.kill()
            process.wait()


def test_a_killed_driver_leaves_the_wheels_stopped(driven):
    plant, process, _ = driven
    process.kill()
    process.wait()
    wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)


def test_a_hanging_driver_leaves_the_wheels_stopped_and_may_go_on_later(driven):
    plant, process, _ = driven
    process.send_signal(signal.SIGSTOP)
    wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)
    time.sleep(0.3)
    assert plant.speeds == (0.0, 0.0)
    process.send_signal(signal.SIGCONT)
    wait_for(lambda: plant.speeds[0] > 0.1)


@pytest.mark.parametrize("driver_end", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("watchdog_end", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("which", [0, 1])
def test_whoever_is_killed_or_hangs_beside_the_driver_the_last_one_stops_the_wheels(
    driven, driver_end, watchdog_end, which
):
    plant, process, _ = driven
    watchdogs = sorted(
        int(pid)
        for children in Path(f"/proc/{process.pid}/task").glob("*/children")
        for pid in children.read_text().split()
    )
    os.kill(process.pid, signal.SIGSTOP)  # whoever goes first, the driver has no time to notice
    try:
        os.kill(watchdogs[which], watchdog_end)
        assert plant.speeds[0] > 0.1
        began_s = time.monotonic()
        os.kill(process.pid, driver_end)
        wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)
        print(f"the wheels turned {time.monotonic() - began_s:.3f} s")
        time.sleep(0.3)
        assert plant.speeds == (0.0, 0.0)
    finally:
        for pid in watchdogs:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


def test_a_watchdog_that_cannot_be_killed_is_replaced_and_left(tmp_path, monkeypatch):
    (first, second), replaced = Watchdogs(str(tmp_path / "none"), BAUD, STOP)._both, threading.Event()
    old = first._process
    try:
        wait_for(lambda: first.answers)
        old.send_signal(signal.SIGSTOP)
        first.tell(b"s")
        monkeypatch.setattr(old, "kill", lambda: None)
        first._started_s = -math.inf
        wait_for(lambda: not first.answers)
        threading.Thread(target=lambda: (first.revive(), replaced.set()), daemon=True).start()
        assert replaced.wait(PATIENCE_S), "the driver waits for it"
        wait_for(lambda: first.answers)
    finally:
        for process in (old, first._process, second._process):
            os.kill(process.pid, signal.SIGKILL)


def test_released_watchdogs_do_not_touch_the_port(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    with base_emulator("kobuki", plant, port):
        watchdogs = Watchdogs(port, BAUD, STOP)
        watchdogs.beat(True)
        watchdogs.release()
        time.sleep(0.05)
        assert plant.speeds == (0.1, 0.1)
        assert take_over(port, BAUD, STOP.farewell)
        wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)


def test_a_port_that_takes_nothing_at_first_is_tried_again(tmp_path, monkeypatch):
    """The failed try must not keep the port locked against the next one."""
    port, written = str(tmp_path / "ttyKOBUKI"), SerialTransport.write
    failures = iter([DeviceError("no room for more bytes"), DeviceError("again")])

    def write(transport, data):
        failure = next(failures, None)
        if failure is not None:
            kept.append(transport)  # as a traceback does
            raise failure
        written(transport, data)

    kept, plant = [], FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    monkeypatch.setattr(SerialTransport, "write", write)
    with base_emulator("kobuki", plant, port):
        assert take_over(port, BAUD, STOP.farewell)
        wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)


def test_a_driver_that_stands_is_left_alone_by_its_watchdogs(tmp_path):
    port = str(tmp_path / "ttyKOBUKI")
    plant = FreeWheels(WHEEL_BASE_M)
    plant.speeds = (0.1, 0.1)
    with base_emulator("kobuki", plant, port):
        watchdogs = Watchdogs(port, BAUD, STOP)
        watchdogs.beat(False)
        time.sleep(0.6)
        assert plant.speeds == (0.1, 0.1)
        watchdogs.beat(True)
        wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)
        watchdogs.release()


@contextlib.contextmanager
def another_device():
    """A terminal; yields a function that gives it a name, and one that returns all bytes written to it so far."""
    ours, its = pty.openpty()
    tty.setraw(its)
    os.set_blocking(ours, False)
    heard = bytearray()

    def all_bytes():
        with contextlib.suppress(BlockingIOError):
            heard.extend(os.read(ours, 4096))
        return bytes(heard)

    try:
        yield lambda name: os.symlink(os.ttyname(its), name), all_bytes
    finally:
        os.close(ours)
        os.close(its)


class Watched:
    """An emulated base and one watchdog of it, in a thread: nothing depends on how busy the machine is.

    hung_after_s: holds from the next beat on. heard: all that came to the base."""

    def __init__(self, port, monkeypatch):
        self.port, self.plant, self.asleep_ns, self.heard = port, FreeWheels(WHEEL_BASE_M), 7, bytearray()
        self.hung_after_s = 2 * PATIENCE_S
        monkeypatch.setattr("vsx_hw.watchdog.select", self)
        self.emulator = base_emulator("kobuki", self.plant, port)
        receive = self.emulator._board.receive
        monkeypatch.setattr(
            self.emulator._board, "receive", lambda data, now: (self.heard.extend(data), receive(data, now))
        )
        (self._beats, self._beat), (self._answers, self._answer) = os.pipe(), os.pipe()
        arguments = (port, BAUD, STOP, self._beats, self._answer, lambda: self.asleep_ns)
        self._thread = threading.Thread(target=watch, args=arguments, daemon=True)

    def __enter__(self):
        self.emulator.start()
        self._held = os.open(self.port, os.O_RDWR | os.O_NOCTTY)  # by the driver
        self.plant.speeds = (0.1, 0.1)
        self._thread.start()
        assert os.read(self._answers, 1), "it works"
        return self

    def __exit__(self, *_):
        self.say(RELEASED)
        os.close(self._beat)
        self._thread.join(PATIENCE_S)
        self.emulator.close()
        for descriptor in (self._beats, self._answers, self._answer, self._held):
            os.close(descriptor)

    def say(self, word):
        """A beat, and its answer."""
        os.write(self._beat, word)
        assert os.read(self._answers, 1)

    def select(self, read, write, other, _):
        """See ``select.select``."""
        return select.select(read, write, other, self.hung_after_s)


@pytest.fixture
def watched(tmp_path, monkeypatch):
    with Watched(str(tmp_path / "ttyKOBUKI"), monkeypatch) as made:
        yield made


def silence_after(watched):
    """What another device hears that takes the name of the port."""
    with another_device() as (take, heard):
        watched.emulator.unplug()
        take(watched.port)
        time.sleep(0.5)
        return heard()


def test_the_halt_goes_to_no_other_device_that_takes_the_name_of_the_port(watched):
    watched.hung_after_s = 0.05
    watched.say(TURNING)
    wait_for(lambda: watched.heard.count(STOP.halt) >= HALTS)
    assert watched.plant.speeds == (0.0, 0.0)
    assert silence_after(watched) == b""


def test_a_base_plugged_in_again_that_heard_no_halt_is_stopped_twice_and_no_more(watched):
    """Who has the name then cannot be told; the driver hangs, and the wheels may turn."""
    watched.say(TURNING)
    watched.emulator.unplug()
    watched.hung_after_s = 0.05
    watched.say(TURNING)
    time.sleep(0.3)
    assert watched.plant.speeds == (0.1, 0.1)
    watched.emulator.replug()
    wait_for(lambda: watched.heard.count(STOP.halt) == HALTS)
    assert watched.plant.speeds == (0.0, 0.0)
    assert termios.tcgetattr(watched.emulator._master)[5] == termios.B115200, "a new terminal has another baud rate"
    time.sleep(0.3)
    assert watched.heard.count(STOP.halt) == HALTS
    assert silence_after(watched) == b""


def states(pid):
    """The state, as a letter, of each thread that a process still has (man 5 proc)."""
    told = set()
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with contextlib.suppress(OSError):  # it has ended
            told.add((task / "stat").read_text().rpartition(") ")[2][0])
    return told


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_base_replugged_while_its_driver_is_dead_or_hangs_is_stopped(driven, end):
    plant, process, emulator = driven
    process.send_signal(signal.SIGSTOP)
    wait_for(lambda: states(process.pid) <= {"T", "Z"}, "it to see nothing of that")
    emulator.unplug()
    process.send_signal(end)
    emulator.replug()
    wait_for(lambda: plant.speeds == (0.0, 0.0), within_s=5.0)
    time.sleep(0.3)
    assert plant.speeds == (0.0, 0.0)


def test_no_watchdog_writes_to_who_takes_the_name_of_a_port_lost_while_the_wheels_turned(driven, tmp_path):
    """The driver does when it looks for its base: here it hangs before."""
    _, process, emulator = driven
    port = tmp_path / "ttyKOBUKI"
    terminal = os.path.realpath(port)
    (held,) = [fd for fd in Path(f"/proc/{process.pid}/fd").iterdir() if os.readlink(fd) == terminal]
    with another_device() as (take, heard):
        emulator.unplug()
        wait_for(lambda: not held.is_symlink(), "the driver to let the port go")
        process.send_signal(signal.SIGSTOP)
        take(port)
        time.sleep(1.5)
        assert heard() == b""


@pytest.mark.parametrize(("word", "speeds"), [(TURNING, (0.0, 0.0)), (STANDING, (0.1, 0.1))])
def test_a_watchdog_that_wakes_from_a_sleep_of_the_machine_stops_turning_wheels(watched, word, speeds):
    """Driver and watchdog slept at once, so no beat is missing."""
    watched.say(word)
    watched.say(word)
    time.sleep(0.1)
    assert watched.plant.speeds == (0.1, 0.1), watched.heard.hex(" ")
    watched.asleep_ns += 10**9
    watched.say(word)
    wait_for(lambda: watched.plant.speeds == speeds, within_s=5.0)
    time.sleep(0.1)
    assert watched.plant.speeds == speeds
    watched.plant.speeds = (0.2, 0.2)
    watched.say(TURNING)
    watched.say(TURNING)
    time.sleep(0.1)
    assert watched.plant.speeds == (0.2, 0.2), "that sleep is over"


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_watchdog_that_is_killed_or_hangs_is_missed_and_replaced(tmp_path, monkeypatch, end, which):
    monkeypatch.setattr("vsx_hw.watchdog.PATIENCE_S", 0.0)
    watchdogs = Watchdogs(str(tmp_path / "nothing"), BAUD, STOP)

    def answer():
        watchdogs.beat(False)
        return watchdogs.answer

    def pids():
        return [watchdog._process.pid for watchdog in watchdogs._both]

    wait_for(answer)
    before = pids()
    watchdogs.revive()
    assert pids() == before
    hurt = watchdogs._both[which]._process
    hurt.send_signal(end)
    wait_for(lambda: not answer())
    watchdogs.revive()
    wait_for(answer)
    assert [pid in before for pid in pids()] == [which == 1, which == 0]
    assert hurt.poll() is not None
    watchdogs.release()
    last = [watchdog._process for watchdog in watchdogs._both]
    assert [process.returncode for process in last] == [0, 0]
    watchdogs.beat(False)
    watchdogs.revive()
    assert [watchdog._process for watchdog in watchdogs._both] == last, "they were let go"


def test_watchdogs_that_nobody_beats_are_well(tmp_path):
    watchdogs = Watchdogs(str(tmp_path / "nothing"), BAUD, STOP)
    wait_for(lambda: watchdogs.answer)
    time.sleep(0.4)
    assert watchdogs.answer
    watchdogs.release()


def test_watchdogs_that_do_not_start_are_none(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    watchdogs = Watchdogs(str(tmp_path / "nothing"), BAUD, STOP)
    watchdogs.beat(False)
    time.sleep(0.5)
    assert not watchdogs.answer
    watchdogs.release()
