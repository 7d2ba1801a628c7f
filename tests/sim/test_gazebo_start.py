"""Where a robot starts in a Gazebo world: in a room, not outside, and never inside of a solid."""

from pathlib import Path

import pytest
from gazebo_files import FLOOR, box_model, walls_of_room, write_world

from vsx_ros.errors import ConfigError
from vsx_ros.runs.world import open_world
from vsx_ros.sim.gazebo_world import load_gazebo
from vsx_ros.sim.world import Start

BED, TABLE = box_model("bed", "-1.5 0 0.25 0 0 0", "1.6 2 0.5"), box_model("table", "1.2 1 0.3 0 0 0", "1 0.8 0.6")
BLOCK = box_model("block", "16 0 1.5 0 0 0", "14 14 3")
FLAT = [walls_of_room(4.0, 4.0, x, y) for x in (0.0, 4.15) for y in (0.0, 4.15)]
SLAB = box_model("slab", "0 0 -0.05 0 0 0", "8 8 0.1")


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
