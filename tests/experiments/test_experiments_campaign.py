"""Campaigns: nothing done twice, nothing lost, one bad task is one failure; here and on dask workers."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from free_ports import free_port
from waiting import PATIENCE_S, wait_for

from vsx_ros.errors import ConfigError, InputError
from vsx_ros.experiments.campaign import Engine, UntriedError, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.runs.world import world_of


class Square(NamedTuple):
    number: int
    words: tuple[str, ...] = ()


def square(task: Square) -> dict[str, int]:
    if task.number == 3:
        raise InputError("three is refused")
    if task.number == 4:
        raise ZeroDivisionError("four")
    return {"square": task.number**2}


def whose(task: Square) -> dict[str, int]:
    return {"pid": os.getpid()}


TASKS = [Square(n, ("a=1",)) for n in range(5)]
RESULTS = [
    {"square": 0}, {"square": 1}, {"square": 4}, {"failed": "three is refused"},
    {"failed": "internal error, please report it: ZeroDivisionError: four"},
]  # fmt: skip


def test_results_come_in_order_and_failures_are_results(tmp_path, capsys):
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine()) == RESULTS
    said = capsys.readouterr().err
    assert "5 of 5, about 0 min left" in said
    assert "failed: three is refused" in said


def test_what_is_known_is_not_done_again(tmp_path, capsys):
    run_campaign(TASKS[:2], square, Store(tmp_path / "r.jsonl"), Engine())

    def only_new(task: Square) -> dict[str, int]:
        assert task.number >= 2
        return square(task)

    assert run_campaign(TASKS, only_new, Store(tmp_path / "r.jsonl"), Engine()) == RESULTS
    assert "2 of 5 are known already" in capsys.readouterr().err
    kept = [json.loads(line)["result"] for line in (tmp_path / "r.jsonl").read_text().splitlines()]
    assert kept == [result for result in RESULTS if "internal error" not in result.get("failed", "")]


class Visit(NamedTuple):
    world: str
    seed: int = 0


def test_a_world_that_cannot_be_opened_is_tried_again(tmp_path, capsys):
    """Its failure is no row, and another world is opened."""
    world = tmp_path / "mine.world"
    tasks, store = [Visit(str(world))], tmp_path / "r.jsonl"
    world.write_text("no world")

    def opened(task: Visit) -> dict[str, str]:
        return {"name": world_of(task.world, task.seed).name}

    (failed,) = run_campaign(tasks, opened, Store(store), Engine())
    assert "mine.world" in failed["failed"]
    assert "1 of the failures may pass" in capsys.readouterr().err
    assert not store.exists()
    assert run_campaign([Visit("lab", 3)], opened, Store(store), Engine()) == [{"name": "lab"}]


@pytest.mark.parametrize(
    ("trouble", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "/tmp/x"), "/tmp/x cannot be used (No space left on device)"),
        (MemoryError(), "MemoryError"),
        (UntriedError("the robot does not drive"), "the robot does not drive"),
        (ModuleNotFoundError("No module named 'cv2'"), "No module named 'cv2'"),
    ],
)
def test_what_may_pass_is_tried_again(tmp_path, capsys, trouble, said):
    def in_trouble(task: Square) -> dict[str, int]:
        raise trouble

    results = run_campaign(TASKS[:2], in_trouble, Store(tmp_path / "r.jsonl"), Engine())
    assert all(said in result["failed"] for result in results)
    assert "2 of the failures may pass" in capsys.readouterr().err
    assert run_campaign(TASKS[:2], square, Store(tmp_path / "r.jsonl"), Engine()) == RESULTS[:2]


def test_an_interrupted_campaign_goes_on(tmp_path):
    def interrupted(task: Square) -> dict[str, int]:
        if task.number == 2:
            raise KeyboardInterrupt
        return square(task)

    with pytest.raises(KeyboardInterrupt):
        run_campaign(TASKS, interrupted, Store(tmp_path / "r.jsonl"), Engine())
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine()) == RESULTS


@pytest.mark.parametrize("engine", [Engine(jobs=2), Engine(apart=True)])
def test_processes_of_their_own_do_the_same(tmp_path, engine):
    here = os.getpid()
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), engine) == RESULTS
    pids = [r["pid"] for r in run_campaign(TASKS[:3], whose, Store(tmp_path / "pids.jsonl"), engine)]
    assert len({here, *pids}) == 4


def test_dask_workers_do_the_same(tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        engine = Engine(scheduler=cluster.scheduler_address)
        assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), engine) == RESULTS


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("vsx_ros.experiments.campaign.CONNECT_S", 1.0)
    with pytest.raises(ConfigError, match="no dask scheduler at tcp://127.0.0.1:1"):
        run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(scheduler="tcp://127.0.0.1:1"))


def test_a_scheduler_that_is_lost(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    address = f"tcp://127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", address]
    scheduler = subprocess.Popen(
        command, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, stderr=subprocess.DEVNULL
    )
    real = distributed.as_completed

    def lost(futures):
        scheduler.kill()
        return real(futures)

    monkeypatch.setattr(distributed, "as_completed", lost)
    try:
        with pytest.raises(ConfigError, match=f"the dask scheduler at {address} was lost; start it again"):
            run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(scheduler=address))
    finally:
        scheduler.kill()
        scheduler.wait()


def dies(task: Square) -> dict[str, int]:
    os._exit(1)


def test_a_process_that_dies_is_tried_again(tmp_path):
    (failed,) = run_campaign(TASKS[:1], dies, Store(tmp_path / "r.jsonl"), Engine(apart=True))
    assert failed["failed"].startswith("its process died")
    assert TASKS[0]._asdict() not in Store(tmp_path / "r.jsonl")


def slow(task: Square) -> dict[str, int]:
    Path(task.words[0]).write_text(str(os.getpid()))
    time.sleep(60)
    return {}


def is_over(pid: int) -> bool:
    """Ended, or ended and not yet asked how."""
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_processes_end_with_the_campaign_however_that_ends(tmp_path, end):
    code = (
        "import test_experiments_campaign as t; t.run_campaign([t.Square(1, (r'{}',))], t.slow, t.Store(t.Path(r'{}')),"
        " t.Engine(apart=True))"
    ).format(tmp_path / "pid", tmp_path / "r.jsonl")
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    campaign = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.DEVNULL
    )
    wait_for(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    campaign.send_signal(end)
    campaign.wait(PATIENCE_S)
    wait_for(lambda: is_over(int((tmp_path / "pid").read_text())))
    assert not (tmp_path / "r.jsonl").exists()


def test_without_dask_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ConfigError, match="pip install"):
        run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(scheduler="tcp://127.0.0.1:1"))
