"""Real pictures without odometry: many starts in each recording, forwards and backwards, every and every third frame.

    PYTHONPATH=src:hw python benchmarks/slam_recordings.py [NAME ...] [--spacing 10] [--starts 10] [--each]

One run says little: two starts of one recording differ by a factor of two. Told are, over all starts of a variant:
the ATE of the live poses (after alignment with scale), the largest error of the motion between two frames,
the share of the frames that were tracked from the first start that any variant of the same frames had on, and by how
much the baseline of the first two keyframes points elsewhere than the truth's. Recordings are looked for in $VSX_DATA.
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

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[1] / "../shared/data"))
NAMES = ("new_tsukuba_150", "vamr_checkerboard", "visp_rbt_desk")
SHORTEST = 20  # frames a start must leave, or the errors are of nothing


class Outcome(NamedTuple):
    """One start. began: frames until there was a map, None without one. tracked: of the frames. direction_deg: of the
    first baseline against the truth; ate_m, step_m: after alignment with scale."""

    frames: int
    began: int | None
    tracked: int
    lost: int
    direction_deg: float
    ate_m: float
    step_m: float


def variants(frames: list[Frame], starts: int, spacing: int) -> dict[str, list[list[Frame]]]:
    """Sequences by direction and stride, each from several starts; the stamps always advance."""
    made: dict[str, list[list[Frame]]] = {}
    for way, stride in itertools.product((1, -1), (1, 3)):
        name = f"{'forwards' if way > 0 else 'backwards'}, every {'third ' * (stride > 1)}frame"
        ordered = frames[::way]
        sequences = [ordered[first::stride] for first in range(0, starts * spacing, spacing)]
        made[name] = [sequence for sequence in sequences if len(sequence) >= SHORTEST]
    return made


def outcome(camera, sequence: list[Frame], truth: dict[int, SE3]) -> Outcome:
    slam, pairs, began, lost, direction_deg = SequentialSlam(camera, None, Config().slam, 1), [], None, 0, math.nan
    turn = abs(sequence[0].stamp_ns) + abs(sequence[-1].stamp_ns)
    backwards = sequence[0].stamp_ns > sequence[-1].stamp_ns
    for k, frame in enumerate(sequence):
        stamp_ns = turn - frame.stamp_ns if backwards else frame.stamp_ns
        result = slam.track(Frame(stamp_ns, frame.image))
        if result.T_world_cam is None:
            continue
        lost += not result.state.tracked
        if result.state.tracked and frame.stamp_ns in truth:
            pairs.append((result.T_world_cam, truth[frame.stamp_ns]))
        if began is None:
            began, snapshot = k, slam.snapshot()
            stamps = [turn - ns if backwards else int(ns) for ns in map(int, snapshot.keyframe_stamps_ns[:2])]
            direction_deg = _direction_deg(snapshot.T_world_cams[:2], [truth.get(ns) for ns in stamps])
    if len(pairs) < 3:
        return Outcome(len(sequence), began, len(pairs), lost, direction_deg, math.nan, math.nan)
    error = trajectory_error(pairs, "sim3")
    alignment = error.scale
    steps = [
        float(np.linalg.norm((t0.inverse() @ t1).translation - alignment * (e0.inverse() @ e1).translation))
        for (e0, t0), (e1, t1) in itertools.pairwise(pairs)
    ]
    return Outcome(len(sequence), began, len(pairs), lost, direction_deg, error.ate_rmse_m, max(steps))


def _direction_deg(estimate, truth) -> float:
    """Between the baselines of two poses, each seen from its own first camera."""
    if any(T is None for T in truth) or len(estimate) < 2:
        return math.nan
    a, b = ((T0.inverse() @ T1).translation for T0, T1 in (estimate, truth))
    cosine = float(a @ b) / (float(np.linalg.norm(a) * np.linalg.norm(b)) + 1e-12)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def told(name: str, outcomes: list[Outcome], unit: float, word: str) -> str:
    """One line of the table."""
    earliest = min((o.began for o in outcomes if o.began is not None), default=0)
    shares = [100.0 * o.tracked / max(1, o.frames - earliest) for o in outcomes]
    ate, step = ([unit * value for value in values] for values in zip(*((o.ate_m, o.step_m) for o in outcomes)))
    wrong = np.nanmax([o.direction_deg for o in outcomes])
    return (
        f"{name:44}{len(outcomes):3}{np.nanmedian(ate):8.2f}{np.nanmax(ate):8.2f}{np.nanmax(step):8.2f} {word}"
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
        f"{'':44}{'n':>3}{'ATE: med':>8}{'worst':>8}{'step':>8}   {'tracked:':>8}{'worst':>7}  {'lost':>6}  direction"
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
