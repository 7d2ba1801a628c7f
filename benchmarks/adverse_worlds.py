"""Ground maps of worlds that are hard to see: ``PYTHONPATH=src:hw python benchmarks/adverse_worlds.py [NAME ...]``.

``dark``: floor, walls and skirting in the same dark grey, a row of boxes in front of a wall. ``skirting``: walls
without pictures above bright skirting boards. ``tables``: only tables with legs of 3 cm. ``posters``: the same picture
on every wall and box. ``blank``: no texture at all. Each is explored for 40 s and judged as in ground_map.py. ``blank``
prints the robot's messages and the area called free, which must not exceed the promised and driven floor.
"""

import sys

import cv2
import numpy as np
from ground_map import explored, words
from msgspec.structs import replace
from surface_cells import gap_world

from vsx_ros.config import Config
from vsx_ros.occupancy.grid import FREE
from vsx_ros.robot import STOP
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.world import Material, Table, World
from vsx_ros.system import ExplorationSystem

SEED, SECONDS = 100, 40.0
NAMES = ("dark", "skirting", "tables", "posters", "blank")


def world_of(name: str) -> World:
    """One of the worlds."""
    if name == "dark":
        return gap_world(SEED, "dark")[0]
    lab = generate_world("lab", SEED)
    if name == "posters":
        same = [replace(poster, material="poster0") for poster in lab.posters]
        boxes = [replace(box, material="print0") for box in lab.boxes]
        return replace(lab, posters=same, boxes=boxes)
    if name == "tables":
        shell, _, _ = gap_world(SEED, "")
        tables = [
            Table(x=x, y=y, yaw_rad=0.3, length=1.0, width=0.6, leg=0.03, material="wood")
            for x, y in ((2.6, 3.4), (4.4, 3.2), (4.6, 1.4))
        ]
        return replace(shell, boxes=[], posters=[p for p in shell.posters if p.y > 4.9 or p.x < 0.1], tables=tables)
    plain = Material(kind="plain", brightness=0.6)
    walls = dict.fromkeys(("paint", "wallpaper", "brick"), plain)
    if name == "skirting":
        return replace(
            lab, materials=lab.materials | walls | {"skirting": Material(kind="plain", brightness=0.85)}, posters=[]
        )
    return replace(lab, materials=dict.fromkeys(lab.materials, plain), posters=[])


def blank() -> str:
    """What the robot reports where nothing can be seen, and what it calls free."""
    config, robot = Config(), EmulatedRobot(world_of("blank"), SEED, SimulationConfig(threads=1), Config().robot)
    system = ExplorationSystem(robot.camera_given, robot.T_base_cam_given, config, SEED)
    command, tracked, said = STOP, 0, ""
    while system.mission.outcome is None:
        frame, odometry = robot.step(command)
        if frame.stamp_ns * 1e-9 > SECONDS:
            break
        step = system.step(frame, odometry, "bumper pressed" if any(robot.body.bumper) else None)
        command, tracked, said = step.command, tracked + step.tracking.state.tracked, step.tracking.reason
    free = 0.0 if system.grid is None else np.count_nonzero(system.grid.data == FREE) * system.grid.resolution**2
    return (
        f"blank {SEED}: {tracked} frames tracked, the SLAM says: {said}; mission {system.mission.outcome}; "
        f"{free:.2f} m2 called free, {robot.truth.path_length_m:.1f} m driven"
    )


if __name__ == "__main__":
    cv2.setNumThreads(1)
    for name in sys.argv[1:] or NAMES:
        if name == "blank":
            print(blank(), flush=True)
            continue
        run = explored(name, world_of(name), SEED, SECONDS)
        print(run.about)
        for k, kind in enumerate(("sparse", "dense ")):
            print(words(kind, [run.qualities[k]], [run.floor_m2[k]]), flush=True)
