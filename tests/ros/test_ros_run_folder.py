"""What the node run_folder writes of a launch, and takes from a run that is resumed, without a master."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy

from vsx_ros.cli.main import parse
from vsx_ros.config import Config
from vsx_ros.ros.nodes.run_folder import RunFolderNode
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.start import DEFAULTS, REMEMBERED, begin


@pytest.fixture
def params(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Those of the launch."""
    told: dict[str, Any] = {"emulator/world": "lab", "emulator/seed": 3, "emulator/rate_hz": 20.0}
    monkeypatch.setattr(rospy, "get_param", lambda name, default: told.get(name, default))
    return told


def begun(folder: RunFolder) -> Any:
    node: Any = RunFolderNode.__new__(RunFolderNode)
    node._config = Config()
    node._begin(folder)
    return node._about


def test_a_launch_is_resumed_with_its_options(params: dict[str, Any], tmp_path: Path) -> None:
    params |= {"vslam/load_map": "lab.vsxmap", "vslam/room": "hall"}
    folder = RunFolder(tmp_path / "run")
    begun(folder)
    args = parse(["explore", "--resume", str(folder.path)])
    begin(args)
    assert (args.world, args.seed, args.rate, args.room) == ("lab", 3, 20.0, "hall")
    assert args.load_map == str(Path("lab.vsxmap").resolve())
    assert (args.base, args.port) == (DEFAULTS["base"], DEFAULTS["port"]), "no mobile_base was launched"
    assert set(REMEMBERED) <= set(folder.read_config()[1])


def test_a_resumed_launch_knows_which_map_it_continued(params: dict[str, Any], tmp_path: Path) -> None:
    """Its map lies anywhere in the world, so that nothing may be judged by the truth."""
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["roslaunch"], load_map="/maps/lab.vsxmap")
    folder.checkpoint.path.mkdir()
    (folder.checkpoint.path / "map.zip").touch()
    assert begun(folder).load_map == "/maps/lab.vsxmap"
    params["vslam/load_map"] = "/maps/other.vsxmap"  # vslam does not read it either
    assert begun(folder).load_map == "/maps/lab.vsxmap"
