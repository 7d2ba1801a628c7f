"""The numbers of a run: summary.json, with exactly the keys that scripts rely on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from msgspec import Struct

from vsx_ros import __version__
from vsx_ros.errors import InputError
from vsx_ros.evaluation.trajectory import AlignmentKind, associate, path_length, trajectory_error
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.slam.state import SlamStatistics

LIVE = "live poses (trajectory.txt)"


class Summary(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """SI units; None (null in the file) if unknown. breaks: jumps against odometry, hence unknown without it, and 1
    more if the tracking is lost for good. ate_of: the trajectory of ate_rmse_m, ate_rmse_sim3_m, scale_error
    and path_length_m; the ate_final ones are of trajectory_final.txt, the same frames by the finished map.
    path_length_m: of the estimated trajectory. driven_m: of the true one. min_clearance_m: the emulated hull's least
    distance to any obstacle. collisions: by its own motion, some with people it could see; touched_by_people: who
    walked into it or stood where it does not look. map_note: the ground map's unit of length if it is not metres."""

    frames: int | None = None
    frames_tracked: int | None = None
    frames_lost: int | None = None
    breaks: int | None = None
    odometry_jumps: int | None = None
    relocalizations: int | None = None
    initialized_at_s: float | None = None
    keyframes: int | None = None
    map_points: int | None = None
    u1: float | None = None
    u2_frames: float | None = None
    u2_seconds: float | None = None
    u2_metres: float | None = None
    visible_ratio: float | None = None
    track_ms_median: float | None = None
    track_ms_p99: float | None = None
    ate_rmse_m: float | None = None
    ate_rmse_sim3_m: float | None = None
    ate_final_rmse_m: float | None = None
    ate_final_rmse_sim3_m: float | None = None
    ate_of: str | None = None
    scale_error: float | None = None
    path_length_m: float | None = None
    duration_s: float | None = None
    coverage: float | None = None
    coverage_correct: float | None = None
    occupied_precision: float | None = None
    occupied_recall: float | None = None
    free_inside_obstacle: float | None = None
    collisions: int | None = None
    collisions_with_people: int | None = None
    touched_by_people: int | None = None
    driven_m: float | None = None
    min_clearance_m: float | None = None
    planned_vs_executed_rms_m: float | None = None
    plans: int | None = None
    plan_ms_median: float | None = None
    plan_ms_p99: float | None = None
    map_note: str | None = None
    stop_reason: str | None = None
    ended_well: bool | None = None
    world: str | None = None
    seed: int | None = None
    planner: str | None = None
    phi: float | None = None
    continued_map: str | None = None
    version: str = __version__

    def as_dict(self) -> dict[str, Any]:
        """Every key, in order; numbers that are not finite become None, as JSON has no such numbers."""
        tree: dict[str, Any] = msgspec.to_builtins(self)
        return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in tree.items()}

    def with_values(self, **values: Any) -> Summary:
        """A copy with these values, e.g. those of ``map_quality(...)._asdict()``."""
        return msgspec.structs.replace(self, **values)


def checked_summary(tree: dict[str, Any], where: str) -> dict[str, Any]:
    """The tree unchanged, from this or another version. Raises InputError if a value has the wrong type."""
    known = {key: value for key, value in tree.items() if key in Summary.__struct_fields__}
    try:
        msgspec.convert(known, Summary)
    except (msgspec.ValidationError, OverflowError) as error:
        raise InputError(f"{where}: the summary is damaged ({error}); run again") from error
    return tree


def tracking_summary(statistics: SlamStatistics, track_ms: Sequence[float]) -> Summary:
    """The SLAM's own statistics, and how long its frames took [ms]."""
    times = np.asarray(track_ms, float)
    return Summary(
        **statistics._asdict(),
        track_ms_median=float(np.median(times)) if times.size else None,
        track_ms_p99=float(np.percentile(times, 99)) if times.size else None,
    )


def with_accuracy(
    summary: Summary,
    estimate: Sequence[StampedPose],
    final: Sequence[StampedPose],
    truth: Sequence[StampedPose],
    kind: AlignmentKind | None,
) -> Summary:
    """Add ATE and scale error against the truth, for the live estimate and the final one, and the length of the
    estimated trajectory. kind: how ``ate_rmse_m`` is aligned (se3; yaw if gravity is known); None for a map without
    metric scale, which has only a scale-free error. Without overlap in time the errors stay None."""
    if kind is not None:
        summary = summary.with_values(path_length_m=path_length(estimate))
    live, last = _errors(estimate, truth, kind), _errors(final, truth, kind)
    if live is not None:
        values = {"ate_rmse_m": live.ate_m, "ate_rmse_sim3_m": live.ate_sim3_m, "scale_error": live.scale_error}
        summary = summary.with_values(**values, ate_of=LIVE)
    if last is not None:
        summary = summary.with_values(ate_final_rmse_m=last.ate_m, ate_final_rmse_sim3_m=last.ate_sim3_m)
    return summary


class _Errors(NamedTuple):
    ate_m: float | None
    ate_sim3_m: float
    scale_error: float | None


def _errors(
    estimate: Sequence[StampedPose], truth: Sequence[StampedPose], kind: AlignmentKind | None
) -> _Errors | None:
    """None if the two do not overlap in time."""
    try:
        pairs = associate(estimate, truth)
    except InputError:
        return None
    free = trajectory_error(pairs, "sim3").ate_rmse_m
    if kind is None:
        return _Errors(None, free, None)
    error = trajectory_error(pairs, kind)
    return _Errors(error.ate_rmse_m, free, error.scale_error)
