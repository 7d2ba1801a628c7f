"""What the node run_folder writes of a launch, and takes from a run that is resumed, without a master."""

import os
import subprocess
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy

from vsx_ros.cli.main import parse
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.ros.nodes import run_folder
from vsx_ros.ros.nodes.run_folder import RunFolderNode
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.hold import hold
from vsx_ros.runs.start import DEFAULTS, REMEMBERED, begin

HANGS_S = 60.0


@pytest.fixture
def params(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Those of the launch."""
    told: dict[str, Any] = {"emulator/world": "lab", "emulator/seed": 3, "emulator/rate_hz": 20.0}
    told |= {"~emulated": True, "emulator/dock": "1,2,90", "emulator/battery_pace": 40.0}
    monkeypatch.setattr(rospy, "get_param", lambda name, default: told.get(name, default))
    return told


def begun(folder: RunFolder) -> Any:
    node: Any = RunFolderNode.__new__(RunFolderNode)
    node._config = Config()
    node._begin(folder)
    return node._about


def test_a_launch_is_resumed_with_its_options(params: dict[str, Any], tmp_path: Path) -> None:
    params |= {"vslam/load_map": "lab.vsxmap", "vslam/room": "hall", "vslam/zones": "z.yaml"}
    folder = RunFolder(tmp_path / "run")
    begun(folder)
    args = parse(["explore", "--resume", str(folder.path)])
    with begin(args):
        pass
    assert (args.world, args.seed, args.rate, args.room) == ("lab", 3, 20.0, "hall")
    assert (args.dock, args.battery_pace) == ("1,2,90", 40.0)
    assert (args.load_map, args.zones) == tuple(str(Path(name).resolve()) for name in ("lab.vsxmap", "z.yaml"))
    assert (args.base, args.port) == (DEFAULTS["base"], DEFAULTS["port"]), "no mobile_base was launched"
    assert set(REMEMBERED) <= set(folder.read_config()[1])


def test_a_real_robot_is_not_judged_by_an_earlier_emulation(params: dict[str, Any], tmp_path: Path) -> None:
    """A master that lasts has the emulator's parameters for ever."""
    params["~emulated"] = False
    folder = RunFolder(tmp_path / "run")
    assert begun(folder).world is None
    assert not (folder.path / "world.yaml").exists()
    facts = folder.read_config()[1]
    assert [facts[name] for name in ("world", "seed", "rate", "dock", "battery_pace")] == [None, 0, None, None, None]


def test_a_driver_s_images_are_not_those_of_the_camera_of_an_earlier_launch(
    params: dict[str, Any], tmp_path: Path
) -> None:
    for told, kept in (("", "kinect"), ("ros", "ros")):
        params |= {"~camera": told, "camera/device": "kinect"}
        folder = RunFolder(tmp_path / kept)
        begun(folder)
        assert folder.read_config()[1]["camera"] == kept


def test_a_resumed_launch_knows_which_map_it_continued(params: dict[str, Any], tmp_path: Path) -> None:
    """Its map lies anywhere in the world, so that nothing may be judged by the truth."""
    folder = RunFolder.create(tmp_path / "run")
    folder.write_config(Config(), ["roslaunch"], load_map="/maps/lab.vsxmap")
    folder.checkpoint.path.mkdir()
    (folder.checkpoint.path / "map.zip").touch()
    assert begun(folder).load_map == "/maps/lab.vsxmap"
    params["vslam/load_map"] = "/maps/other.vsxmap"  # vslam does not read it either
    assert begun(folder).load_map == "/maps/lab.vsxmap"


def test_a_folder_in_which_another_run_works_is_refused(
    params: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = RunFolder(tmp_path / "run")
    begun(folder)
    monkeypatch.setattr(run_folder.node, "run_dir", lambda: str(folder.path))
    with hold(folder.path), pytest.raises(InputError, match="still works"):
        RunFolderNode(Config())
    assert not folder.witness.exists()


class Vslam:
    """A process that answers getPid as a node does, after so long."""

    def __init__(self, pid: int, after_s: float = 0.0) -> None:
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self._server.register_function(lambda _: (time.sleep(after_s), [1, "", pid])[1], "getPid")
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        self.uri = f"http://127.0.0.1:{self._server.server_address[1]}"


@pytest.fixture
def keeping(monkeypatch: pytest.MonkeyPatch) -> Any:
    """``keep(vslam)``: one look of the node while this vslam runs; returns whose results it waits for."""
    node: Any = RunFolderNode.__new__(RunFolderNode)
    node._vslam_pid, node._began_s, node._monitor = 0, None, SimpleNamespace(status={})
    node._journal = SimpleNamespace(keep=lambda *_: None, clock=SimpleNamespace(elapsed_s=0.0))
    monkeypatch.setattr(run_folder.headers, "now_ns", lambda: 1)

    def keep(vslam: Vslam) -> int:
        monkeypatch.setattr(rosgraph.Master, "lookupNode", lambda self, name: vslam.uri)
        node._keep()
        return int(node._vslam_pid)

    return keep


def test_the_results_of_a_vslam_that_was_started_again_are_awaited(keeping: Any) -> None:
    with subprocess.Popen(["sleep", "60"]) as first:
        assert keeping(Vslam(first.pid)) == first.pid
        assert keeping(Vslam(os.getpid())) == first.pid, "it lives"
        first.kill()
    assert keeping(Vslam(os.getpid())) == os.getpid()


def test_a_vslam_that_hangs_does_not_hold_up_the_journal(keeping: Any) -> None:
    hanging = Vslam(1, after_s=HANGS_S)
    assert keeping(hanging) == 0, "asked again at the next look"
