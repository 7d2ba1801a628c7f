"""Many tasks, one after the other or on many machines; every result is written down as it comes, so that a campaign
can be interrupted and continued."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from vsx_ros import __version__
from vsx_ros.errors import ConfigError, InputError, VsxError, reason_of

Result = dict[str, Any]
CONNECT_S = 10.0


class Task(Protocol):
    """What is to be done: a NamedTuple of numbers and words."""

    def _asdict(self) -> dict[str, Any]: ...


Work = Callable[[Any], Result]


class Engine(NamedTuple):
    """Where tasks run. jobs: processes on this machine. scheduler: address of a dask scheduler, used instead."""

    jobs: int = 1
    scheduler: str | None = None


class Store:
    """results.jsonl: a line for each task that was done, with the version that did it."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when the file cannot be read or written."""
        self._path = path
        self._known: dict[str, Result] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
                entry = json.loads(line)
                if entry["version"] == __version__:
                    self._known[_key(entry["task"])] = entry["result"]
        except (OSError, KeyError, TypeError) as error:
            raise InputError(f"{path} cannot be used ({reason_of(error)}); choose another --out") from error
        except ValueError as error:
            self._drop_torn_line(error)

    def __contains__(self, task: Task) -> bool:
        return _key(task._asdict()) in self._known

    def __getitem__(self, task: Task) -> Result:
        return self._known[_key(task._asdict())]

    def add(self, task: Task, result: Result) -> None:
        """Append the line."""
        line = json.dumps({"task": task._asdict(), "version": __version__, "result": result})
        with self._path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        self._known[_key(task._asdict())] = result

    def _drop_torn_line(self, error: ValueError) -> None:
        """The last line may have been cut off when the campaign was killed; anything else is damage."""
        *whole, last = self._path.read_text(encoding="utf-8").splitlines()
        if last.endswith("}") or len(self._known) < len(whole) - 1:
            raise InputError(f"{self._path} is damaged ({error}); choose another --out, or remove it") from error
        self._path.write_text("".join(line + "\n" for line in whole), encoding="utf-8")


def run_campaign(tasks: Sequence[Task], work: Work, store: Store, engine: Engine) -> list[Result]:
    """Results of the tasks, in their order; those that the store knows are not done again.

    A task that fails has the result {"failed": reason}. Raises ConfigError when the engine cannot be had.
    """
    waiting = [task for task in tasks if task not in store]
    began_s, known = time.monotonic(), len(tasks) - len(waiting)
    if known:
        _say(f"{known} of {len(tasks)} are known already")
    for done, (task, result) in enumerate(_results(waiting, work, engine), start=1):
        store.add(task, result)
        left_s = (time.monotonic() - began_s) / done * (len(waiting) - done)
        told = f"failed: {result['failed']}" if "failed" in result else "done"
        words = " ".join(str(value) for value in task._asdict().values() if value is not None)
        _say(f"{known + done} of {len(tasks)}, about {left_s / 60:.0f} min left: {words}: {told}")
    return [store[task] for task in tasks]


def guarded(work: Work, task: Task) -> Result:
    """The result of a task, or why there is none: one bad world must not end a campaign of hundreds."""
    try:
        return work(task)
    except VsxError as error:
        return {"failed": str(error)}
    except Exception as error:
        return {"failed": f"internal error, please report it: {type(error).__name__}: {error}"}


def _results(tasks: Sequence[Task], work: Work, engine: Engine) -> Iterator[tuple[Task, Result]]:
    if engine.jobs == 1 and engine.scheduler is None:
        return ((task, guarded(work, task)) for task in tasks)
    return _distributed(tasks, work, engine)


def _distributed(tasks: Sequence[Task], work: Work, engine: Engine) -> Iterator[tuple[Task, Result]]:
    """In the order in which they are done."""
    try:
        from distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise ConfigError(
            "--jobs and --scheduler need dask.distributed: pip install 'vsx_ros[sweep]' (or 'pip install distributed')"
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
            died = future.exception()
            yield futures[future], future.result() if died is None else {"failed": f"its worker died: {died}"}
    finally:
        client.close()
        if cluster is not None:
            cluster.close()


def _key(task: dict[str, Any]) -> str:
    return json.dumps(task, sort_keys=True)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
