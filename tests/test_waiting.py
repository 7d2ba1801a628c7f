"""A process that is stopped is one of a machine that runs no thread: a wait with a limit must see all of it."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from waiting import Lateness

STOPPED_S = 0.6

WAITER = """
import sys, time
import pytest
from waiting import wait_for
until_s, within_s = map(float, sys.argv[1:])
began_s = time.monotonic()
said = []
def is_over():
    if not said:
        said.append(print("waiting", flush=True))
    return time.monotonic() > began_s + until_s
wait_for(is_over, "the time", within_s=within_s)
"""


def complaint(until_s: float, within_s: float) -> str:
    """What a process says that waits until then and is stopped meanwhile."""
    command = [sys.executable, "-c", WAITER, str(until_s), str(within_s)]
    environment = {"PYTHONPATH": str(Path(__file__).parent)}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as waiter:
        assert waiter.stdout is not None
        assert waiter.stdout.readline() == "waiting\n"
        waiter.send_signal(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        waiter.send_signal(signal.SIGCONT)
        return waiter.communicate()[1]


def test_a_stop_of_the_process_is_not_held_against_the_program() -> None:
    assert [complaint(0.2, 0.4) for _ in range(5)] == [""] * 5


def test_only_what_was_late_in_the_time_asked_for_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lateness, "_measure", lambda _: None)
    lateness, now_s = Lateness(), time.monotonic()
    lateness._due_s, lateness._woken_s = [now_s - 5.0, now_s - 1.0], [now_s - 2.0]
    assert lateness.between(now_s - 9.0, now_s) == pytest.approx(4.0)
    assert lateness.between(now_s - 4.0, now_s - 3.0) == pytest.approx(1.0)
    assert lateness.between(now_s - 1.9, now_s - 1.1) == 0.0
    assert lateness.since(now_s - 0.5) >= 0.5  # a delay that lasts
