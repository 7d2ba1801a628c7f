"""Makes tables of explorations from their rows."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from vsx_ros.evaluation.paired import mean_interval
from vsx_ros.experiments.rows import Row

Runs = Sequence[Row]
_UNTIL = "90"
_Choice = Callable[[Sequence[float]], float]


def runs(rows: Runs) -> list[str]:
    """One line per run. Shares on the way to the last one are left out where no run knows them, as live."""
    known = {level for row in rows for level in row.result.get("reached", {})}
    levels = [*(level for level in ("50", "70", "80") if level in known), _UNTIL]
    head = ("world", "noise", *(f"L{level}" for level in levels), "seconds", "lost", "breaks",
            "contacts", "least clearance", "ATE")  # fmt: skip
    lines = header(head)
    for row in sorted(rows, key=lambda row: (row.asked["world"], row.asked["noise"], row.asked["seed"])):
        run = row.result
        if "failed" in run:
            lines.append(f"| {row.asked['seed']} | {row.asked['noise']} | {run['failed']} |" + " |" * (len(head) - 3))
            continue
        reached = _reached(run)
        ways = (shown(reached.get(level, [None])[0], ".0f") for level in levels)
        least_cm, ate_cm = _cm(run["min_clearance_m"]), _cm(run["ate_rmse_m"])
        cells = (
            row.asked["seed"], row.asked["noise"], *ways, shown(reached.get(_UNTIL, [0, None])[1], ".0f"),
            run["times_lost"], shown(run["breaks"], "d"), shown(run["collisions"], "d"),
            f"{shown(least_cm, '.0f')} cm", f"{shown(ate_cm, '.1f')} cm",
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def strategies(rows: Runs) -> list[str]:
    """Medians and ratios of the ways to 90 %, then one line per world."""
    found = {(row.asked["strategy"], row.asked["seed"]): row.result for row in rows}
    asked = dict.fromkeys(strategy for strategy, _ in found)
    lines = header(("world", *(f"{s}: {name}" for s in asked for name in ("L70", "L90", "seconds", "contacts"))))
    for seed in sorted({seed for _, seed in found}):
        cells = []
        for strategy in asked:
            run = found.get((strategy, seed), {})
            if "failed" in run:
                cells += [f"failed: {run['failed']}", *3 * [""]]
                continue
            ways = (shown(run.get("reached", {}).get(level, [None])[0], ".0f") for level in ("70", _UNTIL))
            cells += [*ways, shown(run.get("duration_s"), ".0f"), shown(run.get("collisions"), "d")]
        lines.append(f"| {seed} | " + " | ".join(cells) + " |")
    ways = {
        strategy: {seed: run["reached"][_UNTIL][0] for (of, seed), run in found.items()
                   if of == strategy and _UNTIL in run.get("reached", {})}
        for strategy in asked
    }  # fmt: skip
    told = [f"{name} {'{} ({})'.format(*_worst(list(of.values()), '.0f'))} of {len(of)}" for name, of in ways.items()]
    summary = [f"- L90, median (worst): {', '.join(told)}"]
    for other in list(asked)[1:]:
        views, of = ways[next(iter(asked))], ways[other]
        ratio = mean_interval([math.log(views[seed] / of[seed]) for seed in sorted(views.keys() & of.keys())])
        if ratio is not None and ratio.low is not None and ratio.high is not None:
            value, low, high = map(math.exp, ratio)
            summary.append(
                f"- L90 of {next(iter(asked))} / {other}, geometric mean: {value:.2f} [{low:.2f}, {high:.2f}]"
            )
    return [*summary, "", *lines]


def totals(rows: Runs) -> list[str]:
    """Results over all runs, with this project's own requirements."""
    lines = header((*_of(rows), "measured", "must", "aim"))
    for name, (median, worst), must, aim in _figures(rows):
        spread = ", median (worst)" if median and worst else ""
        lines.append(f"| {name}{spread} | {_both((median, worst))} | {must} | {aim} |")
    return lines


def brief(rows: Runs) -> list[str]:
    """The same without the requirements."""
    lines = header((*_of(rows), "measured: median (worst)"))
    return lines + [f"| {name} | {_both(of)} |" for name, of, _, _ in _figures(rows)]


def _both(of: tuple[str, str]) -> str:
    """Median and worst; of a number of runs that alone."""
    return "{} ({})".format(*of) if all(of) else "".join(of)


def _of(rows: Runs) -> list[str]:
    worlds = {(row.asked["world"], row.asked["seed"]) for row in rows}
    return [f"of {len(rows)} runs in {len(worlds)} worlds"]


def _reached(run: dict[str, Any]) -> dict[str, list[float]]:
    """Metres and seconds until each share. A live run that ended because enough was known has reached its share, even
    if its last map knows a little less."""
    enough = run["stop_reason"] == f"{_UNTIL} % is known"
    return ({_UNTIL: [run["driven_m"], run["duration_s"]]} if enough else {}) | run["reached"]


def _figures(rows: Runs) -> list[tuple[str, tuple[str, str], str, str]]:
    """Name, median and worst, must, aim. What not all runs have left is told with the number of those that did."""
    done = [row.result for row in rows if "failed" not in row.result]
    ends = [reached[_UNTIL] for run in done if _UNTIL in (reached := _reached(run))]

    def spread(values: Sequence[float], form: str, worst: _Choice = max) -> tuple[str, str]:
        median, least_or_most = _worst(values, form, worst)
        return median, least_or_most + of_known(values, rows)

    def of(key: str, scale: float, form: str) -> tuple[str, str]:
        return spread([abs(scale * run[key]) for run in done if run[key] is not None], form)

    def counted(runs: Sequence[Any], key: str, happened: Callable[[Any], bool] = bool) -> tuple[str, str]:
        return "", f"{sum(happened(run[key]) for run in runs)}{of_known(runs, rows)}"

    with_slam = [run for run in done if run["breaks"] is not None]  # the SLAM of the others left no results
    touching = [run for run in done if run["collisions"] is not None]
    gaps_cm = [100 * run["min_clearance_m"] for run in done if run["min_clearance_m"] is not None]
    speeds = [way_m / seconds for way_m, seconds in ends]
    faces = [100 * run["occupied_recall"] for run in done if run.get("occupied_recall") is not None]
    surface = [("visible surface of obstacles that is on the map [%]", spread(faces, ".0f", min), "", "")] * bool(faces)
    return [
        (f"runs that reach {_UNTIL} % correct coverage", (str(len(ends)), ""), str(len(rows)), str(len(rows))),
        ("metres until then", spread([way_m for way_m, _ in ends], ".0f"), "50 (72)", "42 (60)"),
        ("minutes until then", spread([seconds / 60 for _, seconds in ends], ".1f"), "4.7", "3"),
        ("mean speed until then [m/s]", spread(speeds, ".3f", min), "0.200", "0.250"),
        *surface,
        ("ATE without scale alignment [cm]", of("ate_rmse_m", 100, ".1f"), "10 (25)", "5 (12)"),
        ("scale error [%]", of("scale_error", 100, ".1f"), "2", "1"),
        ("runs with unrecovered breaks", counted(with_slam, "breaks"), "0", "0"),
        ("runs that began a second map", counted(with_slam, "slam", lambda events: "second map" in events), "", ""),
        ("runs that touched something", counted(touching, "collisions"), "0", "0"),
        ("least distance to anything [cm]", ("", spread(gaps_cm, ".0f", min)[1]), "5", "7"),
    ]


def growth(rows: Runs) -> list[str]:
    """Cost of a decision: one line per quarter of the decisions of all runs of a world, by known ground."""
    lines = header(
        ("world", "known ground [m2]", "keyframes", "decisions", "median [ms]", "slowest [ms]", "memory [MB]")
    )
    for world in sorted({row.asked["world"] for row in rows}):
        made = [one for row in rows if row.asked["world"] == world for one in row.result.get("decisions", [])]
        decisions = np.array(made, float).reshape(-1, 4)
        for part in np.array_split(decisions[np.argsort(decisions[:, 0])], 4):
            if len(part):
                lines.append(
                    f"| {world} | {part[0, 0]:.0f} to {part[-1, 0]:.0f} | up to {part[:, 1].max():.0f} | {len(part)} | "
                    f"{np.median(part[:, 2]):.0f} | {part[:, 2].max():.0f} | {part[:, 3].max():.0f} |"
                )
    return lines


def resumed(rows: Runs) -> list[str]:
    """Undisturbed runs compared with the same runs killed and resumed."""
    alone, killed = ([row.result[which] for row in rows if which in row.result] for which in ("alone", "resumed"))
    lines = header(("", "left alone", "killed and resumed", "must"))

    def line(name: str, key: str, form: str, worst: _Choice, must: str = "") -> None:
        cells = []
        for which in (alone, killed):
            known = [100 * run[key] for run in which if run[key] is not None]
            median, least_or_most = _worst(known, form, worst)
            cells.append(f"{median} ({least_or_most}){of_known(known, rows)}")
        lines.append(f"| {name} | {' | '.join(cells)} | {must} |")

    line(f"known and right at the end [%], median of {len(rows)} (least)", "coverage_correct", ".1f", min)
    line("ATE [cm], median (worst)", "ate_rmse_m", ".1f", max)
    counts = [
        f"{sum(run['breaks'] for run in which)}, {sum(run['collisions'] for run in which)}{of_known(which, rows)}"
        for which in (alone, killed)
    ]
    lines.append(f"| breaks, contacts | {counts[0]} | {counts[1]} | |")
    seen = [row.result for row in rows if "missed" in row.result]  # in older rows killed_s is when they were to be
    if seen:
        kills, missed = sum(len(each["killed_s"]) for each in seen), sum(each["missed"] for each in seen)
        lines.append(f"| kills seen, runs begun again that ended before | | {kills}, {missed} | |")
    good = sum(row.result.get("as_good", False) for row in rows)
    lines.append(f"| as good as left alone | | {good} of {len(rows)} | {len(rows)} of {len(rows)} |")
    return lines


def header(names: Sequence[str]) -> list[str]:
    """The first two lines of a table."""
    return ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]


def _worst(values: Sequence[float], form: str, worst: _Choice = max) -> tuple[str, str]:
    """Median and worst."""
    return (format(np.median(values), form), format(worst(values), form)) if values else ("-", "-")


def of_known(known: Sequence[Any], runs: Sequence[Any]) -> str:
    """What follows a figure of some of the runs: of how many; empty for all of them."""
    return "" if len(known) == len(runs) else f" of {len(known)} known"


def _cm(metres: float | None) -> float | None:
    return None if metres is None else 100 * metres


def shown(value: float | None, form: str) -> str:
    """Unknown values become a dash."""
    return "-" if value is None else format(value, form)
