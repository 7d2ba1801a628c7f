"""What other settings would make of the same keyframes.

    PYTHONPATH=src:hw python benchmarks/map_settings.py --set ground_map.max_range_m=4.5 [--set ...] [--seeds 20-23]

Each lab is explored with the present settings. At some metres of the way the surfaces and the ground map are made anew
from the keyframes so far: with the present settings, with each ``--set`` alone, and with all of them. It prints the
mean differences to the present settings, judged as in exploration.py (known and right) and ground_map.py (the rest).
The same drive is judged each time, so a few labs show what the ways of whole explorations, which differ by ten metres
from noise to noise, do not. Surfaces are made of all keyframes at once, so the newest two count, too.
"""

import argparse
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from seeds import seed_range

from vsx_ros.config import Config
from vsx_ros.dense.densify import Densifier
from vsx_ros.dense.mapped_ground import AnchoredSurface, MappedGround
from vsx_ros.evaluation.map_quality import obstacle_quality, seen_faces
from vsx_ros.geometry.se3 import SE3
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.parameters import load
from vsx_ros.runs.world import open_world
from vsx_ros.sim.truth import ground_truth_grid

ALL_CELLS, TIME_S = 10**9, 600.0


class Judged(NamedTuple):
    """Shares, see evaluation/map_quality.py. right: of the observable cells, known and right. surface_free: of the
    seen faces, called free. inside: of the free cells, inside obstacles."""

    right: float
    surface_free: float
    inside: float
    f1: float


class Judge:
    """Maps of the keyframes of one run, with other settings."""

    def __init__(self, run: FastRun, seed: int) -> None:
        self._run, self._seed, ground = run, seed, Config().ground_map
        band = ground.obstacle_min_height_m, ground.obstacle_max_height_m
        self._truth = ground_truth_grid(run.world, ground.resolution_m, *band)

    def judged(self, config: Config) -> Judged:
        """The map that these settings would make now."""
        snapshot, robot = self._run.system.slam.snapshot(), self._run.robot
        densifier = Densifier(robot.camera_given, robot.T_base_cam_given, config.dense, self._seed)
        dense = densifier.update(snapshot, ALL_CELLS, settled=True)
        ground = MappedGround(config)
        ground.restore(self._run.system.ground.state())
        ground.dense = AnchoredSurface.of(dense, snapshot, config.dense.cell_m)
        grid = ground.grid(snapshot)
        start = self._run.world.start_pose
        faces = seen_faces(self._truth, [SE3.from_se2(start) @ T for T in snapshot.T_world_cams])
        at_faces = obstacle_quality(grid, self._truth, faces, start)
        shares = (
            self._run.judge.quality(grid).coverage_correct,
            at_faces.surface_free,
            at_faces.free_inside,
            at_faces.f1,
        )
        return Judged(*(share or 0.0 for share in shares))


def watched(judge: Judge, run: FastRun, due_m: list[float], configs: list[Config], out: list[list[Judged]]) -> Callable:
    """Judges all settings each time the run has driven as far as due; ends it after the last."""

    def watch(_: int) -> str | None:
        if due_m and run.system.grid is not None and run.robot.truth.path_length_m >= due_m[0]:
            due_m.pop(0)
            out.append([judge.judged(config) for config in configs])
            print(f"{run.robot.truth.path_length_m:.0f} m: {100 * out[-1][0].right:.1f} % known and right", flush=True)
        return None if due_m else "judged"

    return watch


def metres(text: str) -> list[float]:
    """``12,24,36``; for argparse."""
    return sorted(float(word) for word in text.split(","))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(20, 24), metavar="A-B")
    parser.add_argument("--metres", type=metres, default=[12, 24, 36])
    parser.add_argument("--set", action="append", required=True, dest="settings", metavar="NAME=VALUE")
    args = parser.parse_args()
    settings = [[], *([word] for word in args.settings), *([args.settings] if len(args.settings) > 1 else [])]
    configs, out = [load(None, words) for words in settings], []
    for seed in args.seeds:
        print(f"lab {seed}", flush=True)
        run = FastRun(open_world("lab", seed), seed, "fov", Config())
        run.run(TIME_S, watched(Judge(run, seed), run, list(args.metres), configs, out))
    if not out:
        sys.exit("no run drove as far as the first of --metres; give fewer")
    values = np.array(out)
    print(f"mean of {len(out)} maps, and differences to it [%]: {', '.join(Judged._fields)}")
    for k, words in enumerate(settings):
        mean = 100.0 * (values[:, k] - (values[:, 0] if k else 0.0)).mean(axis=0)
        print(f"  {' '.join(words) or 'present settings'}: " + ", ".join(f"{x:{'+.2f' if k else '.2f'}}" for x in mean))


if __name__ == "__main__":
    main()
