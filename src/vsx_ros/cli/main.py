"""``vsx``: one command line for everything. Each subcommand is a module here, with ``add_arguments`` and ``run``.

A module's docstring is its help: a line, what the command does, and examples or exit codes.

The modules import what they need inside ``run``, so that help and mistakes are answered at once.
"""

import argparse
import importlib
import os
import sys
import traceback
from collections.abc import Sequence
from typing import NoReturn

from vsx_ros import __version__
from vsx_ros.errors import VsxError, disk_trouble
from vsx_ros.registry import load_plugins
from vsx_ros.runs import streams
from vsx_ros.runs.exit_codes import FAILED, HARDWARE, INTERNAL, STOPPED

COMMANDS = (
    "explore", "replay", "record", "plan", "evaluate", "report", "reproduce", "sweep", "map", "view", "status", "stop",
    "teleop", "calibrate", "doctor", "config", "world", "completion",
)  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """A parser whose mistakes end with the project's exit code and one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(FAILED, f"{self.prog}: {message}; '{self.prog} --help' lists what there is\n")


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    root = _Parser(
        prog="vsx",
        description="A robot with one ordinary camera explores and maps a building by itself.",
        epilog="exit codes: 0 done, 1 usage or failed check, 2 hardware, 3 tracking lost for good, 4 stopped by the "
        "operator, 5 internal error",
    )
    root.add_argument("--version", action="version", version=f"vsx_ros {__version__}")
    root.add_argument("--debug", action="store_true", help="show where an error came from (anywhere on the line)")
    subparsers = root.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    for name in COMMANDS:
        module = importlib.import_module(f"vsx_ros.cli.{name}")
        title, description, *epilog = (module.__doc__ or "\n\n").split("\n\n")
        command = subparsers.add_parser(
            name, help=title.partition(": ")[2], description=description, epilog="".join(epilog) or None
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return root


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of a command line; ``line`` is the line that repeats it."""
    words = [word for word in arguments if word != "--debug"]
    args = parser().parse_args(words)
    args.debug, args.line = len(words) < len(arguments), ["vsx", *words]
    return args


def execute(arguments: Sequence[str]) -> int:
    """Run one command line; its exit code. Errors are one sentence on stderr, with a traceback only after --debug."""
    debug = "--debug" in arguments
    try:
        args = parse(arguments)
        load_plugins()
        code: int = args.run(args)
        return streams.ended(code)
    except KeyboardInterrupt:
        return _failed("stopped by the operator", STOPPED, debug=debug)
    except VsxError as error:
        return _failed(str(error), FAILED, debug=debug)
    except ModuleNotFoundError as error:
        return _failed(
            f"there is no Python package {error.name!r} here; 'vsx doctor' tells what is missing, and what to type",
            FAILED,
            debug=debug,
        )
    except Exception as error:
        if isinstance(error, OSError) and disk_trouble(error):
            return _failed(disk_trouble(error), FAILED, debug=debug)
        from vsx_hw.errors import DeviceError

        if isinstance(error, DeviceError):
            return _failed(str(error), HARDWARE, debug=debug)
        place = traceback.extract_tb(error.__traceback__)[-1]
        return _failed(
            f"internal error, please report it: {type(error).__name__}: {error} ({os.path.basename(place.filename)}, "
            f"line {place.lineno}); --debug shows where it came from",
            INTERNAL,
            debug=debug,
        )


def _failed(sentence: str, code: int, *, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    print(f"vsx: {sentence}", file=sys.stderr)
    return code


def main() -> NoReturn:
    """The console script. Threads inside of small matrix products only fight for the cores, and cost bits."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    streams.never_fail()
    sys.exit(execute(sys.argv[1:]))


if __name__ == "__main__":
    main()
