"""A large building for the SLAM: an office of 40 m x 25 m whose corridor runs around a block of rooms, and the path
around it. The same twelve kinds of posters hang everywhere, so that places look alike."""

import math
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from slam_drives import CLEAR_M, Drive, Leg, clearest_start, kept, record

from vsx_ros.sim.body import BodySettings
from vsx_ros.sim.generate import HEIGHT_M, ceiling_lights, generate_world
from vsx_ros.sim.interior import decorated, random_materials, wall_material
from vsx_ros.sim.robot import SimulationConfig
from vsx_ros.sim.world import Box, Origin, Outline, Point, Start, Wall, World

WIDTH_M, DEPTH_M = 40.0, 25.0
ROOM_M, CORRIDOR_M, WALL_M = 2.5, 2.0, 0.12
ROOM_WIDTH_M, DOOR_M = 4.5, 1.2
BEND_M = 0.9
# 0.3 m/s at any frame rate: slam_drives counts in frames of 15 Hz.
STEP_M, RATE_HZ = 0.02, 7.5
# Uncalibrated wheels: 1.5 % error in distance and turn.
SIMULATION = SimulationConfig(frame_rate_hz=RATE_HZ, body=BodySettings(wheel_scale_error=0.015, gyro_scale_error=0.015))


def _wall(a: Point, b: Point, material: str) -> Wall:
    return Wall(points=[a, b], thickness=WALL_M, height=HEIGHT_M, material=material, skirting="skirting")


def _with_doors(rng: np.random.Generator, a: Point, b: Point) -> list[Wall]:
    """A wall from a to b with a door in each room's width."""
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    ux, uy = (b[0] - a[0]) / length, (b[1] - a[1]) / length
    cuts = [0.0]
    for k in range(int(length / ROOM_WIDTH_M)):
        low = ROOM_WIDTH_M * k + float(rng.uniform(0.5, ROOM_WIDTH_M - DOOR_M - 0.5))
        cuts += [low, low + DOOR_M]
    cuts.append(length)
    return [
        _wall((a[0] + low * ux, a[1] + low * uy), (a[0] + high * ux, a[1] + high * uy), wall_material(rng))
        for low, high in zip(cuts[::2], cuts[1::2])
    ]


def _ring(margin: float) -> list[Point]:
    x1, y1 = WIDTH_M - margin, DEPTH_M - margin
    return [(margin, margin), (x1, margin), (x1, y1), (margin, y1)]


def _partitions(rng: np.random.Generator) -> list[Wall]:
    """Walls between rooms outside and inside the corridor; rooms of the block lie back to back."""
    near, far = ROOM_M, ROOM_M + CORRIDOR_M
    walls = [_wall((far, 0.5 * DEPTH_M), (WIDTH_M - far, 0.5 * DEPTH_M), wall_material(rng))]
    for x in np.arange(near + ROOM_WIDTH_M, WIDTH_M - near, ROOM_WIDTH_M).tolist():
        walls += [_wall((x, 0.0), (x, near), wall_material(rng)), _wall((x, DEPTH_M - near), (x, DEPTH_M), "paint")]
    for x in np.arange(far + ROOM_WIDTH_M, WIDTH_M - far - 1.0, ROOM_WIDTH_M).tolist():
        walls.append(_wall((x, far), (x, DEPTH_M - far), wall_material(rng)))
    for y in np.arange(near + ROOM_WIDTH_M, DEPTH_M - near, ROOM_WIDTH_M).tolist():
        walls += [_wall((0.0, y), (near, y), wall_material(rng)), _wall((WIDTH_M - near, y), (WIDTH_M, y), "paint")]
    return walls


def _boxes(rng: np.random.Generator) -> list[Box]:
    """Furniture in the rooms, visible through their doors."""
    xs = np.arange(ROOM_M + CORRIDOR_M + 1.5, WIDTH_M - ROOM_M - CORRIDOR_M - 1.0, ROOM_WIDTH_M).tolist()
    boxes = []
    for x in xs:
        for y in (1.0, DEPTH_M - 1.0, 0.5 * DEPTH_M - 3.0, 0.5 * DEPTH_M + 3.0):
            length, width, height = (float(v) for v in rng.uniform([0.4, 0.4, 0.4], [1.1, 0.8, 1.4]))
            material = ["print0", "print1", "print2", "print3", "wood"][int(rng.integers(5))]
            boxes.append(Box(x=x, y=y, length=length, width=width, height=height, material=material))
    return boxes


def building(seed: int) -> World:
    """The office of that seed; the start is in its corridor, heading along x."""
    rng = np.random.default_rng([seed, 40])
    corners = _ring(0.0)
    rings = [_ring(ROOM_M), _ring(ROOM_M + CORRIDOR_M)]
    walls = [wall for ring in rings for a, b in zip(ring, [*ring[1:], ring[0]]) for wall in _with_doors(rng, a, b)]
    world = World(
        generator=Origin(name="building", seed=seed),
        start=Start(x=8.0, y=ROOM_M + 0.5 * CORRIDOR_M, theta_rad=0.0),
        ceiling_height=HEIGHT_M,
        floor="floor",
        ceiling="ceiling",
        materials=random_materials(rng),
        outlines=[
            Outline(
                points=corners, height=HEIGHT_M, material=[wall_material(rng) for _ in corners], skirting="skirting"
            )
        ],
        walls=[*walls, *_partitions(rng)],
        boxes=_boxes(rng),
        lights=ceiling_lights(0.0, 0.0, WIDTH_M, DEPTH_M),
    )
    return decorated(rng, world, 1.7)


def way_round(again_m: float) -> list[Leg]:
    """Once around the corridor from the start, and again_m of the beginning once more."""
    middle = ROOM_M + 0.5 * CORRIDOR_M
    long, short = WIDTH_M - 2.0 * (middle + BEND_M), DEPTH_M - 2.0 * (middle + BEND_M)
    bend = Leg(0.5 * math.pi * BEND_M, 0.5 * math.pi, step=STEP_M)
    begun = 8.0 - middle - BEND_M
    sides = [long - begun, short, long, short]
    legs = [leg for side in sides for leg in (Leg(side, step=STEP_M), bend)]
    return [*legs, Leg(begun, step=STEP_M), Leg(again_m, step=STEP_M)]


def ring_drive(seed: int, keep: Path | None) -> Drive:
    """Around building ``seed``: 107 m at 4 cm per frame (0.3 m/s)."""
    drive = kept(f"ring_{seed}", keep, lambda: record(building(seed), seed, way_round(6.0), SIMULATION))
    assert drive is not None
    return drive


def laps_legs() -> list[Leg]:
    """Five laps of an oval, each of a different width, so that no lap repeats the path of the one before."""
    legs = []
    for radius in (0.9, 0.8, 1.0, 0.85, 0.95):
        side, bend = Leg(1.6, step=STEP_M), Leg(0.5 * math.pi * radius, 0.5 * math.pi, step=STEP_M)
        legs += [side, bend, bend, side, bend, bend]
    return legs


def laps_drive(seed: int, keep: Path | None) -> Drive | None:
    """Five laps in lab ``seed`` at 4 cm per frame, from its clearest place; None if there is none."""

    def make() -> Drive | None:
        world = generate_world("lab", seed)
        clearance, start = clearest_start(world, laps_legs())
        if clearance < CLEAR_M:
            return None
        return record(replace(world, start=start), seed, laps_legs(), SimulationConfig(frame_rate_hz=RATE_HZ))

    return kept(f"laps_{seed}", keep, make)
