"""Where a robot starts in a Gazebo world: in a room, not outside, and never inside of a solid."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from dae_files import INSTANCE, write_dae
from gazebo_files import FLOOR, box_model, walls_of_room, write_world

from vsx_ros.errors import ConfigError
from vsx_ros.occupancy.grid import FREE
from vsx_ros.runs.world import open_world, save_world
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.truth import checked_start, ground_truth_grid
from vsx_ros.sim.world import Start
from vsx_ros.sim.world_file import load_world, with_hard_things

BED, TABLE = box_model("bed", "-1.5 0 0.25 0 0 0", "1.6 2 0.5"), box_model("table", "1.2 1 0.3 0 0 0", "1 0.8 0.6")
BLOCK = box_model("block", "16 0 1.5 0 0 0", "14 14 3")
FLAT = [walls_of_room(4.0, 4.0, x, y) for x in (0.0, 4.15) for y in (0.0, 4.15)]
SLAB = box_model("slab", "0 0 -0.05 0 0 0", "8 8 0.1")
BLOCK_AT = '<model name="m"><pose>0 0 1 0 0 0</pose><link name="l"><collision name="c"><geometry><mesh>{}</mesh>'
BLOCK_AT += "</geometry></collision></link></model>"


@pytest.mark.parametrize(
    ("parts", "within"),
    [
        ([FLOOR, walls_of_room(3.0, 4.0)], (-1.5, -2.0, 1.5, 2.0)),
        ([SLAB, walls_of_room(3.0, 4.0)], (-1.5, -2.0, 1.5, 2.0)),
        ([FLOOR, walls_of_room(5.0, 4.0), BED, TABLE], (-2.5, -2.0, 2.5, 2.0)),
        ([FLOOR, *FLAT], (-2.0, -2.0, 6.15, 6.15)),
        ([FLOOR, walls_of_room(8.0, 6.0), BLOCK], (-4.0, -3.0, 4.0, 3.0)),
    ],
    ids=["small", "slab", "furnished", "flat", "block"],
)
def test_a_robot_starts_in_a_room(tmp_path: Path, parts: list[str], within: tuple[float, float, float, float]) -> None:
    file = write_world(tmp_path, *parts)
    for start in (load_gazebo(file, []).start, open_world(str(file), 3).start):
        assert within[0] < start.x < within[2]
        assert within[1] < start.y < within[3]


def test_an_open_world_is_driven_outside_its_solids(tmp_path: Path) -> None:
    world = load_gazebo(write_world(tmp_path, FLOOR, BLOCK, box_model("post", "4 0 0.5 0 0 0", "0.2 0.2 1")), [])
    assert world.start.x < 8.5
    assert world.owner_around(world.start.x, world.start.y) is None


def test_a_start_inside_of_a_large_solid_is_refused(tmp_path: Path) -> None:
    file = write_world(tmp_path, FLOOR, walls_of_room(8.0, 6.0), BLOCK)
    with pytest.raises(ConfigError, match="stands in block/l"):
        load_gazebo(file, [], Start(x=16.0, y=0.0, theta_rad=0.0))


def test_a_start_off_the_floor_is_refused(tmp_path: Path) -> None:
    slab = box_model("slab", "0 0 -0.05 0 0 0", "6 5 0.1")
    file = write_world(tmp_path, slab, walls_of_room(6.0, 5.0))
    with pytest.raises(ConfigError, match="no floor at 3.45"):
        load_gazebo(file, [], Start(x=3.45, y=2.0, theta_rad=0.0))
    assert load_gazebo(file, [], Start(x=2.5, y=2.0, theta_rad=0.0)).start.x == 2.5


def test_on_an_open_floor_a_robot_may_start_away_from_all_things(tmp_path: Path) -> None:
    slab = box_model("slab", "0 0 -0.05 0 0 0", "6 6 0.1")
    world = open_world(str(write_world(tmp_path, slab, box_model("box", "2 2 0.5 0 0 0", "1 1 1"))), 1)
    chosen = load_gazebo(world.file, []).start
    assert not (1.0 <= chosen.x <= 3.0 and 1.0 <= chosen.y <= 3.0)
    for start in (chosen, world.start, Start(x=-2.5, y=-2.5, theta_rad=0.0)):
        save_world(world.starting_at(start), tmp_path / "world.yaml")
        again = load_world(tmp_path / "world.yaml")
        assert again.start == start
        assert ground_truth_grid(again, 0.05, 0.0, 0.45).value_at(start.x, start.y) == FREE
        movers = movers_of(with_hard_things(again, {"chairs": 1, "people": 1}, "t"), 1)
        assert movers
    for x, y in ((-3.5, 0.0), (1e5, 0.0), (1e300, 1e300), (float("nan"), 0.0)):
        with pytest.raises(ConfigError, match="it starts at|no floor at"):
            checked_start(world.starting_at(Start(x=x, y=y, theta_rad=0.0)), "w")


def block_file(path: Path, mirrored: bool) -> None:
    """A closed block of 3 x 3 x 2 m around the origin; mirrored: by its node, which a GLB or DAE file has."""
    block, mirror = trimesh.creation.box((3.0, 3.0, 2.0)), np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
    if path.suffix == ".dae":
        node = f'<node id="n"><matrix>{" ".join(map(str, mirror.ravel()))}</matrix>{INSTANCE}</node>'
        write_dae(path, node, points=block.vertices, faces=block.faces)
        return
    scene = trimesh.Scene()
    scene.add_geometry(block, transform=mirror)
    scene.export(path)


@pytest.mark.parametrize(
    ("name", "scale", "mirrored"),
    [("b.stl", "1 1 1", False), ("b.stl", "1 -1 1", False), ("b.glb", "1 1 1", True), ("b.dae", "1 1 1", True)],
)
def test_a_mirrored_solid_is_as_solid_as_any(tmp_path: Path, name: str, scale: str, mirrored: bool) -> None:
    block_file(tmp_path / name, mirrored)
    model = BLOCK_AT.format(f"<uri>{name}</uri><scale>{scale}</scale>")
    world = load_gazebo(write_world(tmp_path, FLOOR, model, box_model("post", "4 4 0.5 0 0 0", "0.5 0.5 1")), [])
    assert max(abs(world.start.x), abs(world.start.y)) > 1.5
    assert world.owner_around(0.0, 0.0) == "m/l"


@pytest.mark.parametrize("scale", ["1 1 1", "-1 1 1", "-1 -1 1"])
def test_a_mirrored_house_of_one_mesh_has_its_floor(tmp_path: Path, scale: str) -> None:
    walls = [((6.0, 0.1, 2.5), (0.0, y, 1.25)) for y in (-3.0, 3.0)] + [
        ((0.1, 6.0, 2.5), (x, 0.0, 1.25)) for x in (-3.0, 3.0)
    ]
    boxes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in walls]
    slab = trimesh.creation.box((6.0, 6.0, 0.1), trimesh.transformations.translation_matrix((0.0, 0.0, -0.05)))
    trimesh.util.concatenate([slab, *boxes]).export(tmp_path / "b.stl")
    model = BLOCK_AT.format(f"<uri>b.stl</uri><scale>{scale}</scale>")
    world = load_gazebo(write_world(tmp_path, model), [])
    assert world.floor_z_m == pytest.approx(1.0, abs=1e-6)
    assert max(abs(world.start.x), abs(world.start.y)) < 3.0


def test_a_room_whose_walls_look_inwards_is_no_solid(tmp_path: Path) -> None:
    room = trimesh.creation.box((6.0, 5.0, 2.0))
    room.invert()
    room.export(tmp_path / "b.stl")
    world = load_gazebo(write_world(tmp_path, BLOCK_AT.format("<uri>b.stl</uri>")), [])
    assert checked_start(world.starting_at(Start(x=1.0, y=1.0, theta_rad=0.0)), "w").start.x == 1.0
