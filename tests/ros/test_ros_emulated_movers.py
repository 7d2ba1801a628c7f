"""The live emulator moves people as lock-step does, and its rendering process sees them where they are; without ROS."""

import io

import numpy as np

from vsx_ros.config import RobotConfig
from vsx_ros.robot import STOP
from vsx_ros.ros.emulated_base import BodyPlant, BodyState
from vsx_ros.ros.emulation import PoseHistory, pose_row
from vsx_ros.runs.world import open_world
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world import World

HARD = "people=2,doors=1,robot-error=1"


def stepped(world: World, seed: int, steps: int) -> list[BodyState]:
    states: list[BodyState] = []
    plant = BodyPlant(world, seed, RobotConfig(), states.append, 0.23)
    for _ in range(steps):
        plant.advance(5_000_000)
    return states


def test_people_are_where_they_are_in_lock_step() -> None:
    world = open_world("lab", 20, hard=[HARD])
    last = stepped(world, 3, 40)[-1]
    robot = EmulatedRobot(world, 3)
    while robot.body.time_ns < last.time_ns:
        robot.step(STOP)
    there = robot.body.poses_at(np.array([last.time_ns]))[0, 4:]
    assert len(last.moved) == sum(len(mover.state) for mover in movers_of(world, 3)) > 0
    assert np.allclose(there, last.moved, atol=1e-9)


def test_the_rendering_process_reads_them_from_its_pipe() -> None:
    world = open_world("lab", 20, hard=[HARD])
    states = stepped(world, 3, 20)
    row = pose_row(len(states[0].moved))
    sent = b"".join(row.pack(s.time_ns, *s.T_world_base.as_array(), s.path_length_m, *s.moved) for s in states)
    history = PoseHistory(len(states[0].moved))
    history.fill(io.BytesIO(sent))
    seen = history.poses_at(np.array([states[5].time_ns]))[0]
    assert np.allclose(seen[4:], states[5].moved)
    assert np.allclose(seen[:3], states[5].T_world_base.as_array())


def test_without_any_the_rows_are_as_short_as_they_can_be() -> None:
    states = stepped(open_world("lab", 20), 3, 2)
    assert states[-1].moved == ()
    assert pose_row(0).size == 40
