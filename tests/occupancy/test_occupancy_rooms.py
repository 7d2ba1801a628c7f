"""Rooms: found as the generator built them, with the same numbers and names while the map grows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vsx_ros.config import RoomsConfig
from vsx_ros.errors import InputError
from vsx_ros.io.room_file import load_rooms, save_rooms
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.room_cells import split, without_furniture
from vsx_ros.occupancy.rooms import MOST_ROOMS, RoomMap, RoomTracker
from vsx_ros.runs.rooms import renamed
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.room_truth import right_rooms, room_truth
from vsx_ros.sim.truth import ground_truth_grid

CONFIG = RoomsConfig()


def two_rooms(known_columns: int = 200) -> OccupancyGrid:
    """Two rooms of 4.9 m x 4.9 m beside each other with a door of 1 m between; unknown from a column on."""
    data = np.full((100, 200), OCCUPIED, np.int8)
    data[1:-1, 1:99] = data[1:-1, 101:-1] = FREE
    data[40:60, 99:101] = FREE
    data[:, known_columns:] = UNKNOWN
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


def test_a_door_cuts() -> None:
    labels = split(two_rooms(), CONFIG)
    assert len(np.unique(labels)) == 3
    assert labels[50, 20] != labels[50, 180]
    assert (labels[1:-1, 1:97] == labels[50, 20]).all()


@pytest.mark.parametrize("metres", [2.0, 4.0, 8.0])
def test_an_opening_divides_by_its_share_of_the_rooms_not_by_its_width(metres: float) -> None:
    """Rooms of any size, and openings of 65 and 75 % of their width."""
    n = round(metres / 0.05)
    for share, parts in ((0.65, 2), (0.75, 1)):
        data = np.full((n + 2, 2 * n + 4), OCCUPIED, np.int8)
        data[1:-1, 1 : n + 1] = data[1:-1, n + 3 : -1] = FREE
        half = round(0.5 * share * n)
        data[1 + n // 2 - half : 1 + n // 2 + half, n + 1 : n + 3] = FREE
        assert len(np.unique(split(OccupancyGrid(data, 0.05, 0.0, 0.0), CONFIG))) == 1 + parts


def test_furniture_is_no_wall_but_a_wall_between_two_doors_is() -> None:
    free = two_rooms().data == FREE
    free[20:40, 30:36] = False
    free[45:55, 99:101] = False
    assert without_furniture(free, 36.0)[20:40, 30:36].all()
    assert not without_furniture(free, 8.0)[20:40, 30:36].any()
    assert not without_furniture(free, 36.0)[0].any()


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.compiled) for seed in (4, 7))])
def test_the_rooms_of_a_building_are_those_it_was_built_with(seed: int) -> None:
    world = generate_world("building", seed)
    grid = ground_truth_grid(world, 0.05, 0.06, 0.6)
    truth = np.where(grid.data == FREE, room_truth(world, grid), 0)
    right, count = right_rooms(split(grid, CONFIG), truth)
    assert 24 <= count <= 36
    assert right >= 0.95 * count


def test_rooms_keep_their_numbers_and_names_while_the_map_grows() -> None:
    tracker = RoomTracker(CONFIG)
    seen = tracker.update(two_rooms(80))
    (first,) = seen.rooms
    assert first.name == "room 1"
    assert first.area_m2 == pytest.approx(98 * 79 * 0.0025, abs=0.2)
    assert 0.9 < first.known_ratio <= 1.0
    tracker.rename(first.number, "kitchen")
    for columns in (110, 150, 200):
        grown = tracker.update(two_rooms(columns))
        kitchen = grown.named("Kitchen")
        assert kitchen is not None
        assert kitchen.number == first.number
        assert grown.labels[50, 20] == first.number
        assert kitchen.place == pytest.approx((2.5, 2.5), abs=0.6)
    assert [room.name for room in grown.rooms] == ["kitchen", "room 2"]
    shifted = OccupancyGrid(np.pad(two_rooms().data, 7, constant_values=UNKNOWN), 0.05, -0.35, -0.35)
    assert [room.name for room in tracker.update(shifted).rooms] == ["kitchen", "room 2"]
    again = RoomTracker(CONFIG)
    again.resume(grown)
    assert [room.name for room in again.update(two_rooms()).rooms] == ["kitchen", "room 2"]


def _with_opening(cells: int) -> OccupancyGrid:
    """Two rooms, the right one larger, with an opening of so many cells between."""
    data = np.full((90, 210), OCCUPIED, np.int8)
    data[5:85, 5:100] = data[5:85, 104:205] = FREE
    data[45 - cells // 2 : 45 + cells // 2, 100:104] = FREE
    return OccupancyGrid(data, 0.05, 0.0, 0.0)


@pytest.mark.parametrize("named", [("kitchen", "office"), ("kitchen", ""), ("", "office"), ("", "")])
def test_rooms_that_were_one_for_a_while_get_their_names_and_numbers_back(named: tuple[str, str]) -> None:
    tracker = RoomTracker(CONFIG)
    rooms = tracker.update(_with_opening(16))
    for x, name in zip((2.5, 8.0), named, strict=True):
        if name and (room := rooms.at(x, 2.2)):
            tracker.rename(room.number, name)
    before = tracker.current
    assert before is not None
    for cells in (60, 60, 16, 16, 60, 16):
        rooms = tracker.update(_with_opening(cells))
        if cells == 16:
            assert [room.name for room in rooms.rooms] == [room.name for room in before.rooms]
            assert (rooms.labels[:, :100] == before.labels[:, :100]).all()
        else:
            (one,) = rooms.rooms
            assert one.name in (named if any(named) else {room.name for room in before.rooms})


def test_a_name_survives_a_run_that_ends_while_its_room_is_part_of_another(tmp_path: Path) -> None:
    tracker = RoomTracker(CONFIG)
    for number, name in zip([room.number for room in tracker.update(_with_opening(16)).rooms], ("a", "b"), strict=True):
        tracker.rename(number, name)
    tracker.update(_with_opening(60))
    save_rooms(tracker.current, tmp_path / "map_rooms.json")
    saved, again = load_rooms(tmp_path / "map_rooms.json"), RoomTracker(CONFIG)
    assert saved is not None
    again.resume(saved)
    assert [room.name for room in again.update(_with_opening(16)).rooms] == ["a", "b"]
    (one,), (other,) = saved.rooms, saved.absent
    again.resume(renamed(saved, one.name, other.name))
    again.update(_with_opening(60))
    assert [room.name for room in again.update(_with_opening(16)).rooms if room.name == other.name] == [other.name]
    again.resume(saved)
    again.rename(one.number, other.name)
    assert again.current is not None
    assert again.current.absent == ()


def test_a_part_that_splits_off_takes_no_name_with_it() -> None:
    """A room that was found in two parts gets a nook: the rest of it is the room."""
    tracker = RoomTracker(CONFIG)
    for cells in (16, 60):
        (room, *_) = tracker.update(_with_opening(cells)).rooms
    tracker.rename(room.number, "hall")
    nook = _with_opening(60).data.copy()
    nook[5:85, 30:33] = OCCUPIED
    nook[40:50, 30:33] = FREE
    hall = tracker.update(OccupancyGrid(nook, 0.05, 0.0, 0.0)).named("hall")
    assert hall is not None
    assert hall.area_m2 > 30.0


@pytest.mark.compiled  # 400 updates
def test_numbers_stay_within_what_a_file_holds() -> None:
    """Rooms come and go with the map for hours; those that are there, and the named ones, keep their numbers."""
    tracker, elsewhere = RoomTracker(CONFIG), OccupancyGrid(np.full((9, 9), UNKNOWN, np.int8), 0.05, 0.0, 0.0)
    tracker.update(two_rooms())
    tracker.rename(2, "kitchen")
    for k in range(200):
        tracker.update(elsewhere)
        others = replace(two_rooms(), origin_x=20.0 * (k + 1))
        numbers = [room.number for room in tracker.update(others).rooms]
        assert len(set(numbers)) == 2
        assert max(numbers) <= MOST_ROOMS
        assert 2 not in numbers, "its name belongs to a room that is out of sight"
    assert tracker.update(others).rooms[0].number == numbers[0]


def test_naming_is_refused_for_what_is_not_there() -> None:
    rooms: RoomMap = RoomTracker(CONFIG).update(two_rooms())
    assert [room.name for room in renamed(rooms, "2", "bath").rooms] == ["room 1", "bath"]
    assert [room.name for room in renamed(rooms, "Room 1", "bath").rooms] == ["bath", "room 2"]
    with pytest.raises(InputError, match="no room 'hall'; the rooms are: 'room 1', 'room 2'"):
        renamed(rooms, "hall", "bath")
    with pytest.raises(InputError, match="room 2 has the name"):
        renamed(rooms, "1", "room 2")
    with pytest.raises(InputError, match="at most 40 characters"):
        renamed(rooms, "1", "x" * 41)


def test_a_map_without_free_ground_has_no_rooms() -> None:
    grid = OccupancyGrid(np.full((9, 9), UNKNOWN, np.int8), 0.05, 0.0, 0.0)
    assert RoomTracker(CONFIG).update(grid).rooms == ()


def _known_ratio(data: np.ndarray) -> float:
    (room,) = RoomTracker(CONFIG).update(OccupancyGrid(data, 0.05, 0.0, 0.0)).rooms
    return room.known_ratio


def test_a_room_is_wholly_known_when_only_ground_behind_its_walls_is_unknown() -> None:
    data = np.full((120, 120), UNKNOWN, np.int8)
    data[9:111, 9:111] = OCCUPIED
    data[10:110, 10:110] = FREE
    data[59:111, 59:111] = OCCUPIED
    data[60:, 60:] = UNKNOWN
    assert _known_ratio(data) == 1.0
    data[20:40, 20:40] = UNKNOWN  # not seen, and no wall before it
    area = 100 * 100 - 51 * 51
    assert _known_ratio(data) == pytest.approx(1.0 - 20 * 20 / area, abs=0.002)


def test_the_known_share_of_a_room_of_which_half_is_seen() -> None:
    data = np.full((120, 120), OCCUPIED, np.int8)
    data[10:110, 10:110] = FREE
    data[30:110, 30:92] = UNKNOWN
    data[60, 60:80] = OCCUPIED
    assert _known_ratio(data) == pytest.approx(0.50, abs=0.05)
