"""Whether a robot on its way waits for a person who walks towards it, or across its way close before it.

    python benchmarks/in_the_way.py run [--seeds 20-23] [--wait 3] [--who meets,crosses,nobody] [--out FILE]

A robot in an emulated lab maps while it creeps forward, then follows a straight way to a place far ahead; the person
begins to walk a second later and stops for nothing. ``--wait 0`` is a robot that does not wait
(``follower.hidden_wait_s``). ``nobody`` counts needless waiting. speed_m_s: of the robot at the first contact.
"""

import argparse
import signal
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from seeds import seed_range
from tables import RESULTS, rooms_of

from vsx_ros.config import Config, overridden
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import Follower
from vsx_ros.planning.path import certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import STOP, VelocityCommand
from vsx_ros.session import SlamSession
from vsx_ros.sim import robot as emulated
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.moving import Mover
from vsx_ros.sim.people import Person
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.sim.truth import free_ahead
from vsx_ros.slam.slam import SequentialSlam

CREEP_M_S, CREEP_S, LASTS_S = 0.12, 5.0, 13.0
SPEED_M_S = 0.6  # of the person
CROSSES_M = 1.1  # ahead of where the robot's way begins


class Scene(NamedTuple):
    who: str
    seed: int
    wait_s: float


class Walker(Person):
    """Stands where it is until its time has come."""

    def __init__(self, places: list[tuple[float, float]], begins_s: float) -> None:
        super().__init__(1, np.array(places), np.random.default_rng(1))
        self._speed_m_s, self._left_s = SPEED_M_S, begins_s

    def step(self, dt_s, robot, people, things) -> None:
        self._left_s -= dt_s
        if self._left_s <= 0.0:
            super().step(dt_s, robot, people, things)


def walkers(who: str, world, seed: int) -> list[Mover]:
    """The person of a scene."""
    start, ahead_m = world.start_pose, free_ahead(world, *world.start_pose.as_array().tolist())
    begun_m = CREEP_M_S * CREEP_S
    at = {
        "meets": [(min(ahead_m, 5.0), 0.05), (-1.0, 0.05)],
        "crosses": [(begun_m + CROSSES_M, 1.3), (begun_m + CROSSES_M, -1.3)],
    }
    return [Walker([tuple(p) for p in (start @ np.array(at[who])).tolist()], CREEP_S + 1.0)] if who in at else []


def driven(scene: Scene) -> dict[str, object]:
    """One drive."""
    config = overridden(Config(), {"follower.hidden_wait_s": scene.wait_s})
    emulated.movers_of = partial(walkers, scene.who)
    world = generate_world("lab", scene.seed)
    robot = EmulatedRobot(world, scene.seed, SimulationConfig(frame_rate_hz=10.0))
    session = SlamSession(robot.T_base_cam_given, config, None)
    session.begin(SequentialSlam, robot.camera_given, scene.seed)
    follower, command, waited, told = Follower(config), VelocityCommand(CREEP_M_S, 0.0), 0, {}
    way_m = free_ahead(world, *world.start_pose.as_array().tolist()) - CREEP_M_S * CREEP_S
    while robot.truth.stamp_ns < LASTS_S * 1e9:
        frame, odometry = robot.step(command)
        where = session.locate(session.track(frame, odometry), odometry)
        now_s = frame.stamp_ns * 1e-9
        if now_s > CREEP_S:
            if not told and where.T_map_base is not None:
                follower.follow(frame.stamp_ns, straight(where.T_map_base, way_m - 0.3, config), "map", 1)
                told = {"tracked": True}
            command = follower.step(frame.stamp_ns, where) or STOP
            waited += follower.report.reason.startswith("waiting")
        contacts = robot.truth.contacts
        if (contacts.into_people or contacts.by_people) and "speed_m_s" not in told:
            told |= {"speed_m_s": round(abs(odometry.v), 3), "at_s": round(now_s, 1)}
    return {**told, **robot.truth.contacts._asdict(), "waited_s": waited / 10.0,
            "driven_m": round(robot.truth.path_length_m, 2), "state": where.slam_state.word}  # fmt: skip


def straight(pose: SE2, way_m: float, config: Config):
    """Straight on from a pose."""
    pieces = (arc_piece(pose, 0.0, max(way_m, 0.5), 1),)
    return time_scale(certified(pose, pieces[-1].end, pieces, "arcs and lines"), config.limits)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run",))
    parser.add_argument("--seeds", type=seed_range, default=range(20, 24), metavar="A-B")
    parser.add_argument("--wait", type=float, default=Config().follower.hidden_wait_s, help="seconds")
    parser.add_argument("--who", default="meets,crosses,nobody")
    parser.add_argument("--out", type=Path, default=RESULTS / "in_the_way.jsonl")
    args = parser.parse_args()
    scenes = [Scene(who, seed, args.wait) for seed in args.seeds for who in args.who.split(",")]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_campaign(scenes, driven, Store(args.out, rooms=rooms_of("in_the_way")), Engine(1, apart=True))


if __name__ == "__main__":
    main()
