"""A session whose saved ground or counts are damaged is refused in one sentence, or its map can be built."""

import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import snapshot
from vsx_ros.slam.tracking_record import TrackingRecord

NOTHING = snapshot(Map().view())


def whole() -> dict[str, np.ndarray]:
    ground = MappedGround(Config())
    for k in range(4):
        ground.moved(SE2(0.2 * k, 0.0, 0.1 * k), k * 10**8)
    ground.bumped(SE2(0.8, 0.0, 0.3))
    ground.docked(SE2(0.1, 0.0, 0.0))
    ground.zones.add(Zone("stairs", ZoneKind.NO_GO, ((1.0, 2.0), (3.0, 2.0), (3.0, 4.5))))
    return {**ground.state(), **TrackingRecord().state()}


def go_on(state: dict[str, np.ndarray]) -> None:
    TrackingRecord.restored(state)
    ground = MappedGround(Config())
    ground.restore(state)
    ground.grid(NOTHING)


@pytest.mark.parametrize("name", ["start", "trail", "bumps", "dock", "zone_corners", "counters"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e18])
def test_a_number_that_is_no_place_and_no_count(name: str, value: float) -> None:
    state = whole()
    go_on(state)
    spoilt = state[name].astype(float)
    spoilt.flat[0] = value
    with pytest.raises(InputError, match="start a new run"):
        go_on({**state, name: spoilt})


@pytest.mark.parametrize("name", ["start", "trail", "bumps"])
def test_a_place_beyond_every_building_asks_for_no_memory(name: str) -> None:
    state = whole()
    state[name].flat[:2] = 9e5
    with pytest.raises(InputError, match="ground map would be .* m x .* m;"):
        go_on(state)
