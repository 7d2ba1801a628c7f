"""A master that lasts keeps the parameters of every launch; the next one takes none of them."""

import logging
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rosgraph
import roslaunch.config
import roslaunch.launch
from ros_ports import free_port
from test_ros_master_watch import Graph

from vsx_ros.config import Config, from_dict, to_dict
from vsx_ros.ros import launch
from vsx_ros.runs.parameters import load

CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[rosgraph.Master]:
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{CHECKOUT}:/usr/share")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    port = free_port()
    monkeypatch.setenv("ROS_MASTER_URI", f"http://localhost:{port}/")
    graph = Graph(port)
    yield graph.asked
    graph.end()


def sent(files: list[Any], texts: list[str]) -> None:
    """All that roslaunch does before it starts nodes."""
    config = roslaunch.config.load_config_default(files, None, roslaunch_strs=texts, verbose=False)
    asked: Any = SimpleNamespace(config=config, logger=logging.getLogger("roslaunch"))
    roslaunch.launch.ROSLaunchRunner._load_parameters(asked)


@pytest.fixture
def partial_files(tmp_path: Path) -> tuple[Path, Path]:
    slow, body = tmp_path / "slow.yaml", tmp_path / "body.yaml"
    slow.write_text("limits: {v_m_s: 0.25}\n", encoding="utf-8")
    body.write_text("robot: {radius_m: 0.11}\n", encoding="utf-8")
    return slow, body


@pytest.mark.parametrize(("name", "words"), [("bringup", []), ("explore", []), ("replay", ["bag:=/data/a.bag"])])
def test_a_partial_file_means_the_defaults_for_what_it_leaves_out(
    master: rosgraph.Master, partial_files: tuple[Path, Path], name: str, words: list[str]
) -> None:
    for file in partial_files:
        sent([(str(CHECKOUT / "launch" / f"{name}.launch"), [*words, f"config:={file}"])], [])
        assert from_dict(master.getParam("/config")) == load(file, [])


def test_a_replay_without_a_file_has_the_defaults(master: rosgraph.Master, partial_files: tuple[Path, Path]) -> None:
    for config in (f"config:={partial_files[0]}", "config:="):
        sent([(str(CHECKOUT / "launch" / "replay.launch"), ["bag:=/data/a.bag", config])], [])
    assert not master.hasParam("/config")


def test_a_name_that_no_node_knows_is_gone_with_its_launch(master: rosgraph.Master) -> None:
    """They would end again, though the file was mended."""
    nodes = launch.exploration()
    sent([], [launch.xml(nodes, {"robot": {"radios_m": 0.11}})])
    sent([], [launch.xml(nodes, to_dict(Config()))])
    assert from_dict(master.getParam("/config")) == Config()


@pytest.mark.parametrize("way", ["vsx", "roslaunch"])
def test_what_clients_changed_is_gone_with_its_launch(master: rosgraph.Master, way: str) -> None:
    """dynamic_reconfigure's server keeps all its values there from its start on, changed or not."""
    file = (str(CHECKOUT / "launch" / "exploration.launch"), ["run_dir:=none"])
    texts = [launch.xml(launch.exploration(), to_dict(Config()))]
    for _ in range(2):
        sent([file] if way == "roslaunch" else [], texts if way == "vsx" else [])
        assert master.getParam("/move_base") == {"planner": "fov", "seed": 0}
        master.setParam("/move_base/phi_rad_m", 2.0)
