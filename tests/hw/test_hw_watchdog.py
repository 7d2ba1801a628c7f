"""The wheels stop although the driver was killed or hangs."""

import contextlib
import math
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from hw_plant import FreeWheels
from hw_watched import STOP
from waiting import PATIENCE_S, wait_for

from vsx_hw.bases import base_emulator
from vsx_hw.errors import DeviceError
from vsx_hw.kobuki.protocol import BAUD, WHEEL_BASE_M
from vsx_hw.transport import SerialTransport
from vsx_hw.watchdog import STANDING, TURNING, Watchdogs, take_over


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
