"""The stack never learns what the emulator does to the robot: neither by an import nor by what it is handed."""

import configparser
from pathlib import Path

import numpy as np

from vsx_ros.geometry.se3 import SE3
from vsx_ros.ros import nodes
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.world_file import with_hard_things

ROOT = Path(__file__).resolve().parents[2]
EMULATES_OR_WATCHES = {"emulator", "run_folder", "dashboard", "teleop"}


def test_no_room_and_no_node_of_the_stack_may_import_the_emulator() -> None:
    contracts = configparser.ConfigParser()
    contracts.read(ROOT / ".importlinter")
    contract = contracts["importlinter:contract:emulator-unseen"]
    assert contract["forbidden_modules"].split() == ["vsx_ros.sim"]
    assert "allow_indirect_imports" not in contract
    sources = set(contract["source_modules"].split())
    every = {path.stem for path in Path(nodes.__path__[0]).glob("[a-z]*.py")}
    assert {f"vsx_ros.ros.nodes.{name}" for name in every - EMULATES_OR_WATCHES} <= sources
    rooms = {"system", "session", "navigation", "exploration", "control", "dense", "planning", "slam", "occupancy"}
    assert {f"vsx_ros.{room}" for room in rooms} <= sources


def same(a: SE3, b: SE3) -> bool:
    return np.array_equal(a.rotation, b.rotation) and np.array_equal(a.translation, b.translation)


def test_errors_of_the_robot_change_nothing_that_the_stack_is_handed() -> None:
    world = generate_world("corridor", 1)
    for seed in range(3):
        right, wrong = (
            EmulatedRobot(with_hard_things(world, hard, "test"), seed)
            for hard in ({}, {"robot-error": 2.0, "fingerprints": 0.3, "latency": 100.0})
        )
        assert wrong.camera_given == right.camera_given
        assert same(wrong.T_base_cam_given, right.T_base_cam_given)
        assert wrong.camera_true != right.camera_true
        assert not same(wrong.T_base_cam_true, right.T_base_cam_true)
