"""Many tasks, one after the other or on many machines. Every result is stored at once, so that a campaign can be
interrupted and continued."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures import as_completed as as_done
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from typing import Any, NamedTuple, Protocol

from vsx_ros.errors import ConfigError, VsxError, disk_trouble
from vsx_ros.experiments.rows import Store, tell
from vsx_ros.runs.world import WorldError

Result = dict[str, Any]
CONNECT_S = 10.0  # to a dask scheduler
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")


class Task(Protocol):
    """A task: a NamedTuple of numbers and words."""

    def _asdict(self) -> dict[str, Any]: ...


class UntriedError(VsxError):
    """A task could not be tried: no result of it."""


class Done(NamedTuple):
    """final: whether the result comes from the task itself, not from a missing file, a full disk or a worker that lacks
    memory or a module."""

    result: Result
    final: bool


Work = Callable[[Any], Result]


class Engine(NamedTuple):
    """Where tasks run. jobs: how many at once on this machine. apart: each task in its own process, also if jobs is 1;
    else a single one runs in the caller's process. scheduler: address of a dask scheduler, used instead."""

    jobs: int = 1
    scheduler: str | None = None
    apart: bool = False


def run_campaign(tasks: Sequence[Task], work: Work, store: Store, engine: Engine) -> list[Result]:
    """Results of the tasks, in their order; those in the store are not run again. A task that fails has the result
    {"failed": reason}. A failure not caused by the task itself is not stored, so the next call tries it again. Raises
    ConfigError when the engine is unavailable or lost."""
    waiting = [task for task in tasks if task._asdict() not in store]
    began_s, known = time.monotonic(), len(tasks) - len(waiting)
    if known:
        tell(f"{known} of {len(tasks)} are known already")
    again: dict[Task, Result] = {}
    if engine.scheduler is not None:
        results = _distributed(waiting, work, engine.scheduler)
    elif engine.jobs > 1 or engine.apart:
        results = _apart(waiting, work, engine.jobs)
    else:
        results = ((task, guarded(work, task)) for task in waiting)
    for done, (task, (result, final)) in enumerate(results, start=1):
        if final:
            store.add(task._asdict(), result)
        else:
            again[task] = result
        left_s = (time.monotonic() - began_s) / done * (len(waiting) - done)
        told = f"failed: {result['failed']}" if "failed" in result else "done"
        words = " ".join(str(value) for value in task._asdict().values() if value is not None)
        tell(f"{known + done} of {len(tasks)}, about {left_s / 60:.0f} min left: {words}: {told}")
    if again:
        tell(f"{len(again)} of the failures may pass; the same command tries them again")
    return [again[task] if task in again else store[task._asdict()] for task in tasks]


def guarded(work: Work, task: Task) -> Done:
    """The result of a task, or the reason of its failure: one bad world must not end a campaign of hundreds."""
    try:
        return Done(work(task), True)
    except VsxError as error:
        return Done({"failed": str(error)}, not isinstance(error, WorldError | UntriedError))
    except Exception as error:
        trouble = disk_trouble(error) if isinstance(error, OSError) else ""
        reason = trouble or f"internal error, please report it: {type(error).__name__}: {error}"
        return Done({"failed": reason}, False)


def _apart(tasks: Sequence[Task], work: Work, jobs: int) -> Iterator[tuple[Task, Done]]:
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    pool = ThreadPoolExecutor(jobs)
    try:
        futures = {pool.submit(_in_its_own, work, task): task for task in tasks}
        for future in as_done(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in active_children():  # an interrupted campaign does not wait for unfinished runs
            process.terminate()


def _in_its_own(work: Work, task: Task) -> Done:
    """Runs the task in its own process, which ends with it."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_end_with_the_caller) as one:
        try:
            return one.submit(guarded, work, task).result()
        except BrokenProcessPool:
            return Done({"failed": "its process died, perhaps for want of memory"}, False)


def _end_with_the_caller() -> None:
    """End this process when the caller ends, for whatever reason."""
    caller = parent_process()
    assert caller is not None

    def watch() -> None:
        caller.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _distributed(tasks: Sequence[Task], work: Work, scheduler: str) -> Iterator[tuple[Task, Done]]:
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise ConfigError(f"--scheduler needs dask.distributed: {sys.executable} -m pip install distributed") from error
    try:
        client = Client(scheduler, timeout=CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"no dask scheduler at {scheduler} ({error}); start one with 'dask scheduler'") from error
    try:
        futures = {client.submit(guarded, work, task, pure=False, retries=1): task for task in tasks}
        for future in as_completed(list(futures)):
            if future.cancelled():
                raise ConfigError(
                    f"the dask scheduler at {scheduler} was lost; start it again, then the same command goes on with "
                    "what is missing"
                )
            cause = future.exception()  # of a worker that died, or lacks what the task needs
            told = "" if cause is None else f"{type(cause).__name__}: {' '.join(str(cause).split())}"
            yield futures[future], Done({"failed": f"its worker failed: {told}"}, False) if told else future.result()
    finally:
        client.close()
