"""Table 1 of the paper from the drives of many worlds."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from vsx_ros import __version__
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.evaluation.page import Section, csv_text, interval, paragraph, table
from vsx_ros.evaluation.paired import Interval, group_means, mean_interval, ratio_interval, share_interval, sign_test
from vsx_ros.experiments.campaign import Result
from vsx_ros.experiments.drive import ARMS, CONSTRAINED, PHI_RAD_M, DriveTask
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS

Drives = Sequence[tuple[DriveTask, Result]]
Column = list[float | None]
OTHERS = [arm for arm in ARMS if arm != CONSTRAINED]
HEADER = ["", *ARMS, *(words for arm in OTHERS for words in (f"{CONSTRAINED} / {arm}", "by chance"))]
_PATH = ("path_m", "reverse_m", "turn_on_spot_rad", "duration_s", "ended", "collisions")
_COLUMNS = (
    "u1", "u1_until_loss", *U2_READINGS, "u2_seconds", "tracked_share", "losses", "broken", "held_share", "ate_m"
)  # fmt: skip


class _Measure(NamedTuple):
    """missing: the value for a drive without one; None leaves the drive out. is_share: a share of drives, without a
    ratio, because the divisor may be zero."""

    key: str
    name: str
    form: str
    missing: float | None = 0.0  # a tracker that never started has tracked nothing
    is_share: bool = False


_MEASURES = (
    _Measure("u1", "U1", ".3f"),
    *(_Measure(key, f"U2 [frames]: {words}", ".1f") for key, words in U2_READINGS.items()),
    _Measure("u2_seconds", "U2 [s]", ".2f"),
    _Measure("broken", "broken", ".2f", is_share=True),
    _Measure("held_share", "held until the first loss", ".2f"),
    _Measure("ate_m", "ATE [m]", ".3f", None),
)


def as_csv(drives: Drives) -> str:
    """One line per drive and tracker."""
    rows = [
        [*task, arm, *(drive[name] for name in _PATH), tracker, *(judged[name] for name in _COLUMNS), __version__]
        for task, result in drives
        for arm, drive in driven(result).items()
        for tracker, judged in drive["trackers"].items()
    ]
    return csv_text([*DriveTask._fields, "arm", *_PATH, "tracker", *_COLUMNS, "version"], rows)


def driven(result: Result) -> dict[str, dict[str, Any]]:
    """The drives of the arms that found a path."""
    return {arm: drive for arm, drive in result.get("arms", {}).items() if "refused" not in drive}


def numbers(drives: Drives) -> dict[str, Any]:
    """The table as a tree: tracker, dataset, measure, then means, and the constrained planner against each other one.
    Each world counts once."""
    return {
        tracker: {
            name: _compared([drive for drive in drives if drive[0].dataset in datasets], tracker)
            for name, datasets in (("dataset 1", (1,)), ("dataset 2", (2,)), ("both", (1, 2)))
        }
        for tracker in (PAPER, FULL)
    }


def _compared(drives: Drives, tracker: str) -> dict[str, Any]:
    done = [((task.world, task.seed), driven(result)) for task, result in drives if "arms" in result]
    worlds = [world for world, _ in done]
    tree: dict[str, Any] = {"drives": len(done), "worlds": len(set(worlds))}
    for measure in _MEASURES:
        of_arm = {arm: [_value(arms.get(arm), tracker, measure) for _, arms in done] for arm in ARMS}
        pairs = {arm: _by_world(worlds, of_arm[CONSTRAINED], of_arm[arm]) for arm in OTHERS}
        tree[measure.key] = {
            **{arm: _mean(_by_world(worlds, of_arm[arm])[0], measure) for arm in ARMS},
            "known": {arm: sum(value is not None for value in of_arm[arm]) for arm in ARMS},
            "ratio": {arm: None if measure.is_share else ratio_interval(*pair) for arm, pair in pairs.items()},
            "chance": {arm: sign_test(*pair) for arm, pair in pairs.items()},
        }
    return tree


def _value(drive: dict[str, Any] | None, tracker: str, measure: _Measure) -> float | None:
    """None also if there was no path."""
    if drive is None:
        return None
    value = drive["trackers"][tracker][measure.key]
    return measure.missing if value is None else float(value)


def _by_world(worlds: Sequence[tuple[str, int]], *columns: Column) -> list[list[float]]:
    """Each column's means, one per world, over the drives with values in every column."""
    rows = [(world, row) for world, *row in zip(worlds, *columns, strict=True) if None not in row]
    of_rows = [world for world, _ in rows]
    return [group_means(of_rows, [row[k] for _, row in rows]) for k in range(len(columns))]


def _mean(of_worlds: list[float], measure: _Measure) -> Interval | None:
    return share_interval(sum(of_worlds), len(of_worlds)) if measure.is_share else mean_interval(of_worlds)


def faults(drives: Drives) -> list[list[str]]:
    """One row per problem: tasks that failed, planners without a path, and drives that did not arrive or collided.
    Such drives still count."""
    rows = []
    for task, result in drives:
        named = [str(value) for value in task]
        if "failed" in result:
            rows.append([*named, "all", result["failed"]])
        for arm, drive in result.get("arms", {}).items():
            if "refused" in drive:
                rows.append([*named, arm, f"no path: {drive['refused']}"])
                continue
            if drive["ended"] != FollowStatus.ARRIVED.value:
                rows.append([*named, arm, _ENDED.get(drive["ended"], drive["ended"])])
            if drive["collisions"]:
                rows.append([*named, arm, f"{drive['collisions']} collisions"])
    return rows


def faults_table(rows: Sequence[Sequence[str]]) -> str:
    """The problems as a table."""
    return table([*DriveTask._fields, "planner", "what"], rows)


def table_section(drives: Drives) -> Section:
    """Table 1, its protocol and its problems."""
    tree = numbers(drives)
    counts = (f"{dataset}, {t['drives']} drives in {t['worlds']} worlds" for dataset, t in tree[PAPER].items())
    parts = [paragraph(_PROTOCOL), paragraph(f"Of each planner: {'; '.join(counts)}.")]
    for tracker, datasets in tree.items():
        rows = [[dataset, *cells] for dataset, of in datasets.items() for cells in rows_of(of)]
        parts += [f"<h3>Tracker {tracker}</h3>", table(["", *HEADER], rows)]
    listed = faults(drives)
    failed = sum("failed" in result for _, result in drives)
    astray = len({tuple(row[:-1]) for row in listed}) - failed
    title = f"Failures: {failed} of {len(drives)} goals; drives without a path, astray or with contacts: {astray}"
    parts.append(f"<h3>{title}</h3>{faults_table(listed)}")
    return Section("Table 1: constrained against unconstrained trajectories", "".join(parts))


def rows_of(tree: dict[str, Any]) -> list[list[str]]:
    """One row per measure, its name first, under HEADER. tree: one tracker and dataset of ``numbers``."""
    rows = []
    for measure in _MEASURES:
        of = tree[measure.key]
        some = {arm: f" ({of['known'][arm]} drives)" if of["known"][arm] < tree["drives"] else "" for arm in ARMS}
        cells = [measure.name, *(f"{interval(of[arm], measure.form)}{some[arm]}" for arm in ARMS)]
        for arm in OTHERS:
            cells += ["" if measure.is_share else interval(of["ratio"][arm]), f"{of['chance'][arm]:.2g}"]
        rows.append(cells)
    return rows


_ENDED = {
    FollowStatus.DIVERGED.value: "strayed too far from its path",
    FollowStatus.STALE.value: "did not arrive in time",
}
_PROTOCOL = (
    "Each row: the drives of several worlds to a goal that looks to the side (dataset 1: 60 to 110 deg) or back "
    "(dataset 2: 150 to 180 deg), planned in the true map, driven on odometry. Constrained: change of view "
    f"at most {PHI_RAD_M:g} rad/m. Unconstrained: shortest way, turns on the spot at 52 deg/s; or at 17 deg/s, at "
    "which no image is smeared. The paper's planner: section 4 to the letter, one try; goals that it does not reach "
    "do not count for it. U1: points found of those searched, a lost frame counts 0. U2: in how many frames a point "
    "was looked for or found, the mean over the points as said; in seconds, of points found three times. Broken: lost "
    "at the end, or wrong by more than 15 cm rms, or jumped against odometry. ATE: of the tracked poses, with scale "
    "alignment for the tracker as in the paper. In parentheses of how many drives where it is not known of all. A "
    "world counts once, with the mean of its drives. Brackets: 95 % (bootstrap over worlds, for means of fewer "
    "than 20 Student's t; Wilson for breaks). By "
    "chance: sign test over worlds. As in the paper: visual motion model, no wheels, a keyframe at most every 20 "
    "frames of 30 Hz and never for a turn."
)
