"""Completion as the shells themselves do it."""

import os
import shutil
import subprocess

import pytest
from waiting import PATIENCE_S

from vsx_ros.cli.main import COMMANDS, parser
from vsx_ros.cli.small_commands import script

ASK = '\nCOMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); _shtab_vsx; echo "${COMPREPLY[@]}"'

ASK_ZSH = r"""
zmodload zsh/zpty
zpty shell zsh -f -i
zpty -w shell 'eval "$(<'$1')"; source '$2
zpty -w -n shell "$3"$'\t'
zpty -r shell heard '*<END>*'
print -r -- "${${heard##*<BEGIN>}%%<END>*}"
zpty -d shell
"""
TELLING = r"""
compadd() {  # as it is, and what it would add is told
    local -a added
    if (( ! ${argv[(I)-[OAD]*]} )); then
        builtin compadd -O added "$@"
        offered+=("${added[@]}")
    fi
    builtin compadd "$@"
}
tell() { print -rn -- "<BEGIN>${offered[*]}<END>" }
offered=() comppostfuncs=(tell)
"""
"""The real shell at a terminal of its own; the tabulator is pressed once behind the line."""


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["st"], ["status", "stop"]),
        (["map", ""], ["info", "export", "save", "load"]),
        (["map", "export", "a.vsxmap", "--format", "p"], ["ply", "pgm", "planes"]),
        (["explore", "--base", ""], ["kobuki", "create", "create2", "auto", "ros"]),
        (["explore", "--world", "lab", "--fa"], ["--fast"]),
        (["completion", "z"], ["zsh"]),
        (["replay", "--out", ""], ["drive.bag"]),
        (["replay", ""], ["drive.bag"]),
        (["fly", ""], [*COMMANDS]),
    ],
)
def test_bash_offers_what_the_parser_takes(words, offered, tmp_path):
    (tmp_path / "drive.bag").touch()
    command = ["bash", "--norc", "-c", script(parser(), "bash") + ASK, "bash", "vsx", *words]
    said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert said.stdout.split() == offered


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("vsx st", ["status", "stop"]),
        ("vsx map ", ["info", "export", "save", "load"]),
        ("vsx map export a.vsxmap --format p", ["pgm", "planes", "ply"]),
        ("vsx explore --base ", ["kobuki", "create", "create2", "auto", "ros"]),
        ("vsx explore --world lab --fa", ["--fast"]),
        ("vsx replay ", ["drive.bag"]),
        ("vsx ", [*COMMANDS]),
    ],
)
def test_zsh_offers_the_same(line, offered, tmp_path):
    at = tmp_path / "folder"
    at.mkdir()
    (at / "drive.bag").touch()
    (tmp_path / "vsx.zsh").write_text(script(parser(), "zsh"))
    (tmp_path / "telling.zsh").write_text(TELLING)
    command = ["zsh", "-f", "-c", ASK_ZSH, "zsh", str(tmp_path / "vsx.zsh"), str(tmp_path / "telling.zsh"), line]
    there = {**os.environ, "ZDOTDIR": str(tmp_path), "TERM": "dumb"}
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S, env=there, cwd=at)
    assert sorted(said.stdout.split()) == sorted(offered)
