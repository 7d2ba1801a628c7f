"""The line that tells how a run is going: the same of all runs, its reason first, no longer than a terminal is wide."""

from types import SimpleNamespace
from typing import cast

import pytest

from vsx_ros.exploration.decision import SECOND_NS, Action, Decision, MissionState
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.progress_line import progress_line

DRIVING = "driving 3.0 m to look at 4.1 m2 of unknown ground; second best: 3.2 m2 after 2.5 m, 97 % as good"


def test_a_long_reason_is_cut_to_a_terminal_and_its_figures_are_left_out() -> None:
    facts = {"known": "41 % covered", "driven_m": 7.25, "elapsed_s": 85.0}
    line = progress_line("mapping", f"{DRIVING} [U = v/d = 1]", **facts, limit_s=300.0)
    assert len(line) == 79
    assert line.startswith("mapping: driving 3.0 m to look at 4.1 m2")
    assert line.endswith("... | 41 % covered | 7.2 m | 85/300 s")
    short = progress_line("mapping", "on the way [U = 1]", **facts)
    assert short == "mapping: on the way | 41 % covered | 7.2 m | 85 s"


@pytest.mark.parametrize(
    ("left_s", "told"),
    [(None, "85 s"), (20, "85 s, ~1 min left"), (150, "85 s, ~3 min left"), (250, "85 s, ~4 min left")],
)
def test_the_time_left_is_told_where_it_is_known(left_s: float | None, told: str) -> None:
    line = progress_line("mapping", "on the way", known="41 % covered", driven_m=0.0, elapsed_s=85.0, left_s=left_s)
    assert line == f"mapping: on the way | 41 % covered | 0.0 m | {told}"


@pytest.mark.parametrize("limit_s", [None, 360_000.0])
@pytest.mark.parametrize("left_s", [None, 86_400.0])
@pytest.mark.parametrize("state", [state.value for state in MissionState])
def test_the_longest_words_fit_and_the_reason_is_read(state: str, limit_s: float | None, left_s: float | None) -> None:
    long = {"known": "12345.6 m2 known", "driven_m": 123_456.7, "elapsed_s": 359_999.0}
    line = progress_line(state, DRIVING, **long, limit_s=limit_s, left_s=left_s)
    assert len(line) == 79
    assert line.startswith(f"{state}: driving 3.0 m to look at")
    assert "... | 12345.6 m2 known | " in line
    assert "359999" in line


def test_a_run_in_lock_step_tells_the_same() -> None:
    decision = Decision(Action.WAIT, goal=None, frame="map", state="mapping", reason=f"on the way: {DRIVING} [U = 1]")
    mission = SimpleNamespace(
        state=MissionState.MAPPING, view_selector=SimpleNamespace(time_left=SimpleNamespace(at=lambda now_ns: 250.0))
    )
    run = SimpleNamespace(
        _decided=decision,
        system=SimpleNamespace(mission=mission, grid=SimpleNamespace(known_area_m2=31.25)),
        record=SimpleNamespace(frames=[SimpleNamespace(stamp_ns=85 * SECOND_NS)]),
        robot=SimpleNamespace(truth=SimpleNamespace(path_length_m=7.25)),
    )
    line = FastRun._progress(cast(FastRun, run), 300.0)
    facts = {"known": "31.2 m2 known", "driven_m": 7.25, "elapsed_s": 85.0, "limit_s": 300.0, "left_s": 250.0}
    assert line == progress_line("mapping", decision.reason, **facts)
    assert line.startswith("mapping: on the way: driving 3.0 m to")
    run._decided = None
    assert FastRun._progress(cast(FastRun, run), 300.0).startswith("mapping | 31.2 m2 known")
