"""Zones that come and go while a robot in lock-step stands, so that its ground map stays the same."""

from test_system_operator import Run

from vsx_ros.occupancy.zoned_grid import ZonedGrid
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.robot import STOP, OperatorHold

STANDS_S = 6


def test_a_zone_that_was_removed_is_open_and_the_landmarks_stay_known() -> None:
    run = Run()
    run.explore()
    hold = OperatorHold("teleop", run.now_ns)
    until_ns = run.now_ns + STANDS_S * 10**9
    while run.now_ns < until_ns:
        run.step(STOP, hold)
    system, made = run.system, run.system._mapped
    system.ground.zones.add(Zone("rug", ZoneKind.NO_GO, ((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0))))
    run.step(STOP, hold)
    assert isinstance(system.grid, ZonedGrid)
    assert system.planner._visibility() is not None
    system.ground.zones.remove("rug")
    run.step(STOP, hold)
    assert not isinstance(system.grid, ZonedGrid)
    assert system._mapped == made, "a newer ground map says nothing about this"
