import subprocess
import sys

from waiting import PATIENCE_S

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
