"""Where a session puts what the base meets: where the wheels say it is by now."""

import math

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import STOP, Odometry
from vsx_ros.session import SlamSession
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.system import ExplorationSystem

T_MAP_ODOM = SE2(1.0, 2.0, math.pi / 2)
BEGAN, WHEELS = Odometry(1, SE2(0.5, 0.0, 0.0)), Odometry(7, SE2(3.0, 0.5, 0.2), 0.2, 0.0)
"""The second perhaps metres after the last pose that the camera found."""


def session_at(T_map_odom: SE2) -> SlamSession:
    session = SlamSession(mounted(Config().robot.mount), Config())
    T_world_cam = SE3.from_se2(T_map_odom @ BEGAN.T_odom_base) @ session.T_base_cam
    session.locate(TrackingResult(1, TrackingState.GOOD, T_world_cam, 9, 9, False, ""), BEGAN)
    return session


def test_what_is_met_is_where_the_wheels_say() -> None:
    met = session_at(T_MAP_ODOM).base_at(WHEELS)
    assert met is not None
    assert met.as_array() == pytest.approx(np.array([0.5, 5.0, math.pi / 2 + 0.2]))


def test_what_is_met_while_the_camera_is_placed_anew_is_in_one_of_both_places() -> None:
    """The tracking thread replaces the localisation between two looks at it."""

    class Replaced(SlamSession):
        looks = 0

        @property
        def where(self) -> LocalizationState:
            self.looks += 1
            return first if self.looks == 1 else second

        @where.setter
        def where(self, _: LocalizationState) -> None:
            """Both are known."""

    first, second = session_at(T_MAP_ODOM).where, session_at(SE2(-40.0, 7.0, 0.0)).where
    session = Replaced(mounted(Config().robot.mount), Config())
    met = session.base_at(WHEELS)
    assert met is not None
    assert met.as_array() == pytest.approx(np.array([0.5, 5.0, math.pi / 2 + 0.2]))


def test_a_base_that_is_lifted_is_not_stuck_any_more() -> None:
    session = session_at(SE2())
    T_world_cam = SE3.from_se2(BEGAN.T_odom_base) @ session.T_base_cam
    for k in range(2, 20):  # the wheels turn, the camera stands
        seen = TrackingResult(k, TrackingState.GOOD, T_world_cam, 9, 9, False, "")
        where = session.locate(seen, Odometry(k, SE2(0.5 + 0.01 * k, 0.0, 0.0)))
    assert where.stuck
    session.lifted()
    assert not session.locate(seen._replace(stamp_ns=20), Odometry(20, SE2(0.69, 0.0, 0.0))).stuck


def test_nothing_is_met_in_a_map_in_which_the_base_is_unknown() -> None:
    session = session_at(T_MAP_ODOM)
    assert session.base_at(WHEELS._replace(odom_epoch=1)) is None, "odometry restarted since"
    new = SlamSession(session.T_base_cam, Config())
    assert new.base_at(WHEELS) == WHEELS.T_odom_base, "a new map begins as the odometry frame"
    new.resumed = True
    assert new.base_at(WHEELS) is None, "in a map made before it is not yet recognised"


def test_an_impossible_reading_moves_nothing() -> None:
    session = session_at(T_MAP_ODOM)
    lost = TrackingResult(2, TrackingState.LOST, None, 9, 0, False, "dark")
    where = session.locate(lost, Odometry(2, SE2(1e300, 0.0, 0.0)))
    assert where.T_map_base == session_at(T_MAP_ODOM).where.T_map_base


def test_the_ground_driven_while_the_camera_is_lost_is_free() -> None:
    session = session_at(SE2())
    for k in range(1, 11):
        lost = TrackingResult(1 + k, TrackingState.LOST, None, 9, 0, False, "dark")
        session.locate(lost, Odometry(1 + k, SE2(0.5 + 0.005 * k, 0.0, 0.0)))
    assert session.where.T_map_base is not None
    assert session.where.T_map_base.x == pytest.approx(0.55)


def test_far_from_where_the_camera_was_lost_nothing_is_driven_or_met_on_the_map() -> None:
    session = session_at(SE2())
    session.bumped(SE2(0.6, 0.0, 0.0))
    for k in range(1, 61):
        lost = TrackingResult(1 + k, TrackingState.LOST, None, 9, 0, False, "dark")
        session.locate(lost, Odometry(1 + k, SE2(0.5 + 0.1 * k, 0.0, 0.0)))
    session.bumped(session.base_at(Odometry(62, SE2(6.5, 0.0, 0.0))))
    state = session.ground.state()
    assert state["trail"][:, 0].max() == pytest.approx(1.4)
    assert len(state["bumps"]) == 1
    found = TrackingResult(
        63, TrackingState.GOOD, SE3.from_se2(SE2(6.0, 0.2, 0.0)) @ session.T_base_cam, 9, 9, False, ""
    )
    session.locate(found, Odometry(63, SE2(6.5, 0.0, 0.0)))
    assert session.ground.state()["trail"][-1, :2] == pytest.approx([6.0, 0.2])


def test_what_is_met_before_there_is_a_map_is_on_it() -> None:
    session = SlamSession(mounted(Config().robot.mount), Config())
    session.bumped(session.base_at(WHEELS))
    assert session.ground.state()["bumps"][0, :2] == pytest.approx([3.0, 0.5])


def test_what_is_touched_in_lock_step_before_there_is_a_map_is_on_it() -> None:
    config = Config()
    robot = EmulatedRobot(generate_world("lab", 20), 20, SimulationConfig(threads=1), config.robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, 20)
    system.step(*robot.step(STOP), "bumper: centre")
    assert system.session.where.T_map_base is None
    assert system.ground.state()["bumps"][:, :2] == pytest.approx(np.zeros((1, 2)), abs=0.01)


def test_a_bump_after_the_last_map_is_kept_for_the_next_session() -> None:
    ground = MappedGround(Config())
    ground.start = SE2(0.5, 0.0, 0.0)
    ground.bumped(SE2(1.0, 2.0, 0.0))
    state = ground.state()
    assert state["start"] == pytest.approx([0.5, 0.0, 0.0])
    assert len(state["bumps"]) == 1
    again = MappedGround(Config())
    again.restore(state)
    assert again.state()["start"] == pytest.approx([0.5, 0.0, 0.0])
    assert len(again.state()["bumps"]) == 1


def test_the_ground_hears_of_a_correction_between_the_poses_before_and_after(monkeypatch: pytest.MonkeyPatch) -> None:
    session, heard = session_at(SE2()), list[object]()
    monkeypatch.setattr(session.ground, "corrected", lambda: heard.append("corrected"))
    monkeypatch.setattr(session.ground, "moved", lambda pose, now_ns, beside: heard.append((pose.y, beside)))
    for k, y in enumerate((0.0, 0.5)):
        T_world_cam = SE3.from_se2(SE2(0.5, y, 0.0)) @ session.T_base_cam
        anchor = Anchor(4 + k, SE3.identity())
        seen = TrackingResult(2 + k, TrackingState.GOOD, T_world_cam, 9, 9, corrected=y > 0.0, anchor=anchor)
        session.locate(seen, BEGAN._replace(stamp_ns=2 + k))
    assert heard == [(pytest.approx(0.0), 4), "corrected", (pytest.approx(0.5), 5)]
