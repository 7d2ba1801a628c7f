"""Figures 2, 3 and 6 of the paper: both planners' paths to the same goals, favourable states, and tracked paths."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vsx_ros.errors import InputError
from vsx_ros.evaluation.page import Section, figures, paragraph, table
from vsx_ros.evaluation.sheet import Way, window_around
from vsx_ros.evaluation.svg import FIGURE_PX, map_view, plot
from vsx_ros.experiments.drive import (
    CONFIG,
    CONSTRAINED,
    UNCONSTRAINED,
    DriveTask,
    Question,
    plan_of,
    question,
    shape_of,
)
from vsx_ros.experiments.table1 import Drives, faults, faults_table
from vsx_ros.experiments.trackers import PAPER
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.joint_qp import connect
from vsx_ros.planning.path import Path, Plan
from vsx_ros.planning.two_level_qp import connect_paper
from vsx_ros.runs.world import open_world
from vsx_ros.sim.truth import gap_to_walls

_AROUND_M = 1.2  # margin around the drawn paths
_PHI_RAD_M = CONFIG.planner.phi_rad_m  # of every drive


def figure2(world: str, seed: int) -> tuple[Section, dict[str, Any]]:
    """The paths with the camera's viewing direction along them, and their properties. A dataset without a goal is
    listed."""
    pictures, failed, rows = [], [], []
    for task in [DriveTask(world, seed, 0, dataset) for dataset in (1, 2)]:
        try:
            asked = question(task, open_world(task.world, task.seed), CONFIG)
        except InputError as error:
            failed.append([*(str(value) for value in task), "all", str(error)])
            continue
        for arm in (CONSTRAINED, UNCONSTRAINED):
            plan = plan_of(arm, asked, CONFIG)
            assert isinstance(plan, Plan)
            way = plan.path.sample(0.05)[:, :3].tolist()
            views = plan.path.sample(0.25)[:, :3].tolist()
            shape = shape_of(plan.path)
            lengths = "{path_m:.1f} m, {reverse_m:.1f} m of it in reverse, {turn_on_spot_rad:.1f} rad on the spot"
            caption = f"{task.world} {task.seed}, dataset {task.dataset}, {arm}: {lengths.format(**shape)}"
            rows.append({**task._asdict(), "planner": arm, **shape})
            pictures.append((caption, _picture(asked, [("planned", way)], [], views)))
    words = "Dot: start. Ring: goal. Strokes: where the camera looks; to turn under its bound the robot backs up."
    body = paragraph(words) + figures(pictures) + faults_table(failed)
    return Section("Figure 2: unconstrained and constrained trajectories", body), {"drives": rows}


def figure6(drives: Drives) -> tuple[Section, dict[str, Any]]:
    """The planned path and the paper's tracker's estimate, with gaps where it was lost; and the deviation of all
    trackers' estimates from the planned path."""
    pictures, rows = [], []
    for task, result in [drive for drive in drives if "arms" in drive[1]]:
        asked = question(task, open_world(task.world, task.seed), CONFIG)
        for arm in (CONSTRAINED, UNCONSTRAINED):
            drive = result["arms"][arm]
            estimate = drive["trackers"][PAPER]["estimate"]
            before = [(a, b) for a, b in zip(estimate, estimate[1:]) if a is not None and b is None]
            marks = [("broke", a) for a, _ in before]
            ways = [("driven", drive["driven"]), ("planned", drive["planned"]), ("estimate", estimate)]
            state = "broken" if drive["trackers"][PAPER]["broken"] else "unbroken"
            caption = f"{task.world} {task.seed}, dataset {task.dataset}, {arm}: {state}"
            pictures.append((caption, _picture(asked, ways, marks, [])))
            for tracker, judged in drive["trackers"].items():
                named = {**task._asdict(), "planner": arm, "tracker": tracker, "broken": judged["broken"]}
                rows.append({**named, **deviation(drive["planned"], judged["estimate"])})
    words = "Blue: planned. Green: the camera as tracked (9 cm behind the base's middle). Purple: where it was lost."
    told = "From each tracked point to the nearest one of the planned path:"
    body = paragraph(words) + figures(pictures) + paragraph(told) + _deviations(rows) + faults_table(faults(drives))
    return Section("Figure 6: planned and tracked trajectories", body), {"drives": rows}


def deviation(planned: Sequence[Sequence[float]], estimate: Sequence[Sequence[float] | None]) -> dict[str, Any]:
    """The deviation of the camera's tracked path from its planned one: rms_m and max_m of the distances from tracked
    points to the planned path, None if nothing was tracked, and tracked_share. planned: x, y, theta of the base.
    estimate: x, y of the camera, None where it was lost."""
    tracked = np.array([point[:2] for point in estimate if point is not None]).reshape(-1, 2)
    share = len(tracked) / len(estimate) if estimate else 0.0
    if not len(tracked):
        return {"rms_m": None, "max_m": None, "tracked_share": share}
    x, y, theta = np.array(planned).T
    mount = CONFIG.robot.mount
    c, s = np.cos(theta), np.sin(theta)
    camera = np.column_stack([x + c * mount.forward_m - s * mount.left_m, y + s * mount.forward_m + c * mount.left_m])
    far = gap_to_walls(np.hstack([camera, np.vstack([camera[1:], camera[-1:]])]), tracked)
    return {"rms_m": float(np.sqrt(np.mean(far**2))), "max_m": float(far.max()), "tracked_share": share}


def _deviations(rows: Sequence[dict[str, Any]]) -> str:
    shown = []
    for row in rows:
        drive = "{world} {seed}, dataset {dataset}, {planner}".format(**row)
        off_cm = ["unknown" if row[name] is None else f"{100 * row[name]:.1f}" for name in ("rms_m", "max_m")]
        broken = "yes" if row["broken"] else "no"
        shown.append([drive, row["tracker"], *off_cm, f"{100 * row['tracked_share']:.0f}", broken])
    return table(["drive", "tracker", "rms [cm]", "at most [cm]", "tracked [%]", "broken"], shown)


def _picture(asked: Question, ways: Any, marks: Any, views: Any) -> str:
    ends = [("start", (asked.start.x, asked.start.y)), ("goal", (asked.goal.x, asked.goal.y))]
    window = window_around([way for _, way in ways], _AROUND_M)
    return map_view(asked.grid, ways, window, marks=[*ends, *marks], views=views)


_PLACE = (2.0, 1.5)  # position of the goal [m]
_HEADINGS_DEG, _SHOWN_EVERY = range(0, 181, 5), 6  # headings of the goal; every sixth is drawn
_PLACES, _NEAR_M, _FAR_M = 100, 1.0, 3.0  # number and distances of random places ahead


def figure3(seed: int) -> tuple[Section, dict[str, Any]]:
    """The section, and its numbers. seed: of the random places for the shares."""
    rng = np.random.default_rng(seed)
    bearings, distances = rng.uniform(0.0, math.pi / 2, _PLACES), rng.uniform(_NEAR_M, _FAR_M, _PLACES)
    places = np.column_stack([distances * np.cos(bearings), distances * np.sin(bearings)]).tolist()
    rows, ways, views = [], list[tuple[str, Way]](), []
    for heading in _HEADINGS_DEG:
        goal = SE2(*_PLACE, math.radians(heading))
        segment, default = connect_paper(SE2(), goal, _PHI_RAD_M), connect(SE2(), goal, _PHI_RAD_M)
        lengths_m = [way.length_m if isinstance(way, Path) else math.nan for way in (segment, default)]
        led = [isinstance(connect_paper(SE2(), SE2(x, y, goal.theta), _PHI_RAD_M), Path) for x, y in places]
        rows.append([float(heading), *lengths_m, sum(led) / _PLACES])
        if heading % (_SHOWN_EVERY * _HEADINGS_DEG.step) == 0:
            name, way = ("planned", segment) if isinstance(segment, Path) else ("driven", default)
            if isinstance(way, Path):
                ways.append((name, way.sample(0.02)[:, :2].tolist()))
            views.append((*_PLACE, goal.theta))
    x, segment_m, default_m, share = np.array(rows).T
    window = window_around([way for _, way in ways], 0.6)
    ends = [("start", (0.0, 0.0)), ("goal", _PLACE)]
    lengths, size = [("first", x, segment_m), ("second", x, default_m)], (FIGURE_PX, 260.0)
    pictures = [
        ("to one place with several headings", map_view(None, ways, window, marks=ends, views=views)),
        ("length [m] over heading", plot(lengths, "m", math.ceil(np.nanmax(default_m)), unit="deg", size=size)),
        (f"share of {_PLACES} places ahead, {_NEAR_M:g} to {_FAR_M:g} m away, to which one segment leads, over heading",
         plot([("first", x, share)], "share", unit="deg", size=size)),
    ]  # fmt: skip
    words = (
        f"No obstacles; change of view at most {_PHI_RAD_M:g} rad/m. Blue: one segment of the two-level optimisation "
        "(4.2, 4.3), where there is one. Dashed, and red in the curves: the default planner, which answers everywhere. "
        "A segment turns one way only, so the heading has to differ by more than the place's bearing: that makes it "
        "favourable. More than that makes it longer again."
    )
    names = ("heading_deg", "segment_m", "default_m", "share")
    numbers = [{name: None if math.isnan(value) else value for name, value in zip(names, row)} for row in rows]
    return Section("Figure 3: favourable states", paragraph(words) + figures(pictures)), {"rows": numbers}
