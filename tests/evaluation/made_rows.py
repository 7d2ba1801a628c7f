"""A row of a benchmark, made up."""

from typing import Any

import msgspec

from vsx_ros.experiments.rows import Row


def row(seed: int, code: str = "a", config: str = "c", commit: str = "0123456789ab", **asked: Any) -> Row:
    result = {
        "coverage_correct": 0.9, "breaks": 0, "relocalizations": 0, "collisions": 0, "ate_rmse_m": 0.01,
        "scale_error": -0.002, "driven_m": 60.0, "min_clearance_m": 0.1, "duration_s": 400.0, "times_lost": 1,
        "reached": {"50": [20.0, 90.0], "90": [60.0, 400.0]}, "decisions": [[3.0, 8, 50, 400]],
        "slam": {}, "stop_reason": "90 % is known",
    }  # fmt: skip
    limits = {"until": 0.9, "time_s": 800.0, "way_m": 120.0}
    asked = {"world": "lab", "seed": seed, "noise": 0, "strategy": "views", **limits, **asked}
    return Row(
        commit=commit, dirty=False, code=code, config=config, versions={}, machine={}, when="2026-11-23T07:00:00+00:00",
        asked=asked, result=result,
    )  # fmt: skip


def told(row: Row, **result: Any) -> Row:
    """The row with another result."""
    return msgspec.structs.replace(row, result=result)
