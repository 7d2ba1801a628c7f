"""What the documents tell to type exists: commands, options, parameters, files."""

import re
import shlex
from pathlib import Path

import pytest

from vsx_ros.cli.main import parser
from vsx_ros.config import Config
from vsx_ros.runs.parameters import load

CHECKOUT = Path(__file__).resolve().parents[2]
PAGES = [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(CHECKOUT)) for page in PAGES]


def commands(text: str) -> list[list[str]]:
    """The words of each 'scripts/vsx ...' in fences and between backticks; a bare name in a table is none."""
    fences = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [line for fence in fences for line in fence.splitlines()]
    lines += re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    found = [re.match(r"\s*(?:\w+=\S+ )?scripts/(vsx|demo)\s+([^#|]*)", line) for line in lines]
    said = [(match[1], shlex.split(match[2].replace("...", "x").replace(" N", " 1"))) for match in found if match]
    return [(["explore"] if program == "demo" else []) + words for program, words in said]


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_are_taken_as_they_stand(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        if words == ["COMMAND", "--help"]:
            continue
        try:
            args = parser().parse_args([word for word in words if word != "&"])
        except SystemExit:
            pytest.fail(f"{page.name}: vsx {' '.join(words)}")
        load(None, getattr(args, "set", []))


def test_commands_are_found_in_the_documents() -> None:
    said = [words[0] for page in PAGES for words in commands(page.read_text(encoding="utf-8")) if words]
    assert {"explore", "replay", "record", "map", "doctor", "calibrate", "teleop", "stop"} <= set(said)


def anchors(text: str) -> set[str]:
    """Where a link can lead to within a page: its headings, as GitHub names them."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for target, _, anchor in re.findall(r"\]\(([^)#]*)(#([^)]+))?\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            file = page.parent / target if target else page
            assert file.exists(), f"{page.name}: {target}"
            assert not anchor or anchor in anchors(file.read_text(encoding="utf-8")), f"{page.name}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_parameters_exist(page: Path) -> None:
    branches = "|".join(Config.__struct_fields__)
    names = re.findall(rf"`((?:{branches})\.\w+(?:\.\w+)*)[`=]", page.read_text(encoding="utf-8"))
    for name in names:
        tree: object = load(None, [])
        for part in name.split("."):
            assert hasattr(tree, part), f"{page.name}: {name}"
            tree = getattr(tree, part)
