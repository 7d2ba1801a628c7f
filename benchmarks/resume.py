"""Runs that are killed at random moments and resumed, compared with undisturbed runs.

    python benchmarks/resume.py --seeds 100:110 [--kills 2] [--time S] [--out FILE]

Each run is ``vsx explore --fast`` in a separate process, until its mission ends or ``--time`` is over. A second run is
killed (SIGKILL) when its journal has reached a random second of the first, and a resumed one has added to it; then it
is resumed, as often as asked. If it ends by itself before, it begins again with other moments; if that happens too
often, the pair has failed. The final coverage, ATE, breaks and collisions are compared. Each pair writes a row: with
the moments, the seconds that the journal had reached at each kill, and how often it was begun in vain.
benchmarks/tables.py makes the table. There is no kill in the last minute of ``--time``, because a resumed run must
first find its place.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tables import RESULTS, rooms_of

from vsx_ros.cli.option_values import seeds
from vsx_ros.errors import InputError
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.runs.journal import FrameLine, read_journal

VSX = [sys.executable, "-m", "vsx_ros.cli.main", "explore", "--fast"]
LAST_S, POLL_S = 60.0, 0.5
TRIES = 3  # with other moments each
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
        last, rng = min(alone["duration_s"] - 5.0, pair.time_s - LAST_S), np.random.default_rng([pair.seed, 9])
        for missed in range(TRIES):
            moments = np.sort(rng.uniform(0.5, last, pair.kills)).tolist()
            resumed, kills = killed(Path(folder) / f"killed{missed}", pair.seed, pair.time_s, moments)
            if len(kills) == pair.kills:
                break
        else:
            raise InputError(f"{TRIES} times the run ended by itself before it was killed {pair.kills} times")
    ends = {which: {name: run[name] for name in KEPT} for which, run in (("alone", alone), ("resumed", resumed))}
    at = {name: np.round(times, 1).tolist() for name, times in (("planned_s", moments), ("killed_s", kills))}
    return {**at, "missed": missed, "as_good": is_as_good(alone, resumed), **ends}


def is_as_good(alone: dict, resumed: dict) -> bool:
    """Not worse beyond the usual difference of two runs with other noise: 10 points of coverage; 5 cm ATE, or twice as
    much as alone if that is more. False if either run lacks a map or a path."""
    if None in (run[key] for run in (alone, resumed) for key in ("coverage_correct", "ate_rmse_m")):
        return False
    return (
        resumed["breaks"] <= alone["breaks"]
        and resumed["collisions"] <= alone["collisions"]
        and resumed["coverage_correct"] >= alone["coverage_correct"] - 0.1
        and resumed["ate_rmse_m"] <= max(0.05, 2.0 * alone["ate_rmse_m"])
    )


def left_alone(out: Path, seed: int, time_s: float) -> dict:
    return finished(out, begun(out, seed, time_s))


def begun(out: Path, seed: int, time_s: float) -> list[str]:
    return [*VSX, "--seed", str(seed), "--time", str(time_s), "--out", str(out)]


def killed(out: Path, seed: int, time_s: float, moments: Sequence[float]) -> tuple[dict, list[float]]:
    """Its results, and the seconds that its journal had reached at each kill: fewer than moments if it ended before."""
    command, kills = begun(out, seed, time_s), list[float]()
    for moment in moments:
        if not is_killed(command, out, moment):
            return {}, kills
        kills.append(reached(out))
        command = [*VSX, "--resume", str(out)]
    return finished(out, command), kills


def is_killed(command: Sequence[str], out: Path, moment: float) -> bool:
    """Run it, and kill it when it has added to the journal and the journal has reached the moment [s]. False if it came
    to its end before. Raises InputError if it ended otherwise."""
    before = reached(out)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        while run.poll() is None and ((now := reached(out)) < moment or now <= before):
            time.sleep(POLL_S)
        run.kill()
        said = run.communicate()[1]
    has_ended = (out / "summary.json").exists()
    if run.returncode != -signal.SIGKILL and not has_ended:
        raise InputError(ending(run.returncode, said))
    return not has_ended


def finished(out: Path, command: Sequence[str]) -> dict:
    """The summary of a run that comes to its end. Raises InputError if it leaves none."""
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if not (out / "summary.json").exists():
        raise InputError(ending(done.returncode, done.stderr))
    return json.loads((out / "summary.json").read_text())


def ending(code: int, said: str) -> str:
    """How a run ended that has no results."""
    return f"a run ended with code {code}: {['no words', *said.splitlines()][-1]}"


def reached(out: Path) -> float:
    """The stamp of the newest frame in the journal [s]; 0 without one."""
    frames = [line for line in read_journal(out / "resume" / "journal.jsonl") if isinstance(line, FrameLine)]
    return frames[-1].stamp_ns * 1e-9 if frames else 0.0


if __name__ == "__main__":
    main()
