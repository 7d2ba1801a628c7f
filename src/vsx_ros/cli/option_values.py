"""Parser and value types of the options of ``vsx``, and options that several commands share."""

import argparse
import math
import os
import re
from pathlib import Path
from typing import Any, NamedTuple

from vsx_ros.errors import ConfigError
from vsx_ros.registry import PLUGINS, Kinds

BASES = Kinds("vsx_hw.bases:BASES", "auto", "ros")  # bases at a port need no ROS
PLANNERS = Kinds("vsx_ros.planning.planners:PLANNERS")
_UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}  # bytes, by SI


class Parser(argparse.ArgumentParser):
    """A parser of values that may begin with a minus sign and a digit, such as places; so no option may."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._negative_number_matcher = re.compile(r"-[\d.]")  # argparse's own knows only whole values, such as -1.5


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """The options for parameters, common to all commands."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="YAML with parameters, as 'vsx config' prints it")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="override a parameter, e.g. limits.v_m_s=0.2"
    )


def add_models(parser: argparse.ArgumentParser) -> None:
    """The option for the folders of a Gazebo world's models."""
    what = "folder of a Gazebo world's models; repeatable (also GAZEBO_MODEL_PATH, and beside the world)"
    parser.add_argument("--models", type=Path, action="append", default=[], metavar="DIR", help=what)


def add_hard_things(parser: argparse.ArgumentParser) -> None:
    """The option for what makes an emulated world hard."""
    what = "make the emulated world hard: names of docs/how-to/hard-things.md with commas between; repeatable"
    parser.add_argument("--with", action="append", dest="hard", default=[], metavar="NAME[=AMOUNT]", help=what)


def add_engine(parser: argparse.ArgumentParser) -> None:
    """The options for where many runs are computed."""
    parser.add_argument("--jobs", type=count, default=1, metavar="N", help="processes on this machine (default 1)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a dask scheduler with workers on other machines")


def refuse(args: argparse.Namespace, why: str, *names: str) -> None:
    """Raises ConfigError if one of these options is given, which would be ignored. why: the beginning of a sentence."""
    for name in names:
        if getattr(args, name) not in (None, []):
            raise ConfigError(f"{why}; leave out --{name.replace('_', '-')}")


def positive(text: str) -> float:
    """A number above 0."""
    if not 0.0 < float(text) < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a positive number")
    return float(text)


def phi(text: str) -> float:
    """A bound that planner.phi_rad_m may have [rad/m]."""
    from vsx_ros.config import LEAST_PHI_RAD_M

    if not LEAST_PHI_RAD_M <= float(text) < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: give a number of at least {LEAST_PHI_RAD_M}, in rad/m")
    return float(text)


def count(text: str) -> int:
    """A whole number of at least 1."""
    if int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give a number of at least 1")
    return int(text)


def seed(text: str) -> int:
    """A whole number from 0 on."""
    if int(text) < 0:
        raise argparse.ArgumentTypeError(f"{text}: give a whole number from 0 on")
    return int(text)


def share(text: str) -> float:
    """A share of a whole."""
    if not 0.0 < float(text) <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no share of a whole; give more than 0 and at most 1, e.g. 0.9")
    return float(text)


def rate(text: str) -> float:
    """Images per second."""
    if not 1.0 <= float(text) <= 60.0:
        raise argparse.ArgumentTypeError(f"{text} images a second; give 1 to 60")
    return float(text)


def camera(text: str) -> str:
    """A ~device of the node camera."""
    known = re.fullmatch(r"kinect(:.+)?|v4l:(\d+|/dev/\S+)|emulator:.+|ros(:[\w/~]+)?", text)
    if not known and not os.environ.get(PLUGINS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no camera; write kinect, kinect:SERIAL, v4l:N (e.g. v4l:0), v4l:/dev/v4l/by-id/..., "
            "ros or ros:TOPIC"
        )
    return text


def pose(text: str) -> tuple[float, float, float]:
    """X,Y,DEG as metres and radians."""
    try:
        x, y, degrees = (float(word) for word in text.split(","))
        finite = math.isfinite(x + y + degrees)
    except ValueError:
        finite = False
    if not finite:
        raise argparse.ArgumentTypeError(f"{text!r} is not a pose; write X,Y,DEG, e.g. 1.5,-2,90")
    return x, y, math.radians(degrees)


def pose_text(text: str) -> str:
    """X,Y,DEG as it stands, if it is a pose."""
    pose(text)
    return text


def place(text: str) -> tuple[float, float, float | None]:
    """X,Y or X,Y,DEG as metres and radians, None for no heading."""
    try:
        x, y, *degrees = (float(word) for word in text.split(","))
        finite = math.isfinite(x + y + sum(degrees))
    except ValueError:
        finite, degrees = False, []
    if not finite or len(degrees) > 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no place; write X,Y or X,Y,DEG, e.g. 1.5,-2")
    return x, y, math.radians(degrees[0]) if degrees else None


def map_file(text: str) -> Path:
    """A map's file; of a run folder its map.yaml."""
    return Path(text) / "map.yaml" if Path(text).is_dir() else Path(text)


def seeds(text: str) -> range:
    """A:B as a range."""
    match = re.fullmatch(r"(\d+):(\d+)", text)
    if match is None or int(match[1]) >= int(match[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is no range of seeds; write A:B, e.g. 100:120")
    return range(int(match[1]), int(match[2]))


class Size(NamedTuple):
    """Size of a file or a disk. text: as given."""

    text: str
    bytes: float

    @staticmethod
    def parse(text: str) -> "Size":
        """A size like 500MB. Raises ArgumentTypeError for anything else."""
        number, unit = text.strip()[:-2], text.strip()[-2:]
        try:
            size = float(number) * _UNITS[unit]
        except (ValueError, KeyError):
            size = 0.0
        if not 0.0 < size < 1e18:
            raise argparse.ArgumentTypeError(f"size {text!r}: give a number and one of {', '.join(_UNITS)}, e.g. 4GB")
        return Size(text, size)
