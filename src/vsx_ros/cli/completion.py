"""``vsx completion``: a script by which a shell completes the words of a command line."""

import argparse

import shtab

_ZSH_FIRST = "autoload -U compinit; (( $+functions[compdef] )) || compinit -u\n"


def completion(args: argparse.Namespace) -> int:
    """Print the script."""
    from vsx_ros.cli.main import parser

    print(script(parser(), args.shell))
    return 0


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for bash or zsh: commands, options and their choices; files where a value may be anything."""
    _prepare(parser)
    return (_ZSH_FIRST if shell == "zsh" else "") + shtab.complete(parser, shell)


def _prepare(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if isinstance(action.metavar, str):
            action.metavar = action.metavar.replace(":", " ")  # which shtab does not escape for zsh
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _prepare(below)
        elif action.choices is None and action.nargs != 0:
            action.complete = shtab.FILE  # type: ignore[attr-defined]  # how shtab is told
