"""Watchdogs of a base that is unplugged, plugged in again or replaced by another device."""

import contextlib
import os
import signal
import termios
import time
from pathlib import Path

import pytest
from hw_watched import STOP, another_device
from waiting import wait_for

from vsx_hw.watchdog import HALTS, TURNING


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
