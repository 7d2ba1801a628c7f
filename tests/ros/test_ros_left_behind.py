"""What a killed replay leaves at the master does not stop the next start. Without a master."""

import argparse
from typing import Any

import pytest

pytest.importorskip("rospy")

import rosgraph

from vsx_ros.cli.main import parse
from vsx_ros.errors import ConfigError
from vsx_ros.ros import left_behind, replay, run
from vsx_ros.ros.fork_server import ForkServer
from vsx_ros.ros.live_run import refuse_second_robot


class Master:
    """A master, as asked through rosgraph. publishers: names of nodes by topic; alive: those that listen."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.params: dict[str, Any] = {}
        self.publishers: dict[str, list[str]] = {}
        self.alive = set[str]()
        monkeypatch.setattr(rosgraph, "Master", lambda _: self)
        monkeypatch.setattr(rosgraph, "is_master_online", lambda: True)
        monkeypatch.setattr(left_behind, "answers_at", lambda address: address in self.alive)
        monkeypatch.setattr(replay.rospy, "resolve_name", lambda name: f"/{name.lstrip('/')}")
        self.hasParam, self.getParam = self.params.__contains__, self.params.get  # noqa: N815 - rosgraph's names
        self.deleteParam = self.params.pop  # noqa: N815

    def getSystemState(self) -> list[Any]:  # noqa: N802
        return [[[topic, names] for topic, names in self.publishers.items()], [], []]

    def lookupNode(self, name: str) -> str:  # noqa: N802
        if name not in {each for names in self.publishers.values() for each in names}:
            raise rosgraph.MasterException("unknown node")
        return name


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch) -> Master:
    return Master(monkeypatch)


def test_the_time_of_a_killed_replay_is_cleared_and_said(master: Master) -> None:
    master.params["/use_sim_time"], master.publishers["/clock"] = True, ["/run_1"]
    said = left_behind.end_standing_time()
    assert "/run_1" in said
    assert "deleted" in said
    assert master.params == {}
    assert left_behind.end_standing_time() == ""


def test_a_time_that_runs_is_left_alone(master: Master) -> None:
    master.params["/use_sim_time"], master.publishers["/clock"] = True, ["/run_1", "/gazebo"]
    master.alive = {"/gazebo"}
    assert left_behind.end_standing_time() == ""
    assert master.params == {"/use_sim_time": True}


def test_a_time_that_nobody_gives_is_told_with_its_remedy(master: Master) -> None:
    """Somebody may be about to play a bag."""
    master.params["/use_sim_time"] = True
    assert "rosparam delete /use_sim_time" in left_behind.end_standing_time()
    assert master.params == {"/use_sim_time": True}


@pytest.mark.parametrize("params", [{}, {"/use_sim_time": False}])
def test_usual_time_needs_no_words(master: Master, params: dict[str, bool]) -> None:
    master.params.update(params)
    master.publishers["/clock"] = ["/run_1"]
    assert left_behind.end_standing_time() == ""


def test_a_killed_replay_is_no_company_for_the_next(master: Master) -> None:
    master.publishers = {"/clock": ["/run_1"], "/odom": ["/mobile_base"], "/camera/rgb/image_raw": []}
    replay._refuse_company()
    master.alive = {"/mobile_base"}
    with pytest.raises(ConfigError, match="/mobile_base already publishes /odom"):
        replay._refuse_company()


def test_a_node_that_is_gone_is_no_second_robot(master: Master) -> None:
    master.publishers["/odom"] = ["/mobile_base"]
    refuse_second_robot(["mobile_base", "camera"])
    master.alive = {"/mobile_base"}
    with pytest.raises(ConfigError, match="node /mobile_base runs already"):
        refuse_second_robot(["camera", "mobile_base"])


@pytest.mark.parametrize(
    ("words", "is_refused"),
    [
        ((), True),
        (("--world", "lab"), True),
        (("--camera", "v4l:0"), True),
        (("--camera", "ros:/cam/image_raw"), True),
        (("--camera", "ros"), False),
        (("--resume", "run"), False),
        (("--resume", "run", "--camera", "kinect"), True),
    ],
)
def test_a_driver_whose_node_is_called_camera_is_in_the_way_of_our_own_node_alone(
    words: tuple[str, ...], is_refused: bool, master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The camera of a run to resume is known later, when the live run asks for the names of all its nodes."""

    class BegunError(Exception):
        """The run begins its folder."""

    def begin(_: argparse.Namespace) -> None:
        raise BegunError

    monkeypatch.setattr(run, "begin", begin)
    master.publishers["/camera/rgb/image_raw"], master.alive = ["/camera"], {"/camera"}
    with ForkServer() as forks, pytest.raises(ConfigError if is_refused else BegunError):
        run._explore(parse(["explore", *words]), forks)
