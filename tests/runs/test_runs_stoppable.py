import signal
import subprocess
import sys

import pytest
from waiting import PATIENCE_S

from vsx_ros.cli import compiled
from vsx_ros.runs.process import SignalFlag, interruptible

INTERRUPTED_AT_EVERY_LINE = """
import signal
from vsx_ros.runs.process import SignalFlag
heard = SignalFlag(signal.SIGUSR1)

def again(frame, event, arg):
    if frame.f_code.co_filename != "<string>":
        signal.raise_signal(signal.SIGUSR1)
    return again

sys.settrace(again)
signal.raise_signal(signal.SIGUSR1)
sys.settrace(None)
print("came" if heard.came else "did not come")
"""


def test_a_signal_in_the_midst_of_the_answer_to_a_signal_does_not_hang():
    command = [sys.executable, "-c", f"import sys; sys.path[:0] = {sys.path!r}" + INTERRUPTED_AT_EVERY_LINE]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    assert done.stdout == "came\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_is_noted_and_the_second_ends_the_work(number):
    before = signal.getsignal(number)
    with interruptible() as stopped:
        signal.raise_signal(number)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is before


def test_a_run_under_nohup_outlives_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible() as stopped:
            signal.raise_signal(signal.SIGHUP)
            assert not stopped()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_live_run_under_nohup_does_so_too():
    """roslaunch installs a handler of its own in between."""
    before = [(number, signal.signal(number, signal.SIG_IGN)) for number in (signal.SIGHUP, signal.SIGTERM)]
    try:
        heard = SignalFlag(signal.SIGTERM, signal.SIGHUP)
        signal.signal(signal.SIGHUP, lambda *_: pytest.fail("the run ends"))
        heard.listen()
        signal.raise_signal(signal.SIGHUP)
        assert not heard.came
        signal.raise_signal(signal.SIGTERM)
        assert heard.came
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def test_a_compilation_under_nohup_does_so_too():
    before = [(number, signal.signal(number, signal.SIG_IGN)) for number in (signal.SIGHUP, signal.SIGTERM)]
    try:
        assert list(compiled._ending_as_by_keyboard()) == [signal.SIGTERM]
        signal.raise_signal(signal.SIGHUP)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
    finally:
        for number, handler in before:
            signal.signal(number, handler)
