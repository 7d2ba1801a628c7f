"""A robot of one's own in the loop: here the emulated one; anything with images and odometry will do.

python examples/explore_a_lab.py 60 lab.pgm
"""

import sys
from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.io.map_file import save_map
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.system import ExplorationSystem


def main(seconds: float, map_path: Path) -> None:
    robot = EmulatedRobot(generate_world("lab", 2), seed=2)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, Config(), seed=2)
    command = STOP
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > seconds:
            break
        bumper = "bumper pressed" if any(robot.body.bumper) else None
        command = system.step(frame, odometry, bumper).command
        for event in system.mission.drain_events():
            print(f"{event.stamp_ns * 1e-9:6.1f} s  {event.state}: {event.reason}")
    if system.grid is not None:
        save_map(system.grid, map_path)
        print(f"{system.grid.known_area_m2:.1f} m2 known, map in {map_path}")


if __name__ == "__main__":
    main(float(sys.argv[1]), Path(sys.argv[2]))
