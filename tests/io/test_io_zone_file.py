"""Zones beside a map: what is written is read again; what is no zone is refused in one sentence that names it."""

from pathlib import Path

import pytest

from vsx_ros.errors import InputError, MapFileError
from vsx_ros.io.zone_file import load_zones, save_zones, zone_file
from vsx_ros.occupancy.zones import MAX_CORNERS, Zone, ZoneKind, zone_of

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.5), (0.0, 1.25))
ZONES = [
    Zone("carpet", ZoneKind.NO_GO, SQUARE),
    Zone("to the stairs", ZoneKind.WALL, ((2.0, -1.0), (2.0, 3.123456789))),
    Zone("flat", ZoneKind.ONLY, ((-5.0, -5.0), (9.0, -5.0), (9.0, 9.0), (-5.0, 9.0))),
    Zone("kitchen ä", ZoneKind.SLOW, SQUARE, 0.1),
]


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    path = zone_file(tmp_path / "lab.vsxmap")
    assert path.name == "lab_zones.yaml"
    assert zone_file(tmp_path / "lab.yaml") == path
    save_zones(ZONES, path)
    assert load_zones(path) == ZONES
    save_zones([], path)
    assert load_zones(path) == []
    path.unlink()
    assert load_zones(path) == []


def test_a_file_cut_short_is_refused_and_one_by_hand_needs_no_mark(tmp_path: Path) -> None:
    path = tmp_path / "lab_zones.yaml"
    save_zones(ZONES, path)
    whole = path.read_text(encoding="utf-8")
    for size in range(len(whole.rstrip())):
        path.write_text(whole[:size], encoding="utf-8")
        with pytest.raises(MapFileError, match="lab_zones"):
            load_zones(path)
    one_more = "- {name: mat, kind: no-go, points: [[0, 0], [1, 0], [1, 1]]}\n"
    path.write_text(whole + one_more, encoding="utf-8")
    assert [zone.name for zone in load_zones(path)] == [*(zone.name for zone in ZONES), "mat"]
    path.write_text("---\nversion: 1\nzones:\n" + one_more)
    assert [zone.name for zone in load_zones(path)] == ["mat"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"name": ""}, "name"),
        ({"name": "x" * 41}, "at most 40"),
        ({"name": "a\nb"}, "name"),
        ({"kind": "nogo"}, "no-go, wall, only, slow"),
        ({"points": 7}, "pairs"),
        ({"points": [[0, 0], [1, 1]]}, "has 2 corners"),
        ({"points": [[0, 0], [1, "a"], [1, 1]]}, "pairs"),
        ({"points": [[0, 0], [1, float("nan")], [1, 1]]}, "lies in no building"),
        ({"points": [[0, 0], [1, 1], [2, 2]]}, "area"),
        ({"points": [[0, 0], [1, 0], [1, 1]] * MAX_CORNERS}, "corners; draw it simpler"),
        ({"kind": "slow"}, "a speed v_m_s belongs"),
        ({"v_m_s": 0.2}, "a speed v_m_s belongs"),
        ({"kind": "slow", "v_m_s": 0.0}, "its speed is 0 m/s"),
        ({"kind": "slow", "v_m_s": True}, "is a number"),
        ({"kind": "wall", "points": [[0, 0], [0.01, 0]]}, "shorter than 10 cm"),
        ({"color": "red"}, "not 'color'"),
    ],
)
def test_what_is_no_zone_is_refused_by_name(change: dict, says: str) -> None:
    tree = {"name": "carpet", "kind": "no-go", "points": [list(point) for point in SQUARE]}
    assert zone_of(tree) == ZONES[0]
    with pytest.raises(InputError, match=says):
        zone_of({**tree, **change})


@pytest.mark.parametrize(
    "text", ["", "[1]", "version: 2\nzones: []", "version: 1", "version: 1\nzones: [3]", "{", "\0"]
)
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "lab_zones.yaml"
    path.write_text(text)
    with pytest.raises(MapFileError, match=r"lab_zones\.yaml"):
        load_zones(path)


def test_two_zones_of_one_name_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "lab_zones.yaml"
    save_zones([ZONES[0], ZONES[0]], path)
    with pytest.raises(MapFileError, match="two zones have the name 'carpet'"):
        load_zones(path)
