"""Zones on a grid and with the map: what they close, what they leave open, and that they move with the keyframes."""

import math

import cv2
import numpy as np
import pytest
from zoned_floor import BODY_M, CELL_M, FLOOR, MARGIN_M, along, square, zoned

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.distance import clearance_field
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.keep_out import KeepOut
from vsx_ros.occupancy.zoned_grid import ZonedGrid, entered, speed_limits, with_zones
from vsx_ros.occupancy.zones import OUTSIDE, AnchoredZones, Zone, ZoneKind, zone_of

DIAGONAL_M = math.sqrt(0.5) * CELL_M


def triangle(rng: np.random.Generator) -> np.ndarray:
    while True:
        corners = rng.uniform(-3.0, 3.0, (3, 2))
        (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
        if abs(ax * by - ay * bx) > 0.5:
            return corners


def distance_to(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Of places outside a convex polygon, by many points on its border."""
    ends = np.roll(corners, -1, axis=0)
    border = np.concatenate([a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a) for a, b in zip(corners, ends)])
    return np.min(np.hypot(*(points[:, None] - border[None]).transpose(2, 0, 1)), axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_a_zone_closes_all_that_is_nearer_than_the_margin_and_hardly_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = triangle(rng)
    grid = zoned(Zone("z", ZoneKind.NO_GO, tuple(map(tuple, corners.tolist()))))
    places = rng.uniform(-3.9, 3.9, (2000, 2))
    edges = [(a, b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))]
    signs = [np.sign(e[0] * (places - a)[:, 1] - e[1] * (places - a)[:, 0]) for a, e in edges]
    inside = np.abs(np.sum(signs, axis=0)) == 3
    closed = grid.zones.closed[tuple(grid.cells(places).T)]
    away_m = distance_to(corners, places)
    assert closed[inside].all()
    assert closed[away_m <= MARGIN_M].all()
    assert not closed[~inside & (away_m > MARGIN_M + 2.0 * DIAGONAL_M + 0.01)].any()
    assert not grid.zones.closed.all()


def test_the_ground_itself_stays_as_it_is_and_the_body_keeps_out() -> None:
    grid = zoned(square(1.0))
    assert np.array_equal(grid.data, FLOOR.data)
    assert grid.known_area_m2 == FLOOR.known_area_m2
    assert FLOOR.drivable.all()
    field = clearance_field(grid)
    at = field.at(np.array([[0.0, 0.0], [1.0 + MARGIN_M, 0.0], [2.0, 0.0]]))
    assert at[0] == pytest.approx(-1.05, abs=0.06)
    assert -0.06 < at[1] <= 0.0
    assert at[2] == pytest.approx(0.95, abs=0.06)
    keep_out = KeepOut(grid, BODY_M)
    assert keep_out.zone_at(1.1, 0.0) == "no-go"
    assert keep_out.zone_at(1.3, 0.0) == ""
    assert with_zones(FLOOR, [], MARGIN_M, BODY_M) is FLOOR


@pytest.mark.parametrize("place", [(1.0, 0.3), (-3.9, 3.9), (9.0, 0.0)])
def test_a_part_of_the_ground_has_the_same_cells_in_the_same_places(place: tuple[float, float]) -> None:
    whole = zoned(square(1.0), square(1.5, ZoneKind.LOOK), square(2.0, ZoneKind.SLOW, 0.1))
    part = whole.around(*place, 0.7)
    assert isinstance(part, ZonedGrid)
    assert max(part.shape) <= 30
    cells = np.argwhere(part.data == part.data)
    there = whole.cells(part.centres(cells))
    assert whole.contains(there).all()
    assert np.array_equal(part.drivable[tuple(cells.T)], whole.drivable[tuple(there.T)])
    for name in ("v_m_s", "owner", "wanted"):
        mine, theirs = getattr(part.zones, name), getattr(whole.zones, name)
        assert np.array_equal(mine[tuple(cells.T)], theirs[tuple(there.T)]), name


def test_a_wall_closes_a_line_and_only_here_closes_the_rest() -> None:
    wall = zoned(Zone("w", ZoneKind.WALL, ((-2.0, 0.0), (2.0, 0.0))))
    assert KeepOut(wall, BODY_M).zone_at(0.0, 0.1) == "w"
    assert KeepOut(wall, BODY_M).zone_at(0.0, 0.4) == ""
    assert 4.0 * 0.1 < wall.zones.closed.sum() * CELL_M**2 < 4.2 * 0.25
    here = zoned(square(1.5, ZoneKind.ONLY), square(1.0, ZoneKind.ONLY, x=2.0)._replace(name="b"))
    assert KeepOut(here, BODY_M).zone_at(-1.4, 0.0) == "only here"
    assert KeepOut(here, BODY_M).zone_at(0.0, 0.0) == ""
    open_m2 = here.drivable.sum() * CELL_M**2
    assert 2.8**2 < open_m2 < 3.0**2 + 1.5 * 2.0


@pytest.mark.parametrize("overlap_m", [0.0, 0.005, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("turned_rad", [0.0, 0.4])
def test_zones_to_stay_in_add_up_where_they_touch(overlap_m: float, turned_rad: float) -> None:
    turn, seam = SE2(0.0, 0.0, turned_rad), overlap_m / 2.0
    boxes = [square(1.5, ZoneKind.ONLY, x=1.5 - seam), square(1.5, ZoneKind.ONLY, x=seam - 1.5)._replace(name="b")]
    zones = [zone._replace(points=tuple(map(tuple, (turn @ np.array(zone.points)).tolist()))) for zone in boxes]
    grid = zoned(*zones)
    keep_out, y = KeepOut(grid, BODY_M), 1.5 - BODY_M - 0.25
    for way in (along((-1.0, -y), (0.0, -y), (0.0, y), (1.0, y)), along((-2.0, 0.3), (2.0, -0.3))):
        assert keep_out.entered(turn @ way) is None
        assert not any(entered(zones, *place, BODY_M, CELL_M) for place in (turn @ way).tolist())
    assert keep_out.entered(turn @ along((0.0, 0.0), (0.0, 1.5))) is not None
    assert grid.opened_at(0.0, 0.0) is grid, "no zone holds the body"
    rim = turn @ np.column_stack([np.linspace(-3.2, 3.2, 500), np.full(500, 1.5 - MARGIN_M)])
    assert grid.zones.closed[tuple(grid.cells(np.vstack([rim, -rim])).T)].all()


def test_a_gap_between_zones_to_stay_in_stays_closed() -> None:
    grid = zoned(square(1.5, ZoneKind.ONLY, x=1.52), square(1.5, ZoneKind.ONLY, x=-1.52)._replace(name="b"))
    assert grid.zones.closed[:, 78:82].all()
    assert KeepOut(grid, BODY_M).zone_at(0.0, 0.0) == OUTSIDE


@pytest.mark.compiled
@pytest.mark.parametrize(("apart_m", "most_m2"), [(4.0, 4.0), (3.0, 9.0), (9.0, 0.0)], ids=["touch", "lap", "apart"])
def test_zones_to_stay_in_are_joined_only_where_they_meet(
    apart_m: float, most_m2: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a map of 100 m, whose cells are a hundred times as many."""
    eroded_m2, erode = [0.0], cv2.erode

    def counted(cells: np.ndarray, disc: np.ndarray) -> np.ndarray:
        eroded_m2.append(cells.size * (CELL_M / 3.0) ** 2)
        return erode(cells, disc)

    monkeypatch.setattr(cv2, "erode", counted)
    hall = OccupancyGrid(np.zeros((2000, 2000), np.int8), CELL_M, -50.0, -50.0)
    beside = [square(2.0, ZoneKind.ONLY, x=30.0), square(2.0, ZoneKind.ONLY, x=30.0 + apart_m)._replace(name="b")]
    grid = with_zones(hall, beside, MARGIN_M, BODY_M)
    assert sum(eroded_m2) <= most_m2
    assert (KeepOut(grid, BODY_M).zone_at(30.0 + apart_m / 2.0, 0.0) == "") is (apart_m <= 4.0)


@pytest.mark.parametrize("gap_m", [0.0, 0.003, 0.008, 0.016])
def test_where_zones_to_stay_in_meet_the_way_out_of_another_does_not_leave_them(gap_m: float) -> None:
    """The body reaches into a gap between them, which is none on the grid."""
    x = 1.5 + 0.5 * gap_m
    beside = square(1.5, ZoneKind.ONLY, x=x), square(1.5, ZoneKind.ONLY, x=-x)._replace(name="b")
    for place in ((0.0, 0.0), (0.0, 1.5 - BODY_M - MARGIN_M), (0.15, -1.2)):
        assert entered(beside, *place, BODY_M, CELL_M) == ()
    assert entered(beside, 0.0, 1.5 - BODY_M + 0.01, BODY_M, CELL_M) == (OUTSIDE,)
    assert KeepOut(zoned(*beside), BODY_M).zone_at(0.0, 0.0) == ""
    for y in (0.0, 1.5 - BODY_M - MARGIN_M):
        opened = KeepOut(zoned(*beside, square(1.2)).opened_at(0.0, y), BODY_M)
        assert opened.zone_at(0.0, 0.0) == ""
        assert opened.zone_at(0.0, 1.6) == OUTSIDE


@pytest.mark.parametrize("turned_rad", [0.0, 0.4])
@pytest.mark.parametrize("gap_m", [0.008, 0.016, 0.025, 0.04])
def test_a_gap_between_zones_to_stay_in_is_entered_where_the_grid_has_one(gap_m: float, turned_rad: float) -> None:
    turn, x = SE2(0.013, 0.021, turned_rad), 1.5 + 0.5 * gap_m
    boxes = square(1.5, ZoneKind.ONLY, x=x), square(1.5, ZoneKind.ONLY, x=-x)._replace(name="b")
    zones = [zone._replace(points=tuple(map(tuple, (turn @ np.array(zone.points)).tolist()))) for zone in boxes]
    closed = zoned(*zones, margin_m=0.0).zones.closed
    for y in np.linspace(-1.2, 1.2, 49).tolist():
        place = turn @ np.array([[0.0, y]])
        in_gap = bool(closed[tuple(FLOOR.cells(place)[0])])
        assert entered(zones, *place[0].tolist(), 0.0, CELL_M) == ((OUTSIDE,) if in_gap else ())


def test_a_slow_zone_slows_where_the_body_reaches_into_it() -> None:
    grid = zoned(square(1.0, ZoneKind.SLOW, 0.1), square(3.0, ZoneKind.SLOW, 0.2)._replace(name="large"))
    assert grid.drivable.all()
    limits = speed_limits(grid, np.array([[0.0, 0.0], [1.15, 0.0], [1.5, 0.0], [3.5, 0.0], [90.0, 0.0]]))
    assert limits.tolist() == [0.1, 0.1, 0.2, math.inf, math.inf]
    assert KeepOut(grid, BODY_M).zone_at(0.0, 0.0) == ""


def camera(x: float, y: float, heading: float) -> SE3:
    c, s = math.cos(heading), math.sin(heading)
    return SE3(np.array([[s, 0.0, c], [-c, 0.0, s], [0.0, -1.0, 0.0]]), np.array([x, y, 0.3]))


def test_zones_move_with_the_keyframes_and_survive_a_session() -> None:
    zones, ids = AnchoredZones(), np.array([3, 7])
    zones.add(square(1.0))
    zones.add(Zone("w", ZoneKind.WALL, ((9.0, 0.0), (10.0, 0.0))))
    before = zones.zones(ids, [camera(0.0, 0.0, 0.0), camera(10.0, 0.0, 0.5)])
    assert [zone.points for zone in before] == [square(1.0).points, ((9.0, 0.0), (10.0, 0.0))]
    after = zones.zones(ids, [camera(0.2, 0.1, 0.0), camera(10.0, 1.0, 0.5 + math.pi / 2)])
    assert np.allclose(after[0].points, np.array(square(1.0).points) + [0.2, 0.1])
    assert np.allclose(after[1].points, [(10.0, 0.0), (10.0, 1.0)])
    again = AnchoredZones()
    again.restore(zones.state())
    assert again.zones(ids, [camera(0.2, 0.1, 0.0), camera(10.0, 1.0, 0.5 + math.pi / 2)]) == after
    assert again.version > 0


def test_adding_the_same_name_replaces_and_an_unknown_name_is_told() -> None:
    zones = AnchoredZones()
    zones.add(square(1.0))
    zones.add(square(2.0))
    assert len(zones) == 1
    with pytest.raises(InputError, match="no zone 'b'; the zones are: 'no-go'"):
        zones.remove("b")
    zones.remove("no-go")
    assert len(zones) == 0
    assert zones.version == 3
    with pytest.raises(InputError, match="damaged"):
        zones.restore({"zones": np.frombuffer(b"[1", np.uint8), "zone_corners": np.zeros((0, 7))})
    zones.restore({})


@pytest.mark.parametrize(
    ("points", "v_m_s"), [([[10**400, 0], [0, 1]], None), ([[0, 0], [0, 1]], 10**400)], ids=["corner", "speed"]
)
def test_numbers_that_no_float_holds_are_refused(points: list[list[int]], v_m_s: int | None) -> None:
    with pytest.raises(InputError, match="'z'"):
        zone_of({"name": "z", "kind": "wall", "points": points, "v_m_s": v_m_s})


def test_a_body_is_in_a_zone_as_soon_as_it_reaches_into_it() -> None:
    rug, slow = square(0.5), square(3.0, ZoneKind.SLOW, 0.1)
    for x, inside in ((0.0, True), (0.5 + BODY_M - 0.01, True), (0.5 + BODY_M + 0.01, False)):
        assert entered([rug, slow], x, 0.0, BODY_M, CELL_M) == (("no-go",) if inside else ())
    line = Zone("door", ZoneKind.WALL, ((1.0, -1.0), (1.0, 1.0), (2.0, 1.0)))
    for x, y, touched in ((1.0 - BODY_M + 0.01, 0.0, True), (1.5, 1.0 + BODY_M + 0.01, False), (1.5, 0.0, False)):
        assert entered([line], x, y, BODY_M, CELL_M) == (("door",) if touched else ())
    allowed = [square(1.0, ZoneKind.ONLY), square(1.0, ZoneKind.ONLY, x=3.0)]
    for x, outside in ((0.0, False), (3.0, False), (1.0 - BODY_M - 0.01, False), (1.0 - BODY_M + 0.01, True)):
        assert entered(allowed, x, 0.0, BODY_M, CELL_M) == ((OUTSIDE,) if outside else ())
    overlapping = [square(1.0, ZoneKind.ONLY), square(1.0, ZoneKind.ONLY, x=1.8)]
    assert entered(overlapping, 0.9, 0.0, BODY_M, CELL_M) == (), "in neither wholly, in both together"
    assert entered(overlapping, 0.9, 1.0, BODY_M, CELL_M) == (OUTSIDE,)


@pytest.mark.parametrize("seed", range(5))
def test_a_body_is_in_a_zone_where_the_grid_says_so(seed: int) -> None:
    """They may differ by a cell's diagonal at the border."""
    rng = np.random.default_rng(seed)
    zone = Zone("rug", ZoneKind.NO_GO, tuple((float(x), float(y)) for x, y in triangle(rng)))
    keep_out = KeepOut(zoned(zone), BODY_M)
    for x, y in rng.uniform(-3.5, 3.5, (200, 2)).tolist():
        for radius_m, least in ((BODY_M - 2.0 * DIAGONAL_M, True), (BODY_M + 2.0 * DIAGONAL_M, False)):
            if bool(entered([zone], x, y, radius_m, CELL_M)) is least:
                assert bool(keep_out.zone_at(x, y)) is least
