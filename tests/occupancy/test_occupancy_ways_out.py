"""Ways out of zones: the shortest that leads over no other."""

from dataclasses import replace

import numpy as np
import pytest
from zoned_floor import BODY_M, FLOOR, MARGIN_M, along, square, zoned

from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.keep_out import KeepOut
from vsx_ros.occupancy.zoned_grid import ZonedGrid, speed_limits, with_zones
from vsx_ros.occupancy.zones import Zone, ZoneKind


def test_a_way_may_leave_a_zone_but_not_enter_one() -> None:
    keep_out = KeepOut(zoned(square(1.0)), BODY_M)
    assert keep_out.entered(along((-3.0, 1.5), (3.0, 1.5))) is None
    entry = keep_out.entered(along((-3.0, 0.0), (3.0, 0.0)))
    assert entry is not None
    assert entry.zone == "no-go"
    assert entry.ahead_m == pytest.approx(3.0 - 1.0 - MARGIN_M - BODY_M, abs=0.08)
    assert keep_out.entered(along((0.8, 0.0), (2.0, 0.0))) is None
    assert keep_out.entered(along((0.8, 0.0), (0.5, 0.0), (2.0, 0.0))) is not None
    assert keep_out.entered(along((0.8, 0.0), (2.0, 0.0), (0.5, 0.0))) is not None
    assert keep_out.entered(along((0.0, -0.9), (0.0, -2.0), (3.0, -2.0))) is None


@pytest.mark.parametrize("x", [2.0, 1.0, 0.8], ids=["apart", "touching", "overlapping"])
def test_of_two_zones_only_the_one_underneath_opens(x: float) -> None:
    grid = zoned(square(0.5), square(0.5, x=x)._replace(name="other"))
    opened = grid.opened_at(0.0, 0.0)
    assert isinstance(opened, ZonedGrid)
    keep_out = KeepOut(opened, BODY_M)
    assert keep_out.zone_at(-0.4, 0.0) == ""
    assert keep_out.zone_at(x, 0.0) == "other"
    assert KeepOut(grid, BODY_M).zone_at(-0.4, 0.0) == "no-go"


def test_two_zones_that_both_hold_the_body_open_and_slow_ones_stay() -> None:
    grid = zoned(square(0.5), square(0.5, x=0.8)._replace(name="other"), square(1.0, ZoneKind.SLOW, 0.1))
    opened = grid.opened_at(0.4, 0.0)
    assert opened.drivable.all()
    assert speed_limits(opened, np.array([[0.4, 0.0]])).tolist() == [0.1]
    assert zoned(square(0.5)).opened_at(0.0, 0.0).drivable.all()
    assert not grid.opened_at(3.0, 0.0).drivable.all(), "beside zones none opens"


def test_of_a_zone_in_a_corner_of_only_here_the_rest_stays_closed() -> None:
    """It reaches over the border, so that it and all outside are one closed area."""
    here, rug = square(1.5, ZoneKind.ONLY), square(0.5, x=1.3)
    in_rug = KeepOut(zoned(here, rug).opened_at(1.1, 0.0), BODY_M)
    assert in_rug.zone_at(1.1, 0.0) == ""
    assert in_rug.zone_at(1.8, 0.0) == "only here"
    outside = KeepOut(zoned(here, rug).opened_at(-2.0, 0.0), BODY_M)
    assert outside.zone_at(-3.0, 0.0) == ""
    assert outside.zone_at(1.3, 0.0) == "no-go"


STAIRS = Zone("stairs", ZoneKind.WALL, ((1.05, -1.5), (1.05, 1.5)))


def test_the_way_out_of_a_zone_does_not_lead_over_one_that_touches_it() -> None:
    keep_out = KeepOut(zoned(square(1.0), STAIRS), BODY_M)
    entry = keep_out.entered(along((0.6, 0.0), (2.0, 0.0)))
    assert entry is not None
    assert entry.zone == "stairs"
    assert entry.ahead_m == pytest.approx(1.05 - MARGIN_M - BODY_M - 0.6, abs=0.08)
    assert keep_out.entered(along((0.6, 0.0), (0.6, -2.0))) is None
    assert keep_out.entered(along((0.6, 0.0), (0.0, -0.3), (0.6, -2.0))) is None, "no farther from the way out"
    assert keep_out.entered(along((-0.6, 0.0), (0.6, 0.0), (0.6, -2.0))) is not None, "across the zone"


def test_from_the_margin_of_a_zone_the_body_may_leave_but_never_touches_it() -> None:
    keep_out, x = KeepOut(zoned(STAIRS), BODY_M), 1.05 - BODY_M - 0.03
    assert keep_out.entered(along((x, 0.0), (x, 0.5), (0.0, 0.5))) is None
    assert keep_out.entered(along((x, 0.0), (x + 0.05, 0.0), (0.0, 0.5))) is not None
    assert keep_out.entered(along((x, 0.0), (0.5, 0.5), (x, 0.0))) is not None, "it came back"


def test_the_way_out_of_a_zone_is_measured_past_obstacles() -> None:
    """The ground behind a wall is nearest, and cannot be reached: the base must come back from the wall."""
    cells = FLOOR.data.copy()
    cells[:, 90] = 100  # x = 0.5 m
    grid = with_zones(replace(FLOOR, data=cells), [square(0.8)], MARGIN_M, BODY_M)
    assert KeepOut(grid, BODY_M).entered(along((0.2, 0.0), (-2.0, 0.0))) is None


@pytest.mark.parametrize("inside_m", [0.01, 0.03, 0.05])
def test_a_body_that_only_reaches_into_a_zone_bends_at_most_10_cm_deeper(inside_m: float) -> None:
    keep_out, x = KeepOut(zoned(square(1.0)), BODY_M), 1.0 + BODY_M - inside_m
    entry = keep_out.entered(along((x, 0.0), (x - 0.5, 0.0)))
    assert entry is not None
    assert entry.ahead_m <= 0.11
    assert keep_out.entered(along((x, 0.0), (x - 0.04, 0.0), (2.0, 0.0))) is None


def room(door_y_m: float = 0.5) -> OccupancyGrid:
    """Walls at |x| = 2 m and |y| = 2 m, with a door in the one ahead."""
    cells, x, y = np.zeros(FLOOR.shape, np.int8), *FLOOR.centres(np.argwhere(FLOOR.data == 0)).T
    walls = (np.maximum(abs(x), abs(y)) > 2.0) & (np.maximum(abs(x), abs(y)) < 2.1) & ~((x > 0.0) & (abs(y) < door_y_m))
    cells.flat[walls] = 100
    return replace(FLOOR, data=cells)


DOOR = Zone("door", ZoneKind.WALL, ((2.15, -0.7), (2.15, 0.7)))
LANDING = square(0.8, x=2.75)._replace(name="landing")


@pytest.mark.parametrize("beyond", [None, DOOR, LANDING], ids=["shut", "wall", "no-go"])
@pytest.mark.parametrize("x", [1.5, 0.5])
def test_in_a_zone_without_a_way_out_the_base_stays_where_it_is(beyond: Zone | None, x: float) -> None:
    closed = [square(1.95)] + [beyond] * (beyond is not None)
    keep_out = KeepOut(with_zones(room(0.5 if beyond else 0.0), closed, MARGIN_M, BODY_M), BODY_M)
    for way in (along((x, 0.0), (x - 1.0, 0.0)), along((x, 0.0), (x, 1.0)), along((x, 0.0), (x + 0.2, 0.0))):
        entry = keep_out.entered(way)
        assert entry is not None
        assert entry.ahead_m <= 0.15
    assert keep_out.entered(along((x, 0.0), (x - 0.05, 0.0), (x, 0.05))) is None
    out = KeepOut(with_zones(room(), [square(1.95)], MARGIN_M, BODY_M), BODY_M)
    assert out.entered(along((x, 0.0), (2.5, 0.0))) is None, "through an open door it leaves"
