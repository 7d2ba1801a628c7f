"""``vsx config``: print every parameter with its value, unit and bound

Prints the configuration as YAML. The output can be edited and given back with --config.

examples: vsx config > my.yaml | vsx config --set planner.phi_rad_m=0.5
"""

import argparse
from pathlib import Path

from vsx_ros.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    add_parameters(parser)
    parser.add_argument(
        "--robot", action="store_true", help="what this machine's robot goes by: with what 'vsx calibrate' found"
    )


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """The options by which every command takes parameters."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="YAML with parameters, as 'vsx config' prints it")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="override a parameter, e.g. limits.v_m_s=0.2"
    )


def run(args: argparse.Namespace) -> int:
    """Print the tree. Raises ConfigError for two files at once."""
    from vsx_ros.runs.parameters import commented_yaml, load
    from vsx_ros.runs.robot_file import robot_file_here

    if args.robot and args.config is not None:
        raise ConfigError("--robot is the file that 'vsx calibrate' writes, --config another; leave out one")
    file = robot_file_here() if args.robot else args.config
    print(commented_yaml(load(file, args.set)), end="")
    return 0
