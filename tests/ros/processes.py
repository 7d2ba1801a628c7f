"""Processes of a test, with a log file each, at a master that may be elsewhere."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from waiting import PATIENCE_S, wait_for

from vsx_ros.ros.environment import THREADS
from vsx_ros.ros.fork_server import Copy


class Processes:
    """``start`` and ``run`` at the master ``uri``; ``prefix`` are words before each command."""

    def __init__(self, folder: Path, uri: str, prefix: Sequence[str] = (), **environment: str) -> None:
        kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")}
        paths = os.pathsep.join(path for path in sys.path if path)
        own = {"ROS_MASTER_URI": uri, "ROS_HOME": str(folder), "ROS_LOG_DIR": str(folder), "PYTHONPATH": paths}
        self.environment = {**kept, **THREADS, **own, **environment}
        self._folder, self._prefix = folder, list(prefix)
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self, name: str, *command: str, **environment: str) -> subprocess.Popen[bytes]:
        with (self._folder / f"{name}.txt").open("ab") as log:
            process = subprocess.Popen(
                [*self._prefix, *command],
                env={**self.environment, **environment},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._processes.append(process)
        return process

    def run(self, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
        variables = {**self.environment, **environment}
        return subprocess.run(
            [*self._prefix, *command], env=variables, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )

    def vsx(self, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return self.run(sys.executable, "-m", "vsx_ros.cli.main", *words, **environment)

    def logs(self) -> str:
        files = sorted([*self._folder.glob("*.txt"), *self._folder.glob("*/log/*.log")])  # with those of runs
        return "\n".join(
            f"{file.relative_to(self._folder)}: {file.read_text(errors='replace')[-500:]}" for file in files
        )

    def wait(self, condition: Callable[[], object], what: str) -> None:
        wait_for(condition, what, self.logs, 0.1)

    def end(self) -> None:
        """Each with all that it started."""
        for process in reversed(self._processes):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
        for process in self._processes:
            try:
                process.wait(6.0)
            except subprocess.TimeoutExpired:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()


class StartedCopy:
    """A node by the fork server, as that of a run; with what these tests use of subprocess.Popen."""

    def __init__(self, copy: Copy) -> None:
        self.pid, self.poll = copy.pid, copy.poll

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def wait(self, timeout: float = PATIENCE_S) -> int:
        until_s = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > until_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(0.01)
        return code
