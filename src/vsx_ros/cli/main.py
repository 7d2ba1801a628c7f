"""``vsx``: one command line for everything.

A command's options are a function whose docstring is its help: a line, what the command does, and examples or exit
codes. Its code is imported when it runs, so that help and usage errors come at once."""

import argparse
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import NoReturn

from vsx_ros import __version__
from vsx_ros.cli import options_places, options_robot, options_runs, options_study
from vsx_ros.cli.option_values import Parser
from vsx_ros.errors import VsxError, did_you_mean, disk_trouble
from vsx_ros.registry import load_plugins
from vsx_ros.runs import process
from vsx_ros.runs.process import FAILED, HARDWARE, INTERNAL, STOPPED

COMMANDS: dict[str, tuple[Callable[[argparse.ArgumentParser], None], str]] = {
    "explore": (options_runs.explore, "explore"),
    "replay": (options_runs.replay, "replay"),
    "record": (options_runs.record, "small_commands"),
    "plan": (options_study.plan, "plan"),
    "evaluate": (options_study.evaluate, "results"),
    "report": (options_study.report, "results"),
    "reproduce": (options_study.reproduce, "campaigns"),
    "sweep": (options_study.sweep, "campaigns"),
    "map": (options_runs.map, "maps"),
    "zone": (options_places.zone, "places"),
    "room": (options_places.room, "places"),
    "view": (options_robot.view, "small_commands"),
    "status": (options_robot.status, "small_commands"),
    "stop": (options_robot.stop, "small_commands"),
    "teleop": (options_robot.teleop, "small_commands"),
    "go": (options_robot.go, "small_commands"),
    "dock": (options_robot.dock, "small_commands"),
    "undock": (options_robot.undock, "small_commands"),
    "calibrate": (options_robot.calibrate, "calibrate"),
    "doctor": (options_robot.doctor, "doctor"),
    "config": (options_robot.config, "small_commands"),
    "world": (options_robot.world, "worlds"),
    "completion": (options_robot.completion, "small_commands"),
}
"""For each command its options and help, and the module in this package with the function of the same name."""


class _Parser(Parser):
    """A parser that reports mistakes in one sentence and ends with the project's exit code."""

    def error(self, message: str) -> NoReturn:
        self.exit(FAILED, f"{self.prog}: {message}{self._remark(message)}; '{self.prog} --help' lists what there is\n")

    def _remark(self, message: str) -> str:
        """The command, choice or option that resembles the one a message complains about; or how a value that looks
        like an option is given."""
        if lacking := re.fullmatch("argument (--[^ ]+): expected one argument", message):
            return f" (one that begins with '-' is given as {lacking[1]}=-...)"
        if option := re.search("unrecognized arguments: (-[^ =]+)", message):
            return did_you_mean(option[1], self._option_string_actions)
        choice = re.search("argument (.*?): invalid choice: '(.*?)'", message)
        of = [action for action in self._actions if choice and argparse._get_action_name(action) == choice[1]]
        return did_you_mean(choice[2], [str(each) for action in of for each in action.choices or ()]) if choice else ""

    def innermost(self, args: argparse.Namespace) -> argparse.ArgumentParser:
        """The parser of the chosen command, and of its verb if it has some."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction) and getattr(args, action.dest, None):
                chosen = action.choices[getattr(args, action.dest)]
                return chosen.innermost(args) if isinstance(chosen, _Parser) else chosen
        return self


def parser() -> _Parser:
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
    for name, (add_options, _) in COMMANDS.items():
        title, description, *epilog = inspect.cleandoc(add_options.__doc__ or "").split("\n\n")
        add_options(subparsers.add_parser(name, help=title, description=description, epilog="".join(epilog) or None))
    return root


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of a command line; ``line`` holds the words to repeat it."""
    words = [word for word in arguments if word != "--debug"]
    root = parser()
    args, unknown = root.parse_known_args(words)
    if unknown:
        root.innermost(args).error(f"unrecognized arguments: {' '.join(unknown)}")
    args.debug, args.line = len(words) < len(arguments), ["vsx", *words]
    return args


def run(args: argparse.Namespace) -> int:
    """Run the chosen command; returns the exit code."""
    module = importlib.import_module(f"vsx_ros.cli.{COMMANDS[args.command][1]}")
    code: int = getattr(module, args.command)(args)
    return code


def execute(arguments: Sequence[str]) -> int:
    """Run one command line; returns its exit code. Errors are one sentence on stderr; --debug adds a traceback."""
    try:
        args = parse(arguments)
        load_plugins()
        return process.ended(run(args))
    except (KeyboardInterrupt, Exception) as error:
        if "--debug" in arguments:
            traceback.print_exc()
        sentence, code = _explained(error)
        print(f"vsx: {sentence}", file=sys.stderr)
        return code


def _explained(error: BaseException) -> tuple[str, int]:
    """The error in one sentence, and the exit code."""
    foreign = any(importlib.util.find_spec(name) is None for name in ("numba", "msgspec"))
    match error:
        case KeyboardInterrupt():
            return "stopped by the operator", STOPPED
        case VsxError():
            return str(error), FAILED
        case _ if any(kind.__module__ == "vsx_hw.errors" for kind in type(error).__mro__):
            return str(error), HARDWARE
        case ModuleNotFoundError() if not foreign:
            remedy = "'vsx doctor' tells what is missing, and what to type"
            return f"there is no Python package {error.name!r} here; {remedy}", FAILED
        case OSError() if disk_trouble(error):
            return disk_trouble(error), FAILED
        case _ if foreign or isinstance(error, ImportError):
            words = f"{sys.executable} is not the Python of this checkout's environment ({error})"
            return f"{words}; start scripts/vsx, which finds it (scripts/demo makes it), or activate it", FAILED
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{os.path.basename(place.filename)}, line {place.lineno}"
    what = f"internal error, please report it: {type(error).__name__}: {error} ({where})"
    return f"{what}; --debug shows where it came from", INTERNAL


def main() -> NoReturn:
    """The console script. Threads inside small matrix products only compete for cores and change the last bits."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    process.never_fail()
    process.leave(execute(sys.argv[1:]))


if __name__ == "__main__":
    main()
