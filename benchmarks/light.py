"""A map made in one light, and the camera found again in others.

    python benchmarks/light.py [--seeds 100-119] [--starts 5] [--made steady] [--lights day,dim] [--maps FOLDER]

Each lab is driven once around 9 m, usually in the steady light of all its lamps. Then the robot is put down near the
driven path, in another light (``vsx_ros.sim.lighting.LIGHTS``: from daylight to a tenth of the light), with the same
camera, mount and map: up to 0.6 m aside, turned by up to 50 deg. It stands for a second, then turns by 17 deg/s. A row
is one start: ``found_s`` (from the first picture; null: not within 5 s), ``off_m`` and ``off_deg`` (of the first pose
from the truth), ``right`` (found, and less than 0.15 m and 3 deg off). The starts of a lab are the same in every light.
Maps are kept in --maps. Existing rows of the present code are not measured again.
"""

import argparse
import json
import math
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from msgspec.structs import replace
from seeds import seed_range
from slam_accuracy import SLAM, TRACKED, loop_courses
from slam_drives import CLEAR_M, RATE_HZ, Leg, clearest_start, record
from tables import RESULTS, rooms_of

from vsx_ros.config import RobotConfig
from vsx_ros.evaluation.trajectory import align
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.lighting import LIGHTS, light_named
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.truth import gap_to_walls
from vsx_ros.sim.world import Start, World
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import SlamMap

STEADY = "steady"  # the light of a world without lighting
OTHERS = ("day", "sun", "evening", "half", "night", "dim")
LOOP_M, WITHIN_S, STANDS_S, TURN_RAD_S = 9.0, 5.0, 1.0, 0.3
ASIDE_M, TURNED_RAD, GAP_M = 0.6, math.radians(50.0), 0.1  # of a start; gap between the hull and things
RIGHT_M, RIGHT_DEG = 0.15, 3.0


class Place(NamedTuple):
    """A start, by number, in a lab, and the light in which the map was made."""

    seed: int
    made: str
    light: str
    start: int


class Known(NamedTuple):
    """A map and its place in the world. way (N, 3): true poses x, y, theta of the base when it was made."""

    slam_map: SlamMap
    T_world_map: SE3
    way: np.ndarray


def lab_in(light: str, seed: int) -> World:
    world = generate_world("lab", seed)
    return world if light == STEADY else replace(world, lighting=light_named(light, seed))


def known_map(seed: int, made: str, folder: Path) -> Known:
    """The map of a lab from the folder; if it is not there, it is made first."""
    file = folder / f"lab_{seed}_{made}.map"
    if not file.with_suffix(".json").exists():
        make_map(seed, made, file)
    facts = json.loads(file.with_suffix(".json").read_text())
    return Known(load_slam_map(file), SE3.from_matrix(np.array(facts["T_world_map"])), np.array(facts["way"]))


def fitting_course(world: World) -> tuple[list[Leg], Start]:
    """The roundest course that has room, and where it begins."""
    for legs in loop_courses(LOOP_M):
        clearance_m, start = clearest_start(world, legs)
        if clearance_m >= CLEAR_M:
            return legs, start
    raise ValueError(f"lab {world.generator.seed} has no room for a course")


def make_map(seed: int, made: str, file: Path) -> None:
    world = lab_in(made, seed)
    legs, start = fitting_course(world)
    drive = record(replace(world, start=start), seed, legs)
    slam, seen = SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1), []
    for k in range(len(drive)):
        result = slam.track(drive.frame(k), drive.odometry_at(k))
        if result.T_world_cam is not None:
            seen.append((result.T_world_cam.translation, drive.truth[k, :3, 3]))
    here, there = (np.array(points) for points in zip(*seen))
    fitted = align(here, there, "yaw")
    T_world_map = SE3(fitted.rotation, fitted.translation)
    T_cam_base = drive.T_base_cam.inverse()
    bases = [(drive.true_pose(k) @ T_cam_base).matrix() for k in range(len(drive))]
    way = [(T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])) for T in bases]
    slam_map = slam.slam_map()
    assert slam_map is not None
    file.parent.mkdir(parents=True, exist_ok=True)
    save_slam_map(slam_map, file)
    file.with_suffix(".json").write_text(json.dumps({"T_world_map": T_world_map.matrix().tolist(), "way": way}))


def put_down(known: Known, segments: np.ndarray, place: Place) -> Start:
    """Near the way on which the map was made, clear of things."""
    rng = np.random.default_rng([place.seed, place.start, 21])
    while True:
        x, y, theta = known.way[int(rng.integers(len(known.way)))].tolist()
        aside, turned = rng.uniform(-ASIDE_M, ASIDE_M), rng.uniform(-TURNED_RAD, TURNED_RAD)
        pose = SE2(x, y, theta) @ SE2(0.0, float(aside), float(turned))
        if gap_to_walls(segments, np.array([[pose.x, pose.y]]))[0] > RobotConfig().radius_m + GAP_M:
            return Start(x=pose.x, y=pose.y, theta_rad=pose.theta)


def found(folder: Path, place: Place) -> dict[str, Any]:
    """One start: how soon the camera is found, and how far off."""
    known = known_map(place.seed, place.made, folder)
    world = lab_in(place.light, place.seed)
    start = put_down(known, world.obstacle_segments(0.0, RobotConfig().height_m), place)
    robot = EmulatedRobot(replace(world, start=start), place.seed)
    slam = SequentialSlam(robot.camera_given, robot.T_base_cam_given, SLAM, 1, known.slam_map)
    side = 1.0 if place.start % 2 else -1.0
    for k in range(round(WITHIN_S * RATE_HZ)):
        turning = k >= STANDS_S * RATE_HZ
        seen = robot.step(VelocityCommand(0.0, side * TURN_RAD_S if turning else 0.0))
        result = slam.track(seen.frame, seen.odometry)
        if result.state in TRACKED and result.T_world_cam is not None:
            error = (known.T_world_map @ result.T_world_cam).inverse() @ robot.truth.T_world_cam
            off_m = float(np.linalg.norm(error.translation))
            off_deg = math.degrees(error.rotation_angle_to(SE3.identity()))
            right = off_m < RIGHT_M and off_deg < RIGHT_DEG
            return {"found_s": k / RATE_HZ, "off_m": round(off_m, 4), "off_deg": round(off_deg, 3), "right": right}
    return {"found_s": None, "off_m": None, "off_deg": None, "right": False}


def told(places: list[Place], results: list[dict[str, Any]]) -> str:
    """A line for each light."""
    lines = [f"{'light':10}{'starts':>8}{'right':>7}{'wrong':>7}{'median s':>10}{'worst off':>11}"]
    for light in [*dict.fromkeys(place.light for place in places), "all"]:
        mine = [row for place, row in zip(places, results) if light in (place.light, "all")]
        there = [row for row in mine if row.get("found_s") is not None]
        right = [row for row in there if row["right"]]
        seconds = float(np.median([row["found_s"] for row in there])) if there else math.nan
        worst = 100.0 * max((row["off_m"] for row in right), default=math.nan)
        lines.append(
            f"{light:10}{len(mine):>8}{len(right):>7}{len(there) - len(right):>7}{seconds:>10.2f}{worst:>8.1f} cm"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seed_range, default=range(100, 120), metavar="A-B", help="labs")
    parser.add_argument("--starts", type=int, default=5, metavar="N", help="in each lab")
    parser.add_argument("--made", default=STEADY, metavar="NAME", help="light in which the maps are made")
    parser.add_argument("--lights", default=",".join(OTHERS), metavar="NAME,...", help="of LIGHTS, or steady")
    parser.add_argument("--maps", type=Path, default=RESULTS / "light_maps", metavar="FOLDER", help="kept maps")
    parser.add_argument("--out", type=Path, default=RESULTS / "light.jsonl", metavar="FILE", help="rows")
    args = parser.parse_args()
    lights = args.lights.split(",")
    if unknown := {*lights, args.made} - {*LIGHTS, STEADY}:
        parser.error(f"there is no light {', '.join(sorted(unknown))}; choose of {', '.join(LIGHTS)}")
    cv2.setNumThreads(1)
    places = [Place(seed, args.made, light, k) for seed in args.seeds for k in range(args.starts) for light in lights]
    store = Store(args.out, rooms=rooms_of("light"))
    results = run_campaign(places, partial(found, args.maps), store, Engine())
    print(told(places, results))


if __name__ == "__main__":
    main()
