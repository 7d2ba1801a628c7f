"""Real pictures without odometry: many starts in each recording, forwards and backwards, every frame and every third.

    PYTHONPATH=src:hw python benchmarks/slam_recordings.py [NAME ...] [--spacing 10] [--starts 10] [--each]

A single run says little: two starts of one recording differ by a factor of two. For all starts of a variant, it prints:
the ATE of the live poses and of the same frames by the final keyframes (after alignment with scale); the largest error
of the motion between two frames; the share of tracked frames, counted from the first start of any variant of the same
frames; and the direction error of the first two keyframes' baseline. Recordings are read from $VSX_DATA.
The truth of visp_rbt_desk has 13 mm of noise: it gives no direction for a baseline of 20 mm.
"""

import argparse
import itertools
import math
import os
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vsx_ros.config import Config
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.bag import open_recording
from vsx_ros.robot import Frame
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[1] / "../shared/data"))
NAMES = ("new_tsukuba_150", "vamr_checkerboard", "visp_rbt_desk")
SHORTEST = 20  # minimum number of frames after a start; fewer give meaningless errors


class Outcome(NamedTuple):
    """One start. began: frames until there was a map, None without one. tracked: number of frames. direction_deg: error
    of the first baseline; ate_m, step_m, final_m: after alignment with scale, final_m by the final keyframes."""

    frames: int
    began: int | None
    tracked: int
    lost: int
    direction_deg: float
    ate_m: float
    step_m: float
    final_m: float


def variants(frames: list[Frame], starts: int, spacing: int) -> dict[str, list[list[Frame]]]:
    """Sequences by direction and stride, each from several starts; the stamps always increase."""
    made: dict[str, list[list[Frame]]] = {}
    for way, stride in itertools.product((1, -1), (1, 3)):
        name = f"{'forwards' if way > 0 else 'backwards'}, every {'third ' * (stride > 1)}frame"
        ordered = frames[::way]
        sequences = [ordered[first::stride] for first in range(0, starts * spacing, spacing)]
        made[name] = [sequence for sequence in sequences if len(sequence) >= SHORTEST]
    return made


def outcome(camera, sequence: list[Frame], truth: dict[int, SE3]) -> Outcome:
    slam, pairs, began, lost, off_deg = SequentialSlam(camera, None, Config().slam, 1), [], None, 0, math.nan
    anchors = []
    turn = abs(sequence[0].stamp_ns) + abs(sequence[-1].stamp_ns)
    backwards = sequence[0].stamp_ns > sequence[-1].stamp_ns
    for k, frame in enumerate(sequence):
        stamp_ns = turn - frame.stamp_ns if backwards else frame.stamp_ns
        result = slam.track(Frame(stamp_ns, frame.image))
        if result.state is TrackingState.NOT_INITIALISED:
            pairs, anchors = [], []  # a restarted map keeps nothing
        if result.T_world_cam is None:
            continue
        lost += not result.state.tracked
        if result.state.tracked and frame.stamp_ns in truth:
            pairs.append((result.T_world_cam, truth[frame.stamp_ns]))
            anchors.append(result.anchor)
        if began is None:
            began, snapshot = k, slam.snapshot()
            stamps = [turn - ns if backwards else int(ns) for ns in map(int, snapshot.keyframe_stamps_ns[:2])]
            off_deg = direction_deg(snapshot.T_world_cams[:2], [truth.get(ns) for ns in stamps])
    if len(pairs) < 3:
        return Outcome(len(sequence), began, len(pairs), lost, off_deg, math.nan, math.nan, math.nan)
    error = trajectory_error(pairs, "sim3")
    alignment, keyframes = error.scale, slam.slam_map().view.keyframes
    final = [(anchor.pose(keyframes), T) for anchor, (_, T) in zip(anchors, pairs)]
    final_m = trajectory_error(final, "sim3").ate_rmse_m
    steps = [
        float(np.linalg.norm((t0.inverse() @ t1).translation - alignment * (e0.inverse() @ e1).translation))
        for (e0, t0), (e1, t1) in itertools.pairwise(pairs)
    ]
    return Outcome(len(sequence), began, len(pairs), lost, off_deg, error.ate_rmse_m, max(steps), final_m)


def direction_deg(estimate, truth) -> float:
    """Angle between the baselines of two pairs of poses, each in the frame of its first camera."""
    if any(T is None for T in truth) or len(estimate) < 2:
        return math.nan
    a, b = ((T0.inverse() @ T1).translation for T0, T1 in (estimate, truth))
    cosine = float(a @ b) / (float(np.linalg.norm(a) * np.linalg.norm(b)) + 1e-12)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def told(name: str, outcomes: list[Outcome], unit: float, word: str) -> str:
    """One line of the table."""
    earliest = min((o.began for o in outcomes if o.began is not None), default=0)
    shares = [100.0 * o.tracked / max(1, o.frames - earliest) for o in outcomes]
    columns = zip(*((o.ate_m, o.step_m, o.final_m) for o in outcomes))
    ate, step, final = ([unit * value for value in values] for values in columns)
    wrong = np.nanmax([o.direction_deg for o in outcomes])
    return (
        f"{name:44}{len(outcomes):3}{np.nanmedian(ate):8.2f}{np.nanmax(ate):8.2f}"
        f"{np.nanmedian(final):8.2f}{np.nanmax(step):8.2f} {word}"
        f"{np.median(shares):8.1f}{min(shares):7.1f} %{sum(o.lost for o in outcomes):6}{wrong:8.0f} deg"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(NAMES))
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--spacing", type=int, default=5, help="frames between two starts")
    parser.add_argument("--each", action="store_true", help="also a line for every start")
    args = parser.parse_args()
    print(
        f"{'':44}{'n':>3}{'ATE: med':>8}{'worst':>8}{'final':>8}{'step':>8}   "
        f"{'tracked:':>8}{'worst':>7}  {'lost':>6}  direction"
    )
    for name in args.names:
        if not (DATA / name).exists():
            print(f"{DATA / name} is absent (set VSX_DATA): left out", file=sys.stderr)
            continue
        source = open_recording(DATA / name)
        truth = {p.stamp_ns: p.T for p in source.ground_truth}
        unit, word = (1000.0, "mm") if name == "vamr_checkerboard" else (100.0, "cm")
        for variant, sequences in variants(list(source.frames()), args.starts, args.spacing).items():
            outcomes = [outcome(source.camera, sequence, truth) for sequence in sequences]
            if args.each:
                print(*outcomes, sep="\n")
            if outcomes:
                print(told(f"{name}, {variant}", outcomes, unit, word), flush=True)


if __name__ == "__main__":
    main()
