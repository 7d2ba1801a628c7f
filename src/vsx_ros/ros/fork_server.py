"""Starts nodes as copies of one process that has imported everything. A copy takes a hundredth of a second; a node
that is started anew imports for one to two seconds, and there are ten of them.

A copy is a child of the run, like any node: of its father in the server only the grandfather, the run, is left. So the
run reads its exit code and ends it as any other, and nothing depends on the server once the node runs. Where there is
no server, or it does not answer, nodes are started anew."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from vsx_ros.ros.environment import THREADS
from vsx_ros.runs.process import DONE, STOPPED, leave

NODES = "mobile_base", "camera", "emulator", "vslam", "move_base", "follower", "explore", "dock", "dashboard"
_ANSWER_S = 30.0  # for the server's imports; a copy takes milliseconds
_LONGEST = 1 << 17  # bytes of a request; the system's limit is above that
_TITLE_BYTES = 4096  # room for the command line of a copy
_ADOPTED = b"adopted"
_PR_SET_CHILD_SUBREAPER = 36
_ARGUMENTS = slice(45, 47)  # where the command line begins and ends: fields of /proc/self/stat after the name (proc(5))


class Request(msgspec.Struct, frozen=True):
    """A node to start: command line (its first word is the script), environment, folder."""

    command: list[str]
    environment: dict[str, str]
    folder: str


class Copy:
    """What a run needs of a started process; like subprocess.Popen."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._lock = threading.Lock()

    def poll(self) -> int | None:
        """The exit code, negative after a signal; None while the process runs."""
        with self._lock:
            if self.returncode is None:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
            return self.returncode


class ForkServer:
    """The run's side."""

    def __init__(self, *groups: str) -> None:
        """Start the server, which imports while this process goes on. groups: of kernels that it reads from disk."""
        self._lock = threading.Lock()
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        path = os.pathsep.join(part for part in sys.path if part)
        command = [sys.executable, "-m", __name__, str(theirs.fileno()), " ".join(groups), " " * _TITLE_BYTES]
        with theirs:
            self._process = subprocess.Popen(
                command,
                env={**os.environ, **THREADS, "PYTHONPATH": path},
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the server's process."""
        return self._process.pid

    def start(self, request: Request, streams: Sequence[int]) -> Copy | None:
        """Start a node as the leader of a group of its own. streams: files for its output and its errors. None: it
        could not be started here, and nothing was."""
        text = msgspec.json.encode(request)
        if Path(request.command[0]).name not in NODES or len(text) > _LONGEST:
            return None
        with self._lock, _adopting():
            pid = 0
            try:
                self._line.settimeout(_ANSWER_S)
                socket.send_fds(self._line, [text], streams)
                pid = int(self._line.recv(_LONGEST))
                self._line.recv(_LONGEST)
                os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            except (OSError, ValueError):  # the server has ended or hangs, or the copy is not our child
                self.close()
                _kill(pid)
                return None
            return Copy(pid)

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the server; nodes live on."""
        self._line.close()
        self._process.kill()
        self._process.wait()


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        if pid:
            os.kill(pid, signal.SIGKILL)


@contextlib.contextmanager
def _adopting() -> Iterator[None]:
    """Become the parent of grandchildren whose parent ends meanwhile."""
    prctl = ctypes.CDLL(None).prctl
    prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        prctl(_PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)


def serve(line: socket.socket) -> Request | None:
    """Answer requests until the run ends the server: None. In a copy it returns the request."""
    while True:
        text, streams, _, _ = socket.recv_fds(line, _LONGEST, 2)
        if not text:
            return None
        father = os.fork()
        if father == 0:
            father = os.getpid()
            if (pid := os.fork()) != 0:
                try:
                    line.send(b"%d" % pid)
                except OSError:  # nobody waits any more: the run starts the node anew
                    _kill(pid)
                os._exit(0)
            while os.getppid() == father:  # its end would be told as that of the run
                time.sleep(0.001)
            line.close()
            for number, stream in enumerate(streams, start=1):
                os.dup2(stream, number)
                os.close(stream)
            return msgspec.json.decode(text, type=Request)
        for stream in streams:
            os.close(stream)
        os.waitpid(father, 0)
        with contextlib.suppress(OSError):  # the run has given up; its end comes next
            line.send(_ADOPTED)


def become(request: Request) -> None:
    """Run the node of a request in this copy."""
    import rospy

    os.setsid()
    with contextlib.suppress(OSError):  # as on a full disk
        os.makedirs(request.folder, exist_ok=True)
        os.chdir(request.folder)
    os.environ.clear()
    os.environ.update(request.environment)
    sys.argv[:] = request.command
    _set_title("\0".join([sys.executable, *request.command]).encode())
    rospy.names.reload_mappings(sys.argv)  # it has read them when it was imported
    try:
        importlib.import_module(_module(Path(request.command[0]).name)).main()
    except KeyboardInterrupt:  # before the node was there to answer it
        leave(STOPPED)
    leave(DONE)


def _set_title(title: bytes) -> None:
    """Write what ps(1) shows over the words that this process was started with."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    start, end = map(int, fields[_ARGUMENTS])
    ctypes.memmove(start, title[: end - start - 1].ljust(end - start, b"\0"), end - start)


def _module(node: str) -> str:
    return f"vsx_ros.ros.nodes.{node}"


def main() -> None:
    """The server: import, then serve. Only the main thread may live: a copy has no other."""
    line = socket.socket(fileno=int(sys.argv[1]))
    for node in NODES:
        importlib.import_module(_module(node))
    if groups := sys.argv[2].split():
        importlib.import_module("vsx_ros.kernels.warmup").warm_up(*groups)
    gc.collect()
    gc.freeze()  # so that the copies share the memory
    if threading.active_count() > 1 or len(os.listdir("/proc/self/task")) > 1:
        sys.exit("the fork server has threads, which a copy would lack")
    request = serve(line)
    if request is not None:
        become(request)


if __name__ == "__main__":
    main()
