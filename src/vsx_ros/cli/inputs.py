"""``vsx config`` and ``vsx world``: write what a run can be given."""

import argparse

from vsx_ros.errors import ConfigError


def config(args: argparse.Namespace) -> int:
    """Print the parameters. Raises ConfigError for two files at once."""
    from vsx_ros.runs.parameters import commented_yaml, load, robot_file_here

    if args.robot and args.config is not None:
        raise ConfigError("--robot is the file that 'vsx calibrate' writes, --config another; leave out one")
    file = robot_file_here() if args.robot else args.config
    print(commented_yaml(load(file, args.set)), end="")
    return 0


def world(args: argparse.Namespace) -> int:
    """Make the world and write what was asked for; says on the standard output what it wrote."""
    from vsx_ros.io.map_file import save_map
    from vsx_ros.runs.world import open_world
    from vsx_ros.sim.picture import BAND_M, world_picture, write_picture
    from vsx_ros.sim.truth import ground_truth_grid
    from vsx_ros.sim.world_file import save_world

    if args.out is None and args.picture is None and args.map is None:
        raise ConfigError("vsx world: say what to write with --out, --picture or --map")
    world = open_world(args.name, args.seed)
    if args.out is not None:
        save_world(world, args.out)
        print(f"world: {args.out}")
    if args.map is not None:
        save_map(ground_truth_grid(world, 0.05, *BAND_M), args.map)
        print(f"true map: {args.map}")
    if args.picture is not None:
        write_picture(world_picture(world, args.seed), args.picture)
        print(f"picture: {args.picture}")
    return 0
