"""Benchmarks of faults count what they name: stops for the fault, wheels under the operator, trials drawn again."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vsx_ros.experiments.rows import Row

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import fault_master
import fault_nodes
import tables


class Stubborn:
    """A process that does not end."""

    def wait(self, timeout: float) -> int:
        raise subprocess.TimeoutExpired("follower", timeout)


def test_a_node_that_does_not_end_costs_its_robot_and_not_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fault_nodes, "turned_s", lambda stack, node, how: 0.25)
    stack = SimpleNamespace(ended=False, _processes={"follower": Stubborn()})
    ending = fault_nodes.Ending("follower", "stopped", 0)
    assert fault_nodes.trial(stack, ending) == {"turned_s": 0.25, "ended": False}
    assert stack.ended


def test_the_wait_for_the_stop_path_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fault_master, "stop_path", lambda: False)
    plant = SimpleNamespace(started_s=5.0)
    assert fault_master.wait_for_stop_path(plant, 1.0, 0.05) == (None, True)
    assert fault_master.wait_for_stop_path(plant, 6.0, 0.05) == (None, False)


def rows(*results: dict[str, Any], **asked: Any) -> list[Row]:
    about = {"commit": "0123456789ab", "dirty": False, "code": "", "config": "", "when": "2026-11-23T07:00:00+00:00"}
    return [Row(**about, versions={}, machine={}, asked=asked, result=result) for result in results]


def cells(name: str, of: list[Row]) -> list[str]:
    """Of the first line of this table."""
    return [cell.strip() for cell in tables.TABLES[name].made(of)[2].split("|")[1:-1]]


def test_what_does_not_end_or_is_not_there_again_is_counted() -> None:
    ended = [{"turned_s": 0.3}, {"turned_s": 0.3, "ended": True}, {"turned_s": 0.3, "ended": False}]
    assert cells("nodes", rows(*ended, node="vslam", how="stopped"))[4] == "3; in 1 the process did not end"
    master = {"turned_s": 0.1, "moved_before": False, "path_s": 0.5, "driving_s": 1.0, "stopped": True}
    assert cells("masters", rows(master, {**master, "path_s": None}, away_s=1.0))[3] == (
        "0.50 s, 0.50 s of 1; 1 not within a minute"
    )
