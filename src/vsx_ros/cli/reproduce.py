"""``vsx reproduce``: a figure of the paper made anew, in emulation, with the numbers behind it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vsx_ros.errors import ConfigError

_FIGURES = ("fig5",)


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "reproduce",
        help="make a figure of the paper anew",
        description="fig5: explores an emulated building, builds the ground map of the same keyframes without and "
        "with the dense planes, and compares both with the truth: fig5.html and fig5.json.",
        epilog="example: vsx reproduce fig5 --seed 101 --time 90",
    )
    parser.add_argument("figure", metavar="FIGURE", choices=_FIGURES, help="fig5")
    parser.add_argument("--world", default="lab", metavar="NAME|FILE", help="lab, office, corridor or a world.yaml")
    parser.add_argument("--seed", type=int, default=101, metavar="N", help="world and noise (default 101)")
    parser.add_argument("--time", type=float, default=90.0, metavar="S", help="emulated time (default 90)")
    parser.add_argument(
        "--out", type=Path, default=Path("results"), metavar="FOLDER", help="where to (default results)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Explore, compare, write the page, say where it is."""
    import dataclasses
    import json

    from vsx_ros.cli.explore_fast import FastRun
    from vsx_ros.cli.world import open_world
    from vsx_ros.config import Config, overridden
    from vsx_ros.evaluation.figure5 import Figure5, render
    from vsx_ros.evaluation.obstacles import seen_faces
    from vsx_ros.io.atomic import write_text
    from vsx_ros.sim.truth import ground_truth_grid

    if not args.time > 0:
        raise ConfigError(f"--time {args.time}: give a positive number of seconds")
    config = overridden(Config(), {"dense.enabled": True})
    exploration = FastRun(open_world(args.world, args.seed), args.seed, "fov", config)
    reason = exploration.run(args.time)
    system, ground = exploration.system, config.ground_map
    snapshot, true_poses = system.slam.snapshot(), {pose.stamp_ns: pose.T for pose in exploration.truth}
    truth = ground_truth_grid(
        exploration.world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m
    )
    figure = Figure5(
        truth,
        seen_faces(truth, [true_poses[stamp] for stamp in snapshot.keyframe_stamps_ns.tolist()]),
        [("sparse points", system.ground.grid(snapshot, False)), ("dense planes", system.ground.grid(snapshot))],
        exploration.world.start_pose,
        f"{args.world}, seed {args.seed}: {len(snapshot.keyframe_ids)} keyframes, "
        f"{exploration.robot.truth.path_length_m:.1f} m; {reason}. Faces count that three keyframes saw within 3.5 m.",
    )
    args.out.mkdir(parents=True, exist_ok=True)
    write_text(args.out / "fig5.html", render(figure))
    numbers = {name: dataclasses.asdict(quality) for name, quality in figure.qualities().items()}
    write_text(args.out / "fig5.json", json.dumps({"facts": figure.facts, **numbers}, indent=1) + "\n")
    for name, values in numbers.items():
        print(f"{name}: " + ", ".join(f"{k} {v:.4f}" for k, v in values.items() if v is not None))
    print(f"page: {args.out / 'fig5.html'}")
    return 0
