"""Completion as the shells themselves do it."""

import shutil
import subprocess

import pytest

from vsx_ros.cli.completion import script
from vsx_ros.cli.main import COMMANDS, parser

ASK = '\nCOMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); _vsx; echo "${COMPREPLY[@]}"'


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["st"], ["status", "stop"]),
        (["map", ""], ["--help", "info", "export", "save", "load"]),
        (["map", "export", "a.vsxmap", "--format", "p"], ["ply"]),
        (["explore", "--base", ""], ["auto", "kobuki", "create", "create2"]),
        (["explore", "--world", "lab", "--fa"], ["--fast"]),
        (["completion", "z"], ["zsh"]),
        (["replay", "--out", ""], []),
        (["fly", ""], ["--help", "--version", "--debug", *COMMANDS]),
    ],
)
def test_bash_offers_what_the_parser_takes(words, offered):
    command = ["bash", "--norc", "-c", script(parser()) + ASK, "bash", "vsx", *words]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == offered


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_reads_the_script():
    from vsx_ros.cli.completion import for_zsh

    command = ["zsh", "-f", "-c", for_zsh(parser()) + "print ${_comps[vsx]}"]
    assert "_vsx" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
