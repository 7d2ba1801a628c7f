"""Runs killed at random moments and resumed, against the same runs left alone.

    python benchmarks/resume.py --seeds 100:110 [--kills 2] [--time S] > benchmarks/resume.txt

Each run is ``vsx explore --fast`` in a process of its own, until its mission ends or ``--time`` is over; the same run
again is ended by SIGKILL when its journal has reached a random second of the first, then resumed, as often as asked.
Both ends are compared: coverage, ATE, breaks, collisions. No kill comes in the last minute of ``--time``: what a
resumed run does first is to look for its place.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from vsx_ros.cli.reproduce import seeds
from vsx_ros.io.journal import FrameLine, read_journal

VSX = [sys.executable, "-m", "vsx_ros.cli.main", "explore", "--fast"]
LAST_S = 60.0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=seeds, default=range(10))
    parser.add_argument("--time", type=float, default=1200.0, metavar="S")
    parser.add_argument("--kills", type=int, default=2)
    args = parser.parse_args()
    print(f"{'seed':>4}  {'killed at [s]':20} {'right':>13} {'ATE [m]':>15} {'breaks':>7} {'collisions':>10}  end")
    as_good = 0
    for seed in args.seeds:
        folder = Path(tempfile.mkdtemp(prefix="vsx-resume-"))
        try:
            alone = left_alone(folder / "alone", seed, args.time)
            last = min(alone["duration_s"] - 5.0, args.time - LAST_S)
            moments = np.sort(np.random.default_rng([seed, 9]).uniform(0.5, last, args.kills))
            resumed = killed(folder / "killed", seed, args.time, moments.tolist())
        finally:
            shutil.rmtree(folder)
        as_good += is_as_good(alone, resumed)
        when = " ".join(f"{moment:.1f}" for moment in moments)
        print(f"{seed:4}  {when:20} {compared(alone, resumed)}", flush=True)
    print(f"as good as left alone: {as_good} of {len(args.seeds)} (each pair: left alone, killed and resumed)")


def is_as_good(alone: dict, resumed: dict) -> bool:
    """A run without a map or a way is not, whatever the other one is."""
    if None in (run[key] for run in (alone, resumed) for key in ("coverage_correct", "ate_rmse_m")):
        return False
    return (
        resumed["breaks"] <= alone["breaks"]
        and resumed["collisions"] <= alone["collisions"]
        and resumed["coverage_correct"] >= alone["coverage_correct"] - 0.1
        and resumed["ate_rmse_m"] <= max(0.05, 2.0 * alone["ate_rmse_m"])
    )


def compared(alone: dict, resumed: dict) -> str:
    """What both reached, side by side, and the verdict; a dash is what is not known."""
    forms = (
        ("coverage_correct", ".3f", 5, 5),
        ("ate_rmse_m", ".4f", 8, 6),
        ("breaks", "d", 3, 3),
        ("collisions", "d", 5, 4),
    )
    cells = []
    for key, form, *widths in forms:
        said = ("-" if run[key] is None else format(run[key], form) for run in (alone, resumed))
        cells += [f"{word:>{width}}" for word, width in zip(said, widths)]
    end = f"{'as good' if is_as_good(alone, resumed) else 'worse'}: {resumed['stop_reason']}"
    return " ".join(cells) + f"  {end}"


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
