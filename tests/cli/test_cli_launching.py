"""What launch_py/*.py tell the nodes."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

from vsx_ros.cli import launching
from vsx_ros.runs.world import open_world, save_world


def told(name: str, *words: str) -> dict[str, Any]:
    """The parameters of all nodes by name."""
    nodes = launching.nodes_of(name, launching.parser(name).parse_args(words))
    params = {key: value for node in nodes for key, value in node.params.items()}
    assert len({node.params["run_dir"] for node in nodes if "run_dir" in node.params}) <= 1, "all write to one"
    return params


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the user is; the nodes are elsewhere."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_nodes_in_another_folder_find_the_user_s_files(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ["--run-dir", "runs/today", "--load-map", "lab.vsxmap", "--zones", "zones.yaml"]
    given = told("explore", *files, "--camera-info-url", "cal.yaml")
    assert given["run_dir"] == str(here / "runs/today")
    assert (given["load_map"], given["zones"]) == (str(here / "lab.vsxmap"), str(here / "zones.yaml"))
    assert given["camera_info_url"] == str(here / "cal.yaml")
    monkeypatch.setenv("ROS_HOME", str(here / "ros"))
    monkeypatch.setenv("HOME", str(here / "home"))
    urls = {"file://cal.yaml": "cal.yaml", "file://${ROS_HOME}/cal.yaml": "ros/cal.yaml", "~/cal.yaml": "home/cal.yaml"}
    for url, file in urls.items():
        assert told("bringup", "--camera-info-url", url)["camera_info_url"] == str(here / file)


@pytest.mark.parametrize("is_empty", [False, True])
@pytest.mark.parametrize("name", ["${ROS_HOME}", "$ROS_HOME"])
def test_the_usual_folder_of_ros_needs_no_variable(
    is_empty: bool, name: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The usual URL in ROS is file://${ROS_HOME}/camera_info/NAME.yaml, and hardly anybody sets ROS_HOME."""
    monkeypatch.setenv("HOME", str(here / "home"))
    monkeypatch.setenv("ROS_HOME_2", "another")
    monkeypatch.setenv("ROS_HOME", "")
    if not is_empty:
        monkeypatch.delenv("ROS_HOME")
    given = told("bringup", "--camera-info-url", f"file://{name}/camera_info/cal.yaml")
    assert given["camera_info_url"] == str(here / "home/.ros/camera_info/cal.yaml")
    assert told("bringup", "--camera-info-url", "$ROS_HOME_2")["camera_info_url"] == str(here / "another")


def test_the_emulator_finds_the_user_s_world(here: Path) -> None:
    save_world(open_world("lab", 3), here / "mine.yaml")
    given = told("simulate", "--world", "mine.yaml", "--devices", "wires")
    assert given["world"] == str(here / "mine.yaml")
    assert given["port"] == str(here / "wires/vsx_base")
    (here / "lab").touch()
    assert told("simulate", "--world", "lab:night")["world"] == "lab:night"
    assert told("simulate")["world"] == "lab"


def test_a_replay_finds_the_user_s_folder_and_bag(here: Path) -> None:
    nodes = launching.nodes_of("replay", launching.parser("replay").parse_args(["--bag", "a.bag", "--run-dir", "run"]))
    assert nodes[0].params["run_dir"] == str(here / "run")
    assert f" {here / 'a.bag'} " in nodes[1].args


@pytest.mark.parametrize("word", ["auto", "none", ""])
def test_words_for_no_folder_stay_words(here: Path, word: str) -> None:
    assert told("explore", "--run-dir", word)["run_dir"] == word
    assert told("explore")["run_dir"] == "auto"


def test_a_dock_may_be_at_a_negative_place() -> None:
    assert told("simulate", "--dock", "-1,2,90")["dock"] == "-1,2,90"


@pytest.mark.parametrize(
    ("name", "option", "value", "said"),
    [
        ("simulate", "--dock", "-1,2", "'-1,2' is not a pose; write X,Y,DEG"),
        ("simulate", "--rate-hz", "0", "0 images a second; give 1 to 60"),
        ("replay", "--rate", "-1", "-1: give a positive number"),
        ("replay", "--rate", "nan", "nan: give a positive number"),
    ],
)
def test_what_a_node_would_refuse_is_refused_before_it_starts(
    name: str, option: str, value: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = ["--bag", "a.bag"] if name == "replay" else []
    with pytest.raises(SystemExit):
        told(name, *bag, option, value)
    assert f"argument {option}: {said}" in capsys.readouterr().err
