"""A corrected map takes along what the mission remembers in it."""

from pathlib import Path

import numpy as np
import pytest
from missions import LANDMARKS, SECOND, euclid, mapping_mission, situation

from vsx_ros.config import Config
from vsx_ros.exploration.decision import NavigationState, SavedMission, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.view_selector import ViewSelector
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.anchored_poses import KeyframePlaces, MapCorrections
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid


def keyframes(*poses: SE2) -> KeyframePlaces:
    return KeyframePlaces(np.arange(len(poses)), np.array([pose.as_array() for pose in poses]).reshape(-1, 3))


def near(pose: SE2, other: SE2) -> bool:
    return pose.distance_to(other) < 1e-9 and abs(pose.angle_to(other)) < 1e-9


def niche(moved_m: float) -> OccupancyGrid:
    """A room, and a dark niche that never becomes known."""
    data = np.full((100, 160), OCCUPIED, np.int8)
    data[10:90, 10:110] = FREE
    data[40:60, 110:125] = UNKNOWN
    return OccupancyGrid(data, 0.05, -3.0 + moved_m, -2.5)


def test_a_niche_that_was_given_up_stays_so_when_the_map_moves() -> None:
    selector, here, views, corrections = ViewSelector(Config(), euclid), SE2(), 0, MapCorrections()
    while ranked := selector.rank(views * SECOND, here, niche(0.0), LANDMARKS).views:
        views, here = views + 1, ranked[0].pose
        selector.looked_from.append(here)
    assert views > 3
    assert not corrections.update(keyframes(SE2(), here))
    assert corrections.update(keyframes(SE2(0.6, 0.0, 0.0), SE2(0.6, 0.0, 0.0) @ here))
    selector.moved(corrections)
    shifted = selector.rank(99 * SECOND, SE2(0.6, 0.0, 0.0) @ here, niche(0.6), LANDMARKS + [0.6, 0.0, 0.0])
    assert shifted.views == []


def test_looks_failures_and_home_move_with_the_keyframes_around_them() -> None:
    """A loop is closed: the far part of the map moves, home does not."""
    mission, far, correction = mapping_mission(), SE2(9.0, 2.0, 1.0), SE2(-0.7, 0.4, 0.3)
    before = situation(keyframes=keyframes(SE2(), far), navigation=NavigationState.ACTIVE)
    mission.decide(2 * SECOND, before)
    look, failed = far @ SE2(0.3, 0.1, -0.5), far @ SE2(0.5, 0.0, 3.0)
    mission.view_selector.looked_from.append(look)
    mission.view_selector.blacklist.add(3 * SECOND, failed)
    home = mission.to_save(3 * SECOND, SE2(), 0).home
    assert home is not None
    bent = keyframes(SE2(), correction @ far, correction @ far @ SE2(0.2, 0.0, 0.0))
    mission.decide(4 * SECOND, replace_keyframes(before, bent))
    mission.decide(5 * SECOND, replace_keyframes(before, bent))
    saved = SavedMission.of(mission.to_save(5 * SECOND, SE2(), 0).tree(), Path("mission.json"))
    assert any(near(pose, correction @ look) for pose in saved.looked_from)
    assert near(saved.blacklist[-1][0], correction @ failed)
    assert saved.home is not None
    assert near(saved.home, home)
    resumed = Mission(Config(), euclid)
    resumed.restore(6 * SECOND, saved, SE2())
    resumed.decide(7 * SECOND, replace_keyframes(before, bent))
    all_moved = keyframes(*(correction @ SE2(*row) for row in bent.poses.tolist()))
    resumed.decide(8 * SECOND, replace_keyframes(before, all_moved))
    again = resumed.to_save(8 * SECOND, SE2(), 0).home
    assert again is not None
    assert near(again, correction @ home)


def replace_keyframes(before: Situation, places: KeyframePlaces) -> Situation:
    return before._replace(keyframes=places)


def test_small_steps_add_up_to_a_correction_and_new_keyframes_are_none() -> None:
    corrections, place, moved = MapCorrections(), SE2(1.0, 0.0, 3.13), [SE2(1.2, 0.0, 0.0)]
    for k in range(11):
        there = SE2(0.01 * k, 0.0, 0.005 * k) @ place
        if corrections.update(keyframes(there, *(SE2(2.0 + n, 0.0, 0.0) for n in range(k)))):
            moved = corrections.moved(moved)
    assert moved[0].x == pytest.approx(1.3, abs=0.05)
    assert moved[0].theta == pytest.approx(0.05, abs=0.03)
    assert not MapCorrections().update(keyframes())
