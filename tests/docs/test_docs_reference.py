"""docs/reference.md has the commands, options, nodes, topics and services of the code."""

import pkgutil
import re
from pathlib import Path

import pytest

from vsx_ros.cli.reference import reference
from vsx_ros.ros import nodes

ROSPYS_OWN = {"~get_loggers", "~set_logger_level"}
PRIVATE = re.compile(r"~\w+")
PAGE = Path(__file__).resolve().parents[2] / "docs/reference.md"


def names(text: str) -> list[str]:
    """Headings, of tables all cells in backticks, and private parameters; wording may lag behind until 'make docs'."""
    lines = [
        part
        for line in text.splitlines()
        for part in ([line] if line.startswith(("#", "| ")) else PRIVATE.findall(line))
    ]
    return [line if line.startswith("#") else line.split("` |")[0] for line in lines]


def test_the_reference_is_that_of_the_code():
    written = PAGE.read_text(encoding="utf-8")
    assert names(written) == names(reference()), "write it again: make docs"


def test_it_holds_what_users_look_for():
    text = reference()
    for words in ("### vsx calibrate camera", "| `--board CxRxM` |", "| vslam | `map` | nav_msgs/OccupancyGrid |"):
        assert words in text
    assert "%(" not in text


@pytest.mark.parametrize("name", [module.name for module in pkgutil.iter_modules(nodes.__path__)])
def test_a_node_names_every_private_parameter_it_has(name):
    source = (Path(nodes.__path__[0]) / f"{name}.py").read_text(encoding="utf-8")
    words, code = source.split('"""', 2)[1:]
    assert set(re.findall(r'"(~\w+)"', code)) - ROSPYS_OWN <= set(PRIVATE.findall(words))
