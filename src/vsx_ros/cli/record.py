"""``vsx record``: record a bag of a running robot, for vsx replay

Records images, calibration, odometry, tf, commands, states, plans and every number worth a plot of a running robot into
a ROS 1 bag until Ctrl-C, a limit, or a nearly full disk. Raw images are 9 MB a second and replay bit for bit; png is
half of that and loses nothing of the grey picture that the SLAM sees; jpeg is a fifteenth. While it is written the bag
is called NAME.bag.active.

examples: vsx record | vsx record --images jpeg --time 600 --out office.bag | then: vsx replay office.bag --map
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from vsx_ros.errors import ConfigError

_UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add = parser.add_argument
    add("--out", type=Path, metavar="FILE", help="the bag (default <date>_<time>.bag)")
    add("--images", choices=("raw", "png", "jpeg"), default="raw", help="how images are kept (raw)")
    add("--time", type=float, metavar="S", help="stop after this time")
    add("--limit", type=Size.parse, default="1TB", metavar="SIZE", help="stop at this size, e.g. 4GB")
    add("--keep-free", type=Size.parse, default="1GB", metavar="SIZE", help="stop when the disk has less left (1GB)")
    add("--topic", action="append", default=[], metavar="T", help="record this topic, too; repeatable")


def run(args: argparse.Namespace) -> int:
    """Check what can be checked, and record."""
    if args.time is not None and not args.time > 0:
        raise ConfigError(f"--time {args.time}: give a positive number of seconds")
    if args.out is not None and args.out.exists():
        raise ConfigError(f"{args.out} exists; give another name, or delete it")
    if args.out is not None and not args.out.resolve().parent.is_dir():
        raise ConfigError(f"--out {args.out}: its folder does not exist; make it first")
    from vsx_ros.ros.record import record

    return record(args)


class Size(NamedTuple):
    """Of a file or a disk. text: as it was given."""

    text: str
    bytes: float

    @staticmethod
    def parse(text: str) -> Size:
        """A size like 500MB. Raises ArgumentTypeError for anything else."""
        number, unit = text.strip()[:-2], text.strip()[-2:]
        try:
            size = float(number) * _UNITS[unit]
        except (ValueError, KeyError):
            size = 0.0
        if not 0.0 < size < 1e18:
            raise argparse.ArgumentTypeError(f"size {text!r}: give a number and one of {', '.join(_UNITS)}, e.g. 4GB")
        return Size(text, size)
