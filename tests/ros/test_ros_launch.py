"""The launch table for Python and the .launch files for roslaunch describe the same nodes."""

import os
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import roslaunch.config
import yaml

from vsx_ros.cli import launching
from vsx_ros.cli.main import execute, parse
from vsx_ros.config import Config, to_dict
from vsx_ros.errors import ConfigError
from vsx_ros.ros import environment, launch, replay, topics
from vsx_ros.ros.nodes import vslam
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.parameters import update_robot_file
from vsx_ros.runs.start import DEFAULTS

CHECKOUT = Path(__file__).resolve().parents[2]


def described(files: list[Any], texts: list[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Nodes and parameters as roslaunch understands them; no master needed."""
    config = roslaunch.config.load_config_default(files, 11311, roslaunch_strs=texts, verbose=False)
    nodes = {
        node.namespace + node.name: (
            node.package,
            node.type,
            shlex.split(node.args),
            node.respawn,
            node.required,
            node.output,
            dict(node.env_args),
            f"{node.namespace}{node.name}/" in config.clear_params,
        )
        for node in config.nodes
    }
    given = {name: param.value for name, param in config.params.items() if not name.startswith("/ros")}
    if "/run_dir" in given:
        run_dir = Path(given.pop("/run_dir"))
        assert run_dir.is_absolute()
        assert not run_dir.exists(), "the nodes make it"
    return nodes, dict(leaf for name, value in given.items() for leaf in leaves(name, value))


def leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """A tree is one parameter to roslaunch and many to the master."""
    if isinstance(value, dict):
        for key, below in value.items():
            yield from leaves(f"{name}/{key}", below)
    else:
        yield name, value


@pytest.fixture(autouse=True)
def robot_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{CHECKOUT}:/usr/share")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "args", "nodes"),
    [
        ("bringup", [], launch.bringup()),
        ("explore", ["base:=create", "planner:=unconstrained"], [
            *launch.bringup("create"),
            *launch.exploration("unconstrained"), *launch.keeping(),
        ]),
        ("explore", ["base:=ros", "camera:=ros"], [
            *launch.bringup("ros", camera="ros"),
            *launch.exploration(), *launch.keeping(camera="ros"),
        ]),
        ("simulate", ["seed:=3", "devices:=/dev/shm", "rate_hz:=30"], [
            *launch.emulation("lab", 3, "/dev/shm", rate_hz=30.0),
            *launch.exploration(seed=3), *launch.keeping(emulated=True),
        ]),
    ],
)  # fmt: skip
def test_launch_files_and_the_table_agree(name: str, args: list[str], nodes: list[launch.LaunchNode]) -> None:
    by_file = described([(str(CHECKOUT / "launch" / f"{name}.launch"), args)], [])
    assert by_file == described([], [launch.xml(nodes, to_dict(Config()))])
    assert ("/camera" in by_file[0]) != ("camera:=ros" in args), "its images come without a node of ours"


def test_topics_and_cameras_that_cannot_be_are_refused_before_any_node_starts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("vsx_ros.cli.explore.compile_kernels", lambda *_: pytest.fail("compiles"))
    assert execute(["explore", "--base", "ros:odom"]) == 1
    assert "base ros:odom: give two topics" in capsys.readouterr().err
    options = launching.parser("explore")
    with pytest.raises(ConfigError, match="base ros:odom: give two topics"):
        launching.nodes_of("explore", options.parse_args(["--base", "ros:odom"]))
    with pytest.raises(SystemExit):
        options.parse_args(["--camera", "x"])
    assert "'x' is no camera; write kinect" in capsys.readouterr().err


def test_worlds_begin_with_one_seed() -> None:
    _, params = described([str(CHECKOUT / "launch" / "simulate.launch")], [])
    seeds = params["/emulator/seed"], launching.parser("simulate").parse_args([]).seed
    assert {*seeds, parse(["world", "lab"]).seed, DEFAULTS["seed"]} == {1}


def test_vslam_takes_no_parameter_of_an_earlier_launch_from_the_master() -> None:
    recording, args = SimpleNamespace(odometry=[]), parse(["replay", "a.bag", "--ros", "--save-map", "lab.vsxmap"])
    replayed = replay._slam(args, recording, RunFolder(Path("run")))
    told = [node.params.keys() for node in (replayed, launch.replay("a.bag")[0], launch.exploration()[0])]
    assert told[0] == told[1] == told[2]
    assert set(told[0]) == set(re.findall(r"~(\w+)", vslam.__doc__.partition("Parameters:")[2])) - {
        "config",
        "save_map_to",
        "publish_tf",
    }


def test_a_replay_takes_a_configuration(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("planner: {phi_rad_m: 0.625}\n")
    words = ["bag:=/data/a.bag", f"config:={tmp_path / 'mine.yaml'}"]
    _, params = described([(str(CHECKOUT / "launch" / "replay.launch"), words)], [])
    assert params["/config/planner/phi_rad_m"] == 0.625


@pytest.mark.parametrize(("odometry", "factors"), [
    ("/odom", "/mobile_base/odometry_factors"), ("/robot2/odom", "/robot2/mobile_base/odometry_factors"),
])  # fmt: skip
def test_replay_agrees_too(odometry: str, factors: str) -> None:
    words = ["bag:=/data/my drive.bag", "rate:=2", "image_topic:=/cam/image", f"odometry_topic:={odometry}"]
    nodes, params = described([(str(CHECKOUT / "launch" / "replay.launch"), words)], [])
    table = launch.replay("/data/my drive.bag", 2, named=launch.BagTopics("/cam/image", odometry=odometry))
    assert (nodes, params) == described([], [launch.xml(table, {}, {"/use_sim_time": True})])
    assert nodes["/vslam"][2] == ["camera/rgb/image_raw:=/cam/image"], "a name such as image_rect tells how to see them"
    assert "/data/my drive.bag" in nodes["/player"][2]
    assert not any("image_raw" in word for word in nodes["/player"][2])
    assert factors in nodes["/player"][2], "what is found while driving multiplies them"
    assert f"{factors}:=mobile_base/odometry_factors" in nodes["/player"][2]
    assert "/cam/shutter" in nodes["/player"][2]
    assert "/cam/shutter:=camera/rgb/shutter" in nodes["/player"][2]
    assert params["/use_sim_time"] is True


@pytest.mark.parametrize("way", ["file", "script"])
def test_a_replay_in_a_namespace_has_the_time_of_the_bag(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """/clock and /use_sim_time are of all nodes of a master."""
    monkeypatch.setenv("ROS_NAMESPACE", "robot2")
    if way == "file":
        files: list[Any] = [(str(CHECKOUT / "launch" / "replay.launch"), ["bag:=/data/a.bag", "run_dir:=none"])]
        nodes, params = described(files, [])
    else:
        texts: list[str] = []
        monkeypatch.setenv("ROS_MASTER_URI", environment.DEFAULT_MASTER)
        monkeypatch.setattr(launching.logs, "quiet_failures", lambda: None)
        monkeypatch.setattr(launch, "start", lambda text, **_: (texts.append(text), SimpleNamespace(spin=int))[1])
        monkeypatch.setattr(sys, "argv", ["replay.py", "--bag", "/data/a.bag", "--run-dir", "none"])
        with pytest.raises(SystemExit):
            launching.main()
        nodes, params = described([], texts)
    assert set(nodes) == {"/robot2/vslam", "/robot2/player"}
    assert [name for name in params if "use_sim_time" in name] == ["/use_sim_time"]


def test_a_configuration_file_reaches_every_node(tmp_path: Path) -> None:
    tree = to_dict(Config())
    tree["planner"]["phi_rad_m"] = 0.625
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    _, by_file = described([(str(CHECKOUT / "launch" / "explore.launch"), [f"config:={file}"])], [])
    nodes = [*launch.bringup(), *launch.exploration(), *launch.keeping()]
    _, by_table = described([], [launch.xml(nodes, tree)])
    assert by_file == by_table
    assert by_file["/config/planner/phi_rad_m"] == 0.625


def test_roslaunch_takes_what_this_robot_s_calibrations_found(robot_home: Path) -> None:
    update_robot_file(robot_home / "vsx_ros" / "robot.yaml", "robot.odometry", {"linear_scale": 1.0125}, "measured")
    for name, found in {"bringup": 1.0125, "explore": 1.0125, "simulate": 1.0}.items():
        _, params = described([str(CHECKOUT / "launch" / f"{name}.launch")], [])
        assert params["/config/robot/odometry/linear_scale"] == found, name


def test_every_launch_names_a_folder_of_its_own_and_makes_none(robot_home: Path) -> None:
    """roslaunch evaluates the file for --nodes, --args and --dump-params, too."""
    for name, words in {"explore": [], "replay": ["bag:=/data/a.bag"]}.items():
        file = str(CHECKOUT / "launch" / f"{name}.launch")
        loaded = [roslaunch.config.load_config_default([(file, words)], 11311, verbose=False) for _ in range(2)]
        first, second = (Path(config.params["/run_dir"].value) for config in loaded)
        assert first != second
        assert first.parent == second.parent == robot_home / "runs"
        assert first.name.endswith("_ros")
        for told in ("none", str(robot_home / "mine")):
            given = (file, [*words, f"run_dir:={told}"])
            assert "/run_dir" not in roslaunch.config.load_config_default([given], 11311, verbose=False).params
    assert not list(robot_home.iterdir())


def test_every_node_of_the_table_has_a_starter() -> None:
    kept = [*launch.exploration(), *launch.keeping()]
    nodes = [*launch.emulation("lab"), *kept, *launch.view(), launch.LaunchNode("teleop", {})]
    assert {node.name for node in nodes} == set(topics.PUBLISHED)
    for node in nodes:
        starter = CHECKOUT / "scripts" / node.name
        assert os.access(starter, os.X_OK)


def test_names_are_relative_so_that_a_namespace_gives_a_second_robot() -> None:
    published = {topic for node in topics.PUBLISHED.values() for topic in node}
    served = {service for node in topics.SERVICES.values() for service in node}
    assert {name for name in published | served if name.startswith("/")} == {topics.TF, topics.TF_STATIC}


def test_markup_in_values_stays_text() -> None:
    node = launch.LaunchNode("camera", {"device": 'v4l:0"><evil/>'})
    _, params = described([], [launch.xml([node], {})])
    assert params == {"/camera/device": 'v4l:0"><evil/>'}


def test_without_a_checkout_the_run_says_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(environment, "__file__", str(tmp_path / "a" / "b" / "c" / "environment.py"))
    with pytest.raises(ConfigError, match="checkout"):
        environment.package_environment()
