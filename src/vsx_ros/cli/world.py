"""``vsx world``: write an emulated building to world.yaml

Makes a building for the emulator: from a generator's name and seed, or from a map_server map.

examples: vsx world lab --seed 3 --out world.yaml | vsx world office.yaml --picture plan.png
"""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add = parser.add_argument
    add("name", metavar="NAME", help="lab, office, corridor, building, a world.yaml, a map.yaml, a .png")
    add("--seed", type=int, default=0, metavar="N", help="which of the generator's worlds (default 0)")
    add("--out", type=Path, metavar="FILE", help="write the world to this YAML file")
    add("--picture", type=Path, metavar="FILE.png", help="draw the plan and the first view")
    add("--map", type=Path, metavar="FILE.pgm", help="write the true map (pgm and yaml) for map_server")


def run(args: argparse.Namespace) -> int:
    """Make the world and write what was asked for; says on the standard output what it wrote."""
    from vsx_ros.errors import ConfigError
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
