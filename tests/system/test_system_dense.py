"""With the dense map in the loop, too, the same seed gives the same bits."""

import numpy as np

from vsx_ros.config import Config
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.system import ExplorationSystem

SECONDS = 5.0


def run() -> tuple[list[VelocityCommand], ExplorationSystem]:
    config = Config()
    robot = EmulatedRobot(generate_world("lab", 20), 20, SimulationConfig(threads=1), config.robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, 20)
    commands = [STOP]
    while True:
        frame, odometry = robot.step(commands[-1])
        if frame.stamp_ns * 1e-9 > SECONDS:
            return commands, system
        commands.append(system.step(frame, odometry).command)


def test_two_runs_are_the_same_to_the_bit_and_have_surfaces() -> None:
    (commands, one), (again, other) = run(), run()
    assert commands == again
    assert one.grid is not None
    assert other.grid is not None
    assert np.array_equal(one.grid.data, other.grid.data)
    assert len(one.surface_points()) > 100
    assert np.array_equal(one.surface_points(), other.surface_points())
