"""Figure 5 of the paper: the ground map of the same keyframes without and with the dense planes."""

from __future__ import annotations

import dataclasses
from typing import Any

from vsx_ros.config import Config
from vsx_ros.evaluation.figure5 import Figure5
from vsx_ros.evaluation.obstacles import seen_faces
from vsx_ros.experiments.exploration import run_whole
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.truth import ground_truth_grid


def explore_and_map(world: str, seed: int, limit_s: float) -> tuple[Figure5, dict[str, Any]]:
    """One exploration with dense mapping, its maps beside the truth, and their numbers."""
    config = Config()
    run = FastRun(open_world(world, seed), seed, "fov", config)
    reason = run_whole(run, limit_s)
    system, ground = run.system, config.ground_map
    snapshot, true_poses = system.slam.snapshot(), {pose.stamp_ns: pose.T for pose in run.truth}
    truth = ground_truth_grid(
        run.world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m
    )
    figure = Figure5(
        truth,
        seen_faces(truth, [true_poses[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()]),
        [("sparse points", system.ground.grid(snapshot, False)), ("dense planes", system.ground.grid(snapshot))],
        run.world.start_pose,
        f"{world}, seed {seed}: {len(snapshot.keyframe_ids)} keyframes, {run.robot.truth.path_length_m:.1f} m; "
        f"{reason}. Faces count that three keyframes saw within 3.5 m.",
    )
    return figure, {"facts": figure.facts} | {n: dataclasses.asdict(q) for n, q in figure.qualities().items()}
