"""Whoever kills a run leaves no master behind on its port."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from waiting import wait_for

from vsx_ros.ros.master_guard import MasterGuard

_RUN = """
import subprocess, sys, time
from vsx_ros.ros.master_guard import MasterGuard
master = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
guard = MasterGuard([master.pid])
print(master.pid, flush=True)
time.sleep(600)
"""


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_the_master_of_a_killed_run_ends() -> None:
    with subprocess.Popen([sys.executable, "-c", _RUN], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        master = int(run.stdout.readline())
        assert alive(master)
        run.kill()
        wait_for(lambda: not alive(master), "the master to end")


def test_the_guard_of_a_run_that_ends_in_order_does_nothing() -> None:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) as master:
        MasterGuard([master.pid]).close()
        assert master.poll() is None
        master.kill()
