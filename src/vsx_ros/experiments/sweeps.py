"""What is made of many explorations: a table for each kind of world and planner, and every failure by name."""

from collections.abc import Iterator, Sequence

import numpy as np

from vsx_ros.evaluation.page import Section, csv_text, interval, paragraph, table
from vsx_ros.evaluation.paired import known, mean_interval, share_interval
from vsx_ros.experiments.campaign import Result
from vsx_ros.experiments.exploration import ExplorationTask
from vsx_ros.exploration.decision import Outcome

Runs = Sequence[tuple[ExplorationTask, Result]]
_HEADER = (
    "world, planner", "runs", "known and right", "runs above 90 %", "way to 90 % [m]", "broken runs", "lost for good",
    "collisions", "least clearance [m]", "ATE median, worst [m]", "scale error", "U1", "driven [m]",
)  # fmt: skip


def as_csv(runs: Runs) -> str:
    """A line for each run, every number there is."""
    names = list(dict.fromkeys(name for _, result in runs for name in result))
    header = [*(f"task_{name}" for name in ExplorationTask._fields), *names]
    return csv_text(header, ([*t[:-1], " ".join(t.settings), *(r.get(name) for name in names)] for t, r in runs))


def section(runs: Runs) -> Section:
    """The table and the failures."""
    kinds = dict.fromkeys((task.world, task.planner) for task, _ in runs)
    rows = [
        _row(f"{world}, {planner}", [r for t, r in runs if t[0] == world and t[2] == planner])
        for world, planner in kinds
    ]
    failed = [[task.world, str(task.seed), task.planner, why] for task, result in runs for why in _faults(result)]
    parts = [paragraph("Brackets: 95 % (bootstrap over runs; Wilson for shares of runs)."), table(_HEADER, rows)]
    parts.append(f"<h3>What went wrong: {len(failed)}</h3>")
    parts.append(table(["world", "seed", "planner", "what"], failed) if failed else "")
    return Section("Explorations", "".join(parts))


def _row(name: str, results: list[Result]) -> list[str]:
    done = [result for result in results if "failed" not in result]

    def of(key: str) -> list[float]:
        return [float(result[key]) for result in done if result.get(key) is not None]

    def mean(key: str, form: str) -> str:
        return interval(known(mean_interval, of(key)), form)

    def share(hits: int) -> str:
        return interval(known(share_interval, hits, len(done)))

    right = [result.get("coverage_correct") or 0.0 for result in done]  # without a map nothing is known
    ate = of("ate_rmse_m")
    return [
        name,
        f"{len(done)} of {len(results)}",
        interval(known(mean_interval, right), ".3f"),
        share(sum(value >= 0.9 for value in right)),
        f"{mean('way_to_90_m', '.1f')} ({len(of('way_to_90_m'))} runs)",
        share(sum(value > 0 for value in of("breaks"))),
        share(sum(result.get("stop_reason", "").startswith(Outcome.LOST.value) for result in done)),
        f"{sum(of('collisions')):.0f}",
        f"{min(of('min_clearance_m')):.3f}" if done else "unknown",
        f"{np.median(ate):.3f}, {max(ate):.3f}" if ate else "unknown",
        mean("scale_error", ".4f"),
        mean("u1", ".3f"),
        mean("driven_m", ".1f"),
    ]


def _faults(result: Result) -> Iterator[str]:
    if "failed" in result:
        yield result["failed"]
        return
    if result.get("breaks"):
        yield f"{result['breaks']} breaks; {result['stop_reason']}"
    if result.get("collisions"):
        yield f"{result['collisions']} collisions"
    if (result.get("coverage_correct") or 0.0) < 0.9:
        yield f"{100 * (result.get('coverage_correct') or 0.0):.0f} % known and right; {result['stop_reason']}"
