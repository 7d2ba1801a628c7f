"""The sleep of the machine (suspend, a closed lid): how to keep it awake, and whether it has slept.

A base goes on with its last command while the machine sleeps. The monotonic clock stands meanwhile, so afterwards what
was said before still looks fresh."""

import logging
import os
import subprocess
import threading
import time
from collections.abc import Callable

from vsx_hw.readings import ahead_of_monotonic_ns

logger = logging.getLogger(__name__)

INHIBIT = (
    "systemd-inhibit", "--what=sleep:idle:handle-lid-switch", "--mode=block", "--who=vsx_ros", "--why=it drives a robot"
)  # fmt: skip
LEAST_NS = 20_000_000  # more than reading two clocks takes on a busy machine, less than any sleep


def asleep_ns() -> int:
    """How long the machine has slept since it was started."""
    return ahead_of_monotonic_ns(lambda: time.clock_gettime_ns(time.CLOCK_BOOTTIME))


class SleepWatch:
    """Notices that the machine has slept. clock_ns: as ``asleep_ns``."""

    def __init__(self, clock_ns: Callable[[], int] = asleep_ns) -> None:
        self._clock_ns = clock_ns
        self._known_ns = clock_ns()

    def slept_s(self) -> float:
        """How long it slept since the last call; 0 if it did not."""
        before_ns, self._known_ns = self._known_ns, self._clock_ns()
        slept_ns = self._known_ns - before_ns
        return slept_ns * 1e-9 if slept_ns >= LEAST_NS else 0.0


def keep_awake(port: str) -> None:
    """Let the machine not sleep while this process lives, also with its lid closed. Where that is not allowed, the log
    says so once, with the remedy. For the base at this port; an emulated one, at a pseudo-terminal, may sleep."""
    if not os.path.realpath(port).startswith("/dev/pts/"):
        threading.Thread(target=_keep_awake, name="keep awake", daemon=True).start()


def _keep_awake() -> None:
    """Wait for the inhibitor; it ends by itself when the pipe from this process breaks."""
    try:
        with subprocess.Popen(
            [*INHIBIT, "cat"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        ) as inhibitor:  # fmt: skip
            assert inhibitor.stderr is not None
            told = inhibitor.stderr.read().strip() or "systemd-inhibit has ended"
    except OSError as error:
        told = str(error)
    logger.warning(
        "nothing keeps this machine from sleeping while the base drives (%s); on a laptop, set HandleLidSwitch=ignore "
        "in /etc/systemd/logind.conf and switch automatic suspend off",
        told,
    )
