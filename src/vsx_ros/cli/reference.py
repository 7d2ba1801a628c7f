"""The reference of commands, nodes, topics and services, made from the code.

``python -m vsx_ros.cli.reference > docs/reference.md`` writes it; a test compares the two."""

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Iterator

from vsx_ros.cli.main import parser
from vsx_ros.ros import nodes, topics

_ABOUT = """\
# Reference

Written by `python -m vsx_ros.cli.reference > docs/reference.md`; parameters with units, bounds and defaults are in
`config/default.yaml`, which `scripts/vsx config` prints. `scripts/vsx COMMAND --help` says more about each command.
Exit codes: 0 done, 1 usage or failed check, 2 hardware, 3 tracking lost for good, 4 stopped by the operator, 5 internal
error.
"""


def reference() -> str:
    """The whole page."""
    parts = [_ABOUT, "## Commands\n", *_commands(parser(), "vsx"), "## Nodes\n", *_nodes(), "## Topics\n", _topics()]
    return "\n".join([*parts, "## Services\n", _table("offers", topics.SERVICES)])


def _commands(level: argparse.ArgumentParser, path: str) -> Iterator[str]:
    below = [action for action in level._actions if isinstance(action, argparse._SubParsersAction)]
    for action in below:
        about = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, command in action.choices.items():
            said = _cell(about.get(name, ""))
            yield f"### {path} {name}\n\n{said[:1].upper()}{said[1:]}.\n"
            if rows := [*_options(command)]:
                yield "\n".join(["| | |", "|---|---|", *rows, ""])
            yield from _commands(command, f"{path} {name}")


def _options(command: argparse.ArgumentParser) -> Iterator[str]:
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            continue
        choices = "|".join(map(str, action.choices)) if action.choices is not None else ""
        value = "" if action.nargs == 0 else str(action.metavar or choices or action.dest.upper())
        words = " ".join(filter(None, [", ".join(action.option_strings), value]))
        yield f"| `{_cell(words)}` | {_cell(action.help or '')} |"


def _nodes() -> Iterator[str]:
    """The docstring of each node's module: its topics, services and private parameters."""
    for module in pkgutil.iter_modules(nodes.__path__):
        words = importlib.import_module(f"{nodes.__name__}.{module.name}").__doc__ or ""
        yield f"### {module.name}\n\n```\n{words.strip()}\n```\n"


def _topics() -> str:
    about = (
        "Names are relative: in a namespace they are below it, but for `/tf`, `/tf_static` and `/diagnostics`, which "
        "every node but teleop, dashboard and run_folder also publishes. Names of frames begin with the namespace "
        "(robot1/map), or with what the parameter `tf_prefix` in it or in one above says.\n\n"
    )
    return about + _table("publishes", topics.PUBLISHED)


def _table(verb: str, graph: dict[str, dict[str, str]]) -> str:
    rows = [f"| {node} | `{name}` | {kind} |" for node, offered in graph.items() for name, kind in offered.items()]
    return "\n".join([f"| node | {verb} | type |", "|---|---|---|", *rows, ""])


def _cell(text: str) -> str:
    return " ".join(text.replace("%%", "%").split()).replace("|", "\\|")


if __name__ == "__main__":
    sys.stdout.write(reference())
