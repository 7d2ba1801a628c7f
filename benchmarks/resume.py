"""Runs that are killed at random moments and resumed, compared with undisturbed runs.

    python benchmarks/resume.py --seeds 100:110 [--kills 2] [--time S] [--out FILE]

Each run is ``vsx explore --fast`` in a separate process, until its mission ends or ``--time`` is over. A second run is
killed (SIGKILL) when its journal has reached a random second of the first, then resumed, as often as asked. The final
coverage, ATE, breaks and collisions are compared. Each pair writes a row, and benchmarks/tables.py makes the table.
There is no kill in the last minute of ``--time``, because a resumed run must first find its place.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tables import RESULTS, rooms_of

from vsx_ros.cli.option_values import seeds
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.runs.journal import FrameLine, read_journal

VSX = [sys.executable, "-m", "vsx_ros.cli.main", "explore", "--fast"]
LAST_S = 60.0
KEPT = ("coverage_correct", "ate_rmse_m", "breaks", "collisions", "stop_reason")


class Pair(NamedTuple):
    """An undisturbed run, and the same run killed and resumed."""

    seed: int
    time_s: float
    kills: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds, default=range(10))
    parser.add_argument("--time", type=float, default=1200.0, metavar="S")
    parser.add_argument("--kills", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULTS / "resume.jsonl")
    args = parser.parse_args()
    store = Store(args.out, rooms=rooms_of("resume"))
    run_campaign([Pair(seed, args.time, args.kills) for seed in args.seeds], both, store, Engine())


def both(pair: Pair) -> dict[str, Any]:
    """Results of both runs."""
    with tempfile.TemporaryDirectory(prefix="vsx-resume-") as folder:
        alone = left_alone(Path(folder) / "alone", pair.seed, pair.time_s)
        last = min(alone["duration_s"] - 5.0, pair.time_s - LAST_S)
        moments = np.sort(np.random.default_rng([pair.seed, 9]).uniform(0.5, last, pair.kills))
        resumed = killed(Path(folder) / "killed", pair.seed, pair.time_s, moments.tolist())
    ends = {which: {name: run[name] for name in KEPT} for which, run in (("alone", alone), ("resumed", resumed))}
    return {"killed_s": moments.round(1).tolist(), "as_good": is_as_good(alone, resumed), **ends}


def is_as_good(alone: dict, resumed: dict) -> bool:
    """Not worse beyond the usual difference of two runs with other noise. False if either run lacks a map or a path."""
    if None in (run[key] for run in (alone, resumed) for key in ("coverage_correct", "ate_rmse_m")):
        return False
    return (
        resumed["breaks"] <= alone["breaks"]
        and resumed["collisions"] <= alone["collisions"]
        and resumed["coverage_correct"] >= alone["coverage_correct"] - 0.1
        and resumed["ate_rmse_m"] <= max(0.05, 2.0 * alone["ate_rmse_m"])
    )


def left_alone(out: Path, seed: int, time_s: float) -> dict:
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([*VSX, "--seed", str(seed), "--time", str(time_s), "--out", str(out)], check=False, **quiet)
    return json.loads((out / "summary.json").read_text())


def killed(out: Path, seed: int, time_s: float, moments: list[float]) -> dict:
    command = [*VSX, "--seed", str(seed), "--time", str(time_s), "--out", str(out)]
    for moment in moments:
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            while run.poll() is None and reached(out) < moment:
                time.sleep(0.5)
            if run.poll() is None:
                os.kill(run.pid, signal.SIGKILL)
        command = [*VSX, "--resume", str(out)]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)
    return json.loads((out / "summary.json").read_text())


def reached(out: Path) -> float:
    frames = [line for line in read_journal(out / "resume" / "journal.jsonl") if isinstance(line, FrameLine)]
    return frames[-1].stamp_ns * 1e-9 if frames else 0.0


if __name__ == "__main__":
    main()
