"""Campaigns: nothing done twice, nothing lost, one bad task is one failure; here and on dask workers."""

import errno
import json
import os
import subprocess
import sys
from typing import NamedTuple

import pytest
from free_ports import free_port

from vsx_ros.cli.experiments.campaign import Engine, Store, run_campaign
from vsx_ros.errors import ConfigError, InputError


class Square(NamedTuple):
    number: int
    words: tuple[str, ...] = ()


def square(task: Square) -> dict[str, int]:
    if task.number == 3:
        raise InputError("three is refused")
    if task.number == 4:
        raise ZeroDivisionError("four")
    return {"square": task.number**2}


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


@pytest.mark.parametrize(
    ("trouble", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "/tmp/x"), "/tmp/x cannot be used (No space left on device)"),
        (MemoryError(), "MemoryError"),
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


@pytest.mark.parametrize("version", ["of now", "0.0.0"])
def test_a_campaign_killed_while_it_wrote_goes_on(tmp_path, version):
    path = tmp_path / "r.jsonl"
    for task, result in zip(TASKS[:3], RESULTS, strict=False):
        Store(path).add(task, {"nested": result})
    whole = path.read_bytes() if version == "of now" else path.read_bytes().replace(b'"version": "', b'"version": "0.')
    lines = whole.splitlines(keepends=True)
    for cut in range(1, len(lines[-1]) + 1):
        path.write_bytes(whole[:-cut])
        store = Store(path)
        assert [task in store for task in TASKS[:3]] == [version == "of now"] * 2 + [False]
        store.add(TASKS[2], {"nested": {"square": 4}})
        assert path.read_bytes().splitlines(keepends=True)[:2] == lines[:2]
        assert Store(path)[TASKS[2]] == {"nested": {"square": 4}}


def test_a_disk_that_takes_no_more_is_told(tmp_path):
    store = Store(tmp_path / "r.jsonl")
    os.symlink("/dev/full", tmp_path / "r.jsonl")
    with pytest.raises(InputError, match=r"r\.jsonl cannot be written \(No space left on device\); free the disk"):
        store.add(TASKS[0], RESULTS[0])


def test_results_of_another_version_are_not_taken(tmp_path):
    store = Store(tmp_path / "r.jsonl")
    store.add(TASKS[1], {"square": 1})
    line = json.loads((tmp_path / "r.jsonl").read_text())
    (tmp_path / "r.jsonl").write_text(json.dumps({**line, "version": "0.0.0"}) + "\n")
    assert TASKS[1] in store
    assert TASKS[1] not in Store(tmp_path / "r.jsonl")


@pytest.mark.parametrize("damage", ['{"task": 1}\n', "[]\n", "nonsense}\n", "x\ny\nz\n"])
def test_damage_is_told(tmp_path, damage):
    (tmp_path / "r.jsonl").write_text(damage)
    with pytest.raises(InputError, match=r"r\.jsonl is damaged in line 1"):
        Store(tmp_path / "r.jsonl")


def test_dask_workers_do_the_same(tmp_path):
    pytest.importorskip("distributed")
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(jobs=2)) == RESULTS


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("vsx_ros.cli.experiments.campaign.CONNECT_S", 1.0)
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


@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_dies_is_tried_again(tmp_path):
    pytest.importorskip("distributed")
    (failed,) = run_campaign(TASKS[:1], dies, Store(tmp_path / "r.jsonl"), Engine(jobs=2))
    assert failed["failed"].startswith("its worker failed: KilledWorker")
    assert TASKS[0] not in Store(tmp_path / "r.jsonl")


def test_without_dask_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ConfigError, match="pip install"):
        run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(jobs=2))
