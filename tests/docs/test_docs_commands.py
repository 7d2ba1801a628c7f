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
TESTS = sorted((CHECKOUT / "tests").rglob("test_*.py"))


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


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_tests_that_a_page_names_exist(page: Path) -> None:
    named = set(re.findall(r"`(?:\w+:)?(test_\w+)(?:\.py)?`", page.read_text(encoding="utf-8")))
    there = {name for file in TESTS for name in (file.stem, *re.findall(r"^def (test_\w+)", file.read_text(), re.M))}
    assert named <= there, f"{page.name}: {sorted(named - there)}"


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_programs_that_a_page_runs_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for program in re.findall(r"python ((?:benchmarks|hw|examples)/\w+\.py)", text):
        assert (CHECKOUT / program).is_file(), f"{page.name}: {program}"


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_launch_files_that_a_page_names_have_the_arguments_given_there(page: Path) -> None:
    for name, words in re.findall(r"roslaunch vsx_ros (\w+)\.launch([^`#\n|]*)", page.read_text(encoding="utf-8")):
        given = set(re.findall(r"(\w+):=", words))
        assert given <= arguments(name), f"{page.name}: {name}.launch"


def arguments(name: str) -> set[str]:
    """Those of a launch file and of those that it includes with all of them."""
    text = (CHECKOUT / "launch" / f"{name}.launch").read_text(encoding="utf-8")
    passed = re.findall(r'launch/(\w+)\.launch" pass_all_args', text)
    return set(re.findall(r'<arg name="(\w+)" (?:default|doc)', text)).union(*map(arguments, passed))


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_no_parameter_is_set_before_there_is_a_master(page: Path) -> None:
    """vsx explore and roslaunch bring the master: what is set before needs a roscore."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer("rosparam (set|load)", text):
        assert "roscore" in text[max(0, found.start() - 400) : found.start()], f"{page.name}: {found[0]}"


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_a_container_keeps_what_a_robot_has_calibrated(page: Path) -> None:
    """Without the mounts it is deleted with the container, and nothing says so."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    for line in re.findall(r"docker run .*vsx_ros vsx .*", text):
        assert "-v $HOME/.ros:/root/.ros" in line, f"{page.name}: {line}"
        assert "vsx explore" not in line or "-v $PWD/runs:/opt/vsx_ros/runs" in line, f"{page.name}: {line}"
