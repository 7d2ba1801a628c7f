"""Campaigns: nothing done twice, nothing lost, one bad task is one failure; here and on dask workers."""

import json
from typing import NamedTuple

import pytest

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
    assert len((tmp_path / "r.jsonl").read_text().splitlines()) == 5


def test_an_interrupted_campaign_goes_on(tmp_path):
    def interrupted(task: Square) -> dict[str, int]:
        if task.number == 2:
            raise KeyboardInterrupt
        return square(task)

    with pytest.raises(KeyboardInterrupt):
        run_campaign(TASKS, interrupted, Store(tmp_path / "r.jsonl"), Engine())
    with (tmp_path / "r.jsonl").open("a") as file:
        file.write('{"task": {"number": 2, "wor')  # killed while it wrote
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine()) == RESULTS


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
    with pytest.raises(InputError, match=r"r\.jsonl"):
        Store(tmp_path / "r.jsonl")


def test_dask_workers_do_the_same(tmp_path):
    pytest.importorskip("distributed")
    assert run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(jobs=2)) == RESULTS


def test_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("vsx_ros.cli.experiments.campaign.CONNECT_S", 1.0)
    with pytest.raises(ConfigError, match="no dask scheduler at tcp://127.0.0.1:1"):
        run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(scheduler="tcp://127.0.0.1:1"))


def test_without_dask_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(ConfigError, match="pip install"):
        run_campaign(TASKS, square, Store(tmp_path / "r.jsonl"), Engine(jobs=2))
