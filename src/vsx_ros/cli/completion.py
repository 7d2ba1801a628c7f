"""``vsx completion``: print a completion script for the shell

Prints a script by which bash or zsh complete the words of vsx; file names where a file is meant.

add to ~/.bashrc: eval "$(vsx completion bash)" | to ~/.zshrc: eval "$(vsx completion zsh)"
"""

import argparse
from collections.abc import Iterator

_BASH = """\
# Completion of vsx, made by 'vsx completion'.
_vsx_words() {{  # what may follow these words
    case "$1" in
{words}
        *) return 1 ;;
    esac
}}
_vsx_values() {{  # what an option takes; nothing where it may be anything
    case "$1" in
{values}
        *) return 1 ;;
    esac
}}
_vsx() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" said="vsx" offered i
    for ((i = 1; i < COMP_CWORD; i++)); do
        _vsx_words "$said ${{COMP_WORDS[i]}}" >/dev/null && said="$said ${{COMP_WORDS[i]}}"
    done
    offered="$(_vsx_values "$said $before")" || offered="$(_vsx_words "$said")"
    COMPREPLY=($(compgen -W "$offered" -- "$word"))
}}
complete -o default -F _vsx vsx
"""
_ZSH = "autoload -U +X compinit bashcompinit && compinit -u && bashcompinit\n"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("shell", choices=("bash", "zsh"), help="which shell")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from vsx_ros.cli.main import parser

    print(for_zsh(parser()) if args.shell == "zsh" else script(parser()), end="")
    return 0


def for_zsh(parser: argparse.ArgumentParser) -> str:
    """The script of bash, behind what lets zsh run it."""
    return _ZSH + script(parser)


def script(parser: argparse.ArgumentParser) -> str:
    """The bash script of a command line; zsh runs it, too, after bashcompinit."""
    commands, values = [], []
    for path, level in _levels(parser, parser.prog):
        words: list[str] = []
        for action in level._actions:
            words += [option for option in action.option_strings if option.startswith("--")]
            choices = " ".join(map(str, action.choices)) if action.choices is not None else ""
            if not action.option_strings:
                words += choices.split()
            elif action.nargs != 0:
                values += [_case(f"{path} {option}", choices) for option in action.option_strings]
        commands.append(_case(path, " ".join(words)))
    return _BASH.format(words="\n".join(commands), values="\n".join(values))


def _case(words: str, answer: str) -> str:
    return f"        '{words}') echo '{answer}' ;;"


def _levels(parser: argparse.ArgumentParser, path: str) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The parser and all below it, each with the words that lead to it."""
    yield path, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from _levels(below, f"{path} {name}")
