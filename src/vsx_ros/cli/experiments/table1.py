"""Table 1 and Figures 2 and 6 of the paper from the drives of many worlds."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from vsx_ros.cli.experiments.campaign import Result
from vsx_ros.cli.experiments.drive import ARMS, CONFIG, PHI_RAD_M, DriveTask, Question, plan_of, question
from vsx_ros.cli.experiments.trackers import FULL, PAPER
from vsx_ros.cli.world import open_world
from vsx_ros.evaluation.page import Section, figures, interval, paragraph, table
from vsx_ros.evaluation.paired import known, mean_interval, ratio_interval, share_interval, sign_test
from vsx_ros.evaluation.ways import ways_picture, window_around
from vsx_ros.planning.path import Plan

Drives = Sequence[tuple[DriveTask, Result]]
CONSTRAINED, UNCONSTRAINED, _ = ARMS
_MEASURES = (("u1", "U1", ".3f"), ("u2_frames", "U2 [frames]", ".1f"), ("u2_seconds", "U2 [s]", ".2f"))
_COLUMNS = (
    "u1",
    "u1_until_loss",
    "u2_frames",
    "u2_seconds",
    "tracked_share",
    "losses",
    "broken",
    "held_share",
    "ate_m",
)
_AROUND_M = 1.2


def as_csv(drives: Drives) -> str:
    """A line for each drive and tracker."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    paths = ("path_m", "reverse_m", "turn_on_spot_rad", "duration_s", "ended", "collisions")
    writer.writerow([*DriveTask._fields, "arm", *paths, "tracker", *_COLUMNS])
    for task, result in drives:
        for arm, drive in result.get("arms", {}).items():
            for tracker, judged in drive["trackers"].items():
                row = [*task, arm, *(drive[name] for name in paths), tracker, *(judged[name] for name in _COLUMNS)]
                writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row])
    return text.getvalue()


def numbers(drives: Drives) -> dict[str, Any]:
    """The table as a tree: tracker, dataset, then means, ratios, breaks with intervals and tests."""
    return {
        tracker: {
            name: _compared([result for task, result in drives if task.dataset in datasets], tracker)
            for name, datasets in (("dataset 1", (1,)), ("dataset 2", (2,)), ("both", (1, 2)))
        }
        for tracker in (PAPER, FULL)
    }


def _compared(results: Sequence[Result], tracker: str) -> dict[str, Any]:
    done = [result["arms"] for result in results if "arms" in result]
    tree: dict[str, Any] = {"drives": len(done)}
    for measure, _, _ in _MEASURES:
        of_arm = {arm: [_value(arms, arm, tracker, measure) for arms in done] for arm in ARMS}
        tree[measure] = {arm: known(mean_interval, values) for arm, values in of_arm.items()}
        pair = of_arm[CONSTRAINED], of_arm[UNCONSTRAINED]
        tree[measure]["ratio"] = known(ratio_interval, *pair)
        tree[measure]["chance"] = sign_test(*pair)
    broken = {arm: [int(arms[arm]["trackers"][tracker]["broken"]) for arms in done] for arm in ARMS}
    tree["broken"] = {arm: known(share_interval, sum(hits), len(hits)) for arm, hits in broken.items()}
    tree["broken"]["chance"] = sign_test(broken[UNCONSTRAINED], broken[CONSTRAINED])
    held = {arm: [arms[arm]["trackers"][tracker]["held_share"] for arms in done] for arm in ARMS}
    tree["held_share"] = {arm: known(mean_interval, shares) for arm, shares in held.items()}
    return tree


def _value(arms: dict[str, Any], arm: str, tracker: str, measure: str) -> float:
    """A tracker that never started has tracked nothing."""
    return float(arms[arm]["trackers"][tracker][measure] or 0.0)


def table_section(drives: Drives) -> Section:
    """Table 1, and what it rests on."""
    tree = numbers(drives)
    parts = [paragraph(_PROTOCOL)]
    for tracker, datasets in tree.items():
        parts.append(f"<h3>Tracker {tracker}</h3>")
        rows = []
        for dataset, t in datasets.items():
            for measure, name, form in _MEASURES:
                shown = [interval(t[measure][arm], form) for arm in ARMS]
                ratio, chance = interval(t[measure]["ratio"]), f"{t[measure]['chance']:.2g}"
                rows.append([f"{dataset} ({t['drives']})", name, *shown, ratio, chance])
            shown = [interval(t["broken"][arm]) for arm in ARMS]
            rows.append([f"{dataset} ({t['drives']})", "broken", *shown, "", f"{t['broken']['chance']:.2g}"])
            shown = [interval(t["held_share"][arm]) for arm in ARMS]
            rows.append([f"{dataset} ({t['drives']})", "held until the first loss", *shown, "", ""])
        parts.append(table(["", "", *ARMS, "constrained / unconstrained", "by chance"], rows))
    failed = [[*(str(x) for x in task), result["failed"]] for task, result in drives if "failed" in result]
    parts.append(f"<h3>Failures: {len(failed)} of {len(drives)}</h3>")
    parts.append(table([*DriveTask._fields, "why"], failed) if failed else "")
    return Section("Table 1: constrained against unconstrained trajectories", "".join(parts))


def figure2_section(tasks: Sequence[DriveTask]) -> Section:
    """The paths themselves, with where the camera looks along them."""
    pictures = []
    for task in tasks:
        asked = question(task, open_world(task.world, task.seed), CONFIG)
        for arm in ARMS[:2]:
            plan = plan_of(arm, asked, CONFIG)
            assert isinstance(plan, Plan)
            way = plan.path.sample(0.05)[:, :3].tolist()
            views = plan.path.sample(0.25)[:, :3].tolist()
            caption = (
                f"{task.world} {task.seed}, dataset {task.dataset}, {arm}: {plan.path.length_m:.1f} m, "
                f"{plan.path.reverse_m:.1f} m of it in reverse, {plan.path.turn_on_spot_rad:.1f} rad on the spot"
            )
            pictures.append((caption, _picture(asked, [("planned", way)], [], views)))
    words = "Dot: start. Ring: goal. Strokes: where the camera looks; to turn under its bound the robot backs up."
    return Section("Figure 2: unconstrained and constrained trajectories", paragraph(words) + figures(pictures))


def figure6_section(drives: Drives) -> Section:
    """Planned way and what the paper's tracker says, until it breaks."""
    pictures = []
    for task, result in [drive for drive in drives if "arms" in drive[1]]:
        asked = question(task, open_world(task.world, task.seed), CONFIG)
        for arm in ARMS[:2]:
            drive = result["arms"][arm]
            estimate = drive["trackers"][PAPER]["estimate"]
            before = [(a, b) for a, b in zip(estimate, estimate[1:]) if a is not None and b is None]
            marks = [("broke", a) for a, _ in before]
            ways = [("driven", drive["driven"]), ("planned", drive["planned"]), ("estimate", estimate)]
            state = "broken" if drive["trackers"][PAPER]["broken"] else "unbroken"
            caption = f"{task.world} {task.seed}, dataset {task.dataset}, {arm}: {state}"
            pictures.append((caption, _picture(asked, ways, marks, [])))
    words = "Blue: planned. Green: the camera as tracked (9 cm behind the base's middle). Purple: where it was lost."
    return Section("Figure 6: planned and tracked trajectories", paragraph(words) + figures(pictures))


def _picture(asked: Question, ways: Any, marks: Any, views: Any) -> str:
    ends = [("start", (asked.start.x, asked.start.y)), ("goal", (asked.goal.x, asked.goal.y))]
    return ways_picture(asked.grid, ways, [*ends, *marks], views, window=window_around(ways, _AROUND_M))


_PROTOCOL = (
    "Each row: the drives of several worlds to a goal that looks to the side (dataset 1: 60 to 110 deg) or back "
    "(dataset 2: 150 to 180 deg), planned in the true map, driven on the wheels' odometry. Constrained: change of view "
    f"at most {PHI_RAD_M:g} rad/m. Unconstrained: shortest way, turns on the spot at 52 deg/s; or at 17 deg/s, at "
    "which no image is smeared. U1: points found of those searched, a lost frame counts 0; U2: how long a point is "
    "tracked, of points found at least three times. Broken: lost at the end, or wrong by more than 15 cm rms, or "
    "jumped against the wheels. Brackets: 95 % (bootstrap over drives; Wilson for shares). By chance: sign test, "
    "McNemar for breaks. "
    "As in the paper: visual motion model, no wheels, a keyframe at most every 20 frames of 30 Hz and never for a turn."
)
