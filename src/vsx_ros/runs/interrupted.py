"""What is known of a run that was killed, or that still runs: its journals hold what its results would."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from vsx_ros.config import Config
from vsx_ros.errors import InputError, explained
from vsx_ros.evaluation.run_time import length_s, parts
from vsx_ros.evaluation.summary import checked_summary, with_accuracy
from vsx_ros.evaluation.trajectory import AlignmentKind
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.limits import DAMAGE
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import ClockLine, FrameLine, Line, RunEvent, TruthLine, odom_epochs, read_journal, unflat
from vsx_ros.runs.record import RunRecord, counts_all

_NO_END = "the run has not come to its end: it still runs, or it was killed"
REASON = f"{_NO_END}; vsx explore --resume goes on with it"
REASON_OF_REPLAY = f"{_NO_END}; a replay is begun again"
_FACTS = "world", "seed", "planner"


class KnownRun(NamedTuple):
    """As in the files of a finished run: summary.json, events.jsonl, frames.csv, trajectory.txt, groundtruth.txt,
    odometry.txt; with odometry its map is level. odom_epochs: by stamp, as far as the journal knows them."""

    summary: dict[str, Any]
    events: list[RunEvent]
    frames: list[FrameRecord]
    estimate: Sequence[StampedPose]
    truth: list[StampedPose]
    odometry: Sequence[StampedPose]
    odom_epochs: Mapping[int, int]


def unfinished(folder: RunFolder, seen: list[Line] | None = None) -> KnownRun | None:
    """What the journals know; None if the folder has a summary of all their frames, and of how the run ended: the node
    vslam alone does not know that. seen: the journal of the frames, if it was read already. Raises InputError for
    damage, also of config.yaml if that is needed, or ConfigError."""
    if (folder.path / "summary.json").exists():
        try:
            seen = read_journal(folder.journal) if seen is None else seen
        except InputError:
            return None  # the results need no journal
        told = checked_summary(folder.read_summary(), str(folder.path))
        ended = told.get("stop_reason") is not None or not seen
        if ended and (told.get("frames") is None or counts_all(told["frames"], seen)):
            return None
    config, facts = folder.read_config()
    lines = [*(read_journal(folder.journal) if seen is None else seen), *read_journal(folder.witness)]
    with explained(InputError, f"the journals in {folder.journal.parent} contradict themselves", "run again", DAMAGE):
        return _known(lines, config, facts)


def _known(lines: list[Line], config: Config, facts: dict[str, Any]) -> KnownRun:
    """The results of the lines, as at the end of a run."""
    record = RunRecord(mounted(config.robot.mount))
    record.restore(lines)
    truth = [StampedPose(x.stamp_ns, unflat(x.T_world_cam)) for x in lines if isinstance(x, TruthLine)]
    odometry = record.odometry()
    kind: AlignmentKind | None = "yaw" if odometry else None
    summary = with_accuracy(record.counted(), record.estimate(), (), truth, kind).with_values(
        **{name: facts.get(name) for name in _FACTS}, phi=config.planner.phi_rad_m, duration_s=_lasted_s(lines),
        stop_reason=REASON if "fast" in facts else REASON_OF_REPLAY, ended_well=False,
    )  # fmt: skip
    return KnownRun(
        summary=summary.as_dict(), events=sorted(record.told(), key=lambda event: event.stamp_ns),
        frames=record.frame_records(), estimate=record.estimate(), truth=truth, odometry=odometry,
        odom_epochs=odom_epochs(lines),
    )  # fmt: skip


def _lasted_s(lines: list[Line]) -> float | None:
    """By the clock of a live run, else by the frames, without the interruptions between them."""
    clocks = [line.elapsed_s for line in lines if isinstance(line, ClockLine)]
    stamps = [line.stamp_ns for line in lines if isinstance(line, FrameLine)]
    return clocks[-1] if clocks else length_s(parts(stamps)) if stamps else None
