"""Benchmarks of faults count what they name: stops for the fault, wheels under the operator, trials drawn again."""

import subprocess
from types import SimpleNamespace
from typing import Any

import fault_camera
import fault_master
import fault_nodes
import fault_operator
import fault_sensors
import pytest
import tables
from fault_camera import Report

from vsx_ros.experiments.rows import Row

LEASE = "stale no word from vslam, which may have no images"
ARRIVED, DRIVING = "arrived arrived 0.4 cm, 0.1 deg off", "mapping: on the way: driving 1.0 m"


@pytest.mark.parametrize(
    ("follower", "slam", "mission", "counts"),
    [
        (LEASE, "POOR: no image comes", DRIVING, True),
        ("diverged no word from vslam, which may have no images", "TRACKING", DRIVING, True),
        ("following waiting for the next image", "TRACKING", DRIVING, True),
        ("stale SLAM tracking is lost", "LOST: 0 of 411 expected points found", DRIVING, True),
        ("stopped stopped on the way", "LOST: 0 of 411 expected points found", DRIVING, True),
        ("stopped stopped on the way", "TRACKING", "recovering: lost", True),
        ("stopped stopped on the way", "TRACKING", DRIVING, False),
        (ARRIVED, "LOST: 0 of 467 expected points found", "recovering: waiting for relocalisation", False),
        ("following", "LOST: 0 of 462 expected points found", "recovering: on the way", False),
        ("stale waiting: a face hides the way", "TRACKING", DRIVING, False),
        ("stale no odometry that can be used", "TRACKING", DRIVING, False),
    ],
)
def test_a_stop_counts_if_images_or_tracking_are_its_reason(
    follower: str, slam: str, mission: str, counts: bool
) -> None:
    assert fault_camera.is_reaction(follower, slam, mission) == counts


def reports(*said: tuple[float, str]) -> list[Report]:
    """Of the follower, while SLAM tracks on a way."""
    of = [Report(0.0, "slam", "TRACKING"), Report(0.0, "mission", DRIVING), Report(0.0, "follower", "following")]
    return [*of, *(Report(at_s, "follower", words) for at_s, words in said)]


def test_an_arrival_is_no_reaction_to_a_fault_and_all_turning_is_summed() -> None:
    changes = [(10.0, True), (10.2, False), (10.5, True), (11.0, False)]
    row = fault_camera.judged(changes, 14.0, reports((10.21, ARRIVED), (10.4, "following"), (11.01, LEASE)))
    assert (row["turned_s"], row["moved_s"], row["others"]) == (1.0, 0.7, [ARRIVED])
    assert (row["slam"], row["follower"], row["mission"]) == ("TRACKING", LEASE, DRIVING)
    row = fault_camera.judged(changes[:2], 14.0, reports((10.21, ARRIVED)))
    assert (row["turned_s"], row["moved_s"], row["others"]) == (-1.0, 0.2, [ARRIVED])
    stood = tables.table_faults._stood([{**row, "later": "standing; TRACKING; mapping"}])
    assert stood == "1 of 1 stood for another reason, and stayed"
    begun = reports((10.2, "following about to drive"), (10.31, LEASE))
    row = fault_camera.judged([(10.0, True), (10.3, False)], 14.0, begun)
    assert (row["turned_s"], row["moved_s"], row["others"]) == (0.3, 0.3, [])
    row = fault_camera.judged([(10.0, True)], 14.0, reports())
    assert (row["turned_s"], row["moved_s"], row["others"]) == (-1.0, 4.0, [])
    assert tables.table_faults._stood([{**row, "later": "driving; TRACKING; mapping"}]) == "1 of 1 did not"


def test_a_fault_begins_while_the_robot_maps_tracks_and_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    injected: list[str] = []
    ear = object.__new__(fault_camera.Ear)
    ear._stack = SimpleNamespace(plant=SimpleNamespace(moving=True), cable=SimpleNamespace(inject=injected.append))
    monkeypatch.setattr(fault_camera, "SETTLED_S", 0.0)
    monkeypatch.setattr(fault_camera, "WATCH_S", 0.05)
    fault = fault_camera.Failing("off", 0)
    for slam, mission in (("TRACKING", "recovering: lost"), ("LOST", DRIVING), ("TRACKING", "")):
        ear._reports = [Report(0.0, "slam", slam), Report(0.0, "mission", mission)]
        assert ear.trial(fault) is None
    assert injected == []
    ear._reports = reports()
    row = ear.trial(fault)
    assert row is not None
    assert (row["turned_s"], row["later"], injected) == (-1.0, f"driving; TRACKING; {DRIVING}", ["off", ""])


def held(turn_m_s: float, *told: tuple[int, tuple[float, float]]) -> dict[str, float | None]:
    """After so many steps of 10 ms with each of these commands."""
    wheels = fault_operator.HeldWheels(turn_m_s)
    commands = [command for count, command in told for _ in range(count)]
    for number, command in enumerate(commands, start=1):
        wheels.step(10_000_000 * number, command)
    return wheels.result


def test_wheels_that_turn_while_the_operator_holds_them_are_told() -> None:
    still, on, turn = (0.0, 0.0), (0.2, 0.2), (-0.035, 0.034)
    assert held(0.0, (5, on), (100, still)) == {"obeyed_s": 0.05, "else_s": 0.0, "idle_s": None}
    assert held(0.0, (5, on), (100, still), (20, on), (9, still))["else_s"] == 0.2
    assert held(0.0, (100, on))["obeyed_s"] is None
    told = held(0.0345, (10, on), (10, still), (50, turn), (7, still), (3, on), (50, turn))
    assert told == {"obeyed_s": 0.2, "else_s": 0.03, "idle_s": 0.07}
    assert held(0.0345, (10, turn), (10, (0.03, -0.03)), (10, (-0.06, 0.06)))["else_s"] == 0.2


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


@pytest.mark.parametrize("motion", fault_sensors.hw_sensor_faults.MOTIONS)
def test_a_refused_frame_is_counted_and_not_supposed(motion: str) -> None:
    told = fault_sensors.told(fault_sensors.Broken("kobuki", "gyro", "one wrong report", motion))
    assert (told["told_s"], told["refused"]) == (None, 1)
    assert fault_sensors.told(fault_sensors.Broken("kobuki", "gyro", "stuck", motion))["refused"] == 0


def rows(*results: dict[str, Any], **asked: Any) -> list[Row]:
    about = {"commit": "0123456789ab", "dirty": False, "code": "", "config": "", "when": "2026-11-23T07:00:00+00:00"}
    return [Row(**about, versions={}, machine={}, asked=asked, result=result) for result in results]


def cells(name: str, of: list[Row]) -> list[str]:
    """Of the first line of this table."""
    return [cell.strip() for cell in tables.TABLES[name].made(of)[2].split("|")[1:-1]]


def test_camera_faults_are_counted_by_what_was_said_and_done() -> None:
    said = {"slam": "LOST: 0 of 411 expected points found; position by odometry", "follower": LEASE, "mission": ""}
    later = [f"driving; LOST: {n} of 400 expected points found; recovering: lost: back {n} m" for n in (1, 2)]
    new = {**said, "moved_s": 3.0, "others": []}
    of = rows(
        {**new, "turned_s": 1.0, "later": later[0]},
        {**new, "turned_s": 2.0, "later": later[1], "others": [ARRIVED]},
        {**new, "turned_s": -1.0, "later": "standing; TRACKING; mapping: coming to rest", "follower": ARRIVED},
        fault="garbage",
    )
    assert cells("robots", of) == [
        "garbage", "1.500 s, 2.000 s of 2; 1 of 3 did not; 1 of 3 also stood before, for another reason",
        "3.00 s, 3.00 s",
        f"2 of 3: LOST: n of n expected points found; {LEASE} / "
        "1 of 3: LOST: n of n expected points found; arrived arrived n cm, n deg off",
        "2 of 3: driving; LOST: n of n expected points found; recovering / 1 of 3: standing; TRACKING; mapping",
    ]  # fmt: skip
    assert not any("every standstill" in line for line in tables.TABLES["robots"].made(of))
    old = rows({**said, "turned_s": 1.0, "later": later[0]}, fault="garbage")
    assert cells("robots", old)[1:3] == ["1.000 s, 1.000 s of 1", "not measured"]
    assert any("every standstill" in line for line in tables.TABLES["robots"].made(old))


def test_the_gap_to_a_post_is_the_least_and_trials_drawn_again_are_counted() -> None:
    trial = {"speed_m_s": 0.3, "contact": False, "rest_s": 0.9, "left_m": 0.2, "least_m": 0.2}
    passed = {**trial, "rest_s": None, "left_m": 0.3, "least_m": 0.1}
    assert cells("posts", rows(trial, passed, ahead_m=0.5))[3:] == [
        "0.90 s, 0.90 s of 1; 1 not within 5 s", "15 cm, 10 cm", "not counted"
    ]  # fmt: skip
    of = rows({**trial, "redrawn": []}, {**passed, "redrawn": [0.31, 0.05]}, ahead_m=0.5)
    assert cells("posts", of)[5] == "2, least gap 5 cm"


def test_wheels_under_the_operator_are_summed_over_all_repetitions() -> None:
    taken = {"said_s": 0.2, "told": True, "goals": 0, "blacklisted": 0, "reached": None, "went_on_s": 1.0}
    assert cells("operators", rows(taken, what="teleop"))[3] == "not measured"
    of = rows(*2 * [{**taken, "obeyed_s": 0.1, "else_s": 0.02, "idle_s": 0.3}], what="teleop")
    assert cells("operators", of)[3] == "0.10 s, 0.10 s of 2; turned for 0.04 s, stood for 0.60 s"
    of = rows({**taken, "obeyed_s": 0.1, "else_s": 0.0, "idle_s": None}, what="emergency stop")
    assert cells("operators", of)[3] == "0.10 s, 0.10 s of 1; turned for 0.00 s"


def broken(fault: str, *results: dict[str, Any]) -> list[Row]:
    """A gyro on the line and on arcs."""
    whole = {"told_s": None, "stood_s": None, "jump_m": 0.0, "jump_rad": 0.0, "wrong_rad": 0.0, "as_slip": False}
    return [
        row
        for result, motion in zip(results, ("line", "arc", "right arc"))
        for row in rows({**whole, **result}, base="kobuki", sensor="gyro", fault=fault, motion=motion)
    ]


def test_motions_on_which_a_broken_sensor_is_not_told_are_counted() -> None:
    some = broken("stuck", {}, {"told_s": 0.4}, {})
    assert cells("sensors", some)[3] == "0.4 s; not told in 2 of 3 (line, right arc)"
    assert cells("sensors", broken("stuck", {}, {}))[3:5] == ["not told in 2 of 2", "goes on"]
    wrong = broken("one wrong report", {"refused": 1}, {"refused": 0}, {"refused": 1})
    assert cells("sensors", wrong)[3:5] == ["not told in 3 of 3; a frame refused in 2 of them", "goes on"]
    assert cells("sensors", broken("stuck", {"stood_s": 1.0}, {}))[4] == "stands within 1.0 s in 1 of 2"


def test_what_does_not_end_or_is_not_there_again_is_counted() -> None:
    ended = [{"turned_s": 0.3}, {"turned_s": 0.3, "ended": True}, {"turned_s": 0.3, "ended": False}]
    assert cells("nodes", rows(*ended, node="vslam", how="stopped"))[4] == "3; in 1 the process did not end"
    master = {"turned_s": 0.1, "moved_before": False, "path_s": 0.5, "driving_s": 1.0, "stopped": True}
    assert cells("masters", rows(master, {**master, "path_s": None}, away_s=1.0))[3] == (
        "0.50 s, 0.50 s of 1; 1 not within a minute"
    )
