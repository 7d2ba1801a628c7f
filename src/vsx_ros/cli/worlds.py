"""``vsx world``: emulated worlds made by a generator, imported from Gazebo, described and drawn."""

import argparse
from pathlib import Path

import numpy as np

from vsx_ros.config import RobotConfig
from vsx_ros.errors import ConfigError
from vsx_ros.io.map_file import save_map
from vsx_ros.runs.start import tell_remarks
from vsx_ros.runs.world import check_world, open_world, save_world, world_files
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.mesh_hidden import hidden_solids
from vsx_ros.sim.mesh_world import MeshWorld
from vsx_ros.sim.picture import BAND_M, first_view, world_picture, write_picture
from vsx_ros.sim.truth import checked_start, ground_truth_grid, reachable_area_m2
from vsx_ros.sim.world import Start

_ENDINGS = {"render": "-view.png", "import": "-world.yaml"}  # of files without --out


def world(args: argparse.Namespace) -> int:
    """Make or read the world, and do with it what the options say."""
    if args.verb in ("render", "import"):
        args.out = args.out or Path(f"{Path(args.name).stem}{_ENDINGS[args.verb]}")
    elif args.verb is None and (args.out, args.picture, args.map) == (None, None, None):
        if args.name in ("info", "render", "import"):
            usual = "house.world" if args.name == "import" else "lab"
            raise ConfigError(f"give the world, e.g. vsx world {args.name} {usual}")
        raise ConfigError("say what to write with --out, --picture or --map, or begin with 'info'")
    _keep_what_is_read(args)
    world = open_world(args.name, args.seed, args.models, args.hard)
    tell_remarks(world)
    if args.start is not None:
        x, y, theta = args.start
        world = checked_start(world.starting_at(Start(x=x, y=y, theta_rad=theta)), args.name)
    if args.verb == "info":
        print("\n".join(described(world)))
    if args.verb == "render":
        write_picture(first_view(world, args.seed), args.out)
        print(f"view: {args.out}")
    elif args.out is not None:
        save_world(world, args.out)
        print(f"world: {args.out}")
    if args.map is not None:
        save_map(ground_truth_grid(world, 0.05, *BAND_M), args.map)
        print(f"true map: {args.map}")
    if args.picture is not None:
        write_picture(world_picture(world, args.seed), args.picture)
        print(f"picture: {args.picture}")
    return 0


def _keep_what_is_read(args: argparse.Namespace) -> None:
    """Raises ConfigError if the command would write over a file that the world is read from, or one file twice."""
    check_world(args.name, args.models)
    read = world_files(args.name, args.models)
    maps = [args.map.with_suffix(suffix) for suffix in (".pgm", ".yaml")] if args.map is not None else []
    written: set[Path] = set()
    for file in filter(None, (args.out, args.picture, *maps)):
        if file.exists() and any(one.exists() and file.samefile(one) for one in read):
            raise ConfigError(f"{file} would be written over, and {args.name} is read from it; name another")
        if file.resolve() in written:
            raise ConfigError(f"{file} would be written twice (--map writes a .pgm and a .yaml); name another")
        written.add(file.resolve())


def described(world: EmulatedWorld) -> list[str]:
    """What a user wants to know of a world, line by line."""
    x0, y0, x1, y1 = world.bounds
    start = world.start
    area = reachable_area_m2(world, RobotConfig().radius_m)
    lines = [
        f"world:      {world.name}",
        f"extent:     {x1 - x0:.1f} x {y1 - y0:.1f} m",
        f"reachable:  {area:.0f} m2 by a robot's centre",
        f"start:      {start.x:.2f}, {start.y:.2f} m, {np.degrees(start.theta_rad):.0f} deg",
    ]
    if world.hard:
        lines.append(f"hard:       {', '.join(f'{name}={amount:g}' for name, amount in world.hard.items())}")
    if isinstance(world, MeshWorld):
        seen, solids, hidden = world.parts.seen, world.parts.solids, hidden_solids(world)
        most = "".join(f", {model} {metres:.1f} m" for model, metres in hidden[:3])
        lines += [
            f"file:       {world.file}",
            f"floor:      {world.floor_z_m:.3f} m in the file",
            f"drawn:      {len(seen.corners)} triangles, {len(seen.textures.logs)} textures, {len(world.lamps)} lamps",
            f"solid:      {len(solids)} triangles",
            f"hidden:     {sum(metres for _, metres in hidden):.1f} m of solid borders with nothing drawn there{most}",
            f"missing:    {len(world.parts.remarks)} parts",
        ]
    return lines
