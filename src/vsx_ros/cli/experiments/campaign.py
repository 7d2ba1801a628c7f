"""Many tasks, one after the other or on many machines; every result is written down as it comes, so that a campaign
can be interrupted and continued."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

from vsx_ros import __version__
from vsx_ros.errors import ConfigError, InputError, VsxError, disk_trouble, reason_of
from vsx_ros.limits import LOG_BYTES, file_bytes, json_tree

Result = dict[str, Any]
CONNECT_S = 10.0


class Task(Protocol):
    """What is to be done: a NamedTuple of numbers and words."""

    def _asdict(self) -> dict[str, Any]: ...


class Done(NamedTuple):
    """result: of a task. final: whether it is the task's own; a full disk, a worker without memory or without a module
    is not."""

    result: Result
    final: bool


Work = Callable[[Any], Result]


class Engine(NamedTuple):
    """Where tasks run. jobs: processes on this machine; 1 is the caller's own. scheduler: address of a dask scheduler,
    used instead."""

    jobs: int = 1
    scheduler: str | None = None


class Store:
    """results.jsonl: a line for each task that was done or cannot be, with the version that did it."""

    def __init__(self, path: Path) -> None:
        """What a killed campaign left half written at the end is dropped. Raises InputError when the file cannot be
        read or written, or is damaged before."""
        self._path = path
        self._known: dict[str, Result] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            content = file_bytes(path, LOG_BYTES) if path.exists() else b""
            *lines, torn = content.split(b"\n")
            for number, line in enumerate(lines, start=1):
                self._recall(number, line)
            if torn:
                os.truncate(path, len(content) - len(torn))
        except InputError:
            raise
        except (OSError, ValueError) as error:
            raise InputError(f"{path} cannot be used ({reason_of(error)}); choose another --out") from error

    def __contains__(self, task: Task) -> bool:
        return _key(task._asdict()) in self._known

    def __getitem__(self, task: Task) -> Result:
        return self._known[_key(task._asdict())]

    def add(self, task: Task, result: Result) -> None:
        """Append the line. Raises InputError when the disk takes no more."""
        line = json.dumps({"task": task._asdict(), "version": __version__, "result": result})
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise InputError(
                f"{self._path} cannot be written ({reason_of(error)}); free the disk, then the same command goes on"
            ) from error
        self._known[_key(task._asdict())] = result

    def _recall(self, number: int, line: bytes) -> None:
        try:
            entry = json_tree(line)
            if entry["version"] == __version__:
                self._known[_key(entry["task"])] = entry["result"]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{self._path} is damaged in line {number} ({reason_of(error)}); choose another --out, or remove it"
            ) from error


def run_campaign(tasks: Sequence[Task], work: Work, store: Store, engine: Engine) -> list[Result]:
    """Results of the tasks, in their order; those that the store knows are not done again.

    A task that fails has the result {"failed": reason}; a failure that is not the task's own is not stored, so that the
    next call tries it again. Raises ConfigError when the engine cannot be had, or is lost.
    """
    waiting = [task for task in tasks if task not in store]
    began_s, known = time.monotonic(), len(tasks) - len(waiting)
    if known:
        _say(f"{known} of {len(tasks)} are known already")
    again: dict[Task, Result] = {}
    for done, (task, (result, final)) in enumerate(_results(waiting, work, engine), start=1):
        if final:
            store.add(task, result)
        else:
            again[task] = result
        left_s = (time.monotonic() - began_s) / done * (len(waiting) - done)
        told = f"failed: {result['failed']}" if "failed" in result else "done"
        words = " ".join(str(value) for value in task._asdict().values() if value is not None)
        _say(f"{known + done} of {len(tasks)}, about {left_s / 60:.0f} min left: {words}: {told}")
    if again:
        _say(f"{len(again)} of the failures may pass; the same command tries them again")
    return [again[task] if task in again else store[task] for task in tasks]


def guarded(work: Work, task: Task) -> Done:
    """The result of a task, or why there is none: one bad world must not end a campaign of hundreds."""
    try:
        return Done(work(task), True)
    except VsxError as error:
        return Done({"failed": str(error)}, True)
    except Exception as error:
        trouble = disk_trouble(error) if isinstance(error, OSError) else ""
        reason = trouble or f"internal error, please report it: {type(error).__name__}: {error}"
        return Done({"failed": reason}, False)


def _results(tasks: Sequence[Task], work: Work, engine: Engine) -> Iterator[tuple[Task, Done]]:
    if engine.jobs == 1 and engine.scheduler is None:
        return ((task, guarded(work, task)) for task in tasks)
    return _distributed(tasks, work, engine)


def _distributed(tasks: Sequence[Task], work: Work, engine: Engine) -> Iterator[tuple[Task, Done]]:
    """In the order in which they are done."""
    try:
        from distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise ConfigError(
            f"--scheduler, and --jobs above 1, need dask.distributed: {sys.executable} -m pip install distributed"
        ) from error
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        here = engine.scheduler is None
        cluster = LocalCluster(n_workers=engine.jobs, threads_per_worker=1, dashboard_address=None) if here else None
        client = Client(cluster if here else engine.scheduler, timeout=CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(
            f"no dask scheduler at {engine.scheduler} ({error}); start one with 'dask scheduler'"
        ) from error
    try:
        futures = {client.submit(guarded, work, task, pure=False, retries=1): task for task in tasks}
        for future in as_completed(list(futures)):
            if future.cancelled():
                raise ConfigError(
                    f"the dask scheduler at {engine.scheduler or 'this machine'} was lost; start it again, then the "
                    "same command goes on with what is missing"
                )
            yield futures[future], _of_worker(future)
    finally:
        client.close()
        if cluster is not None:
            cluster.close()


def _of_worker(future: Any) -> Done:
    """What a worker made of a task; one that died, or had not what the task needs, may be better next time."""
    error = future.exception()
    if error is None:
        return cast(Done, future.result())
    return Done({"failed": f"its worker failed: {type(error).__name__}: {' '.join(str(error).split())}"}, False)


def _key(task: dict[str, Any]) -> str:
    return json.dumps(task, sort_keys=True)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
