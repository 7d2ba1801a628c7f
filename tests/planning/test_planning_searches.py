"""Searches over positions and headings: from either end, and of every pose at once."""

import math

import numpy as np
import pytest
from walled_rooms import with_wall

from vsx_ros.config import PlannerConfig, RobotConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.clearance import DistanceField
from vsx_ros.kernels.planning.lattice import lattice_search
from vsx_ros.kernels.planning.motions import Lattice
from vsx_ros.kernels.planning.shortcuts import MAX_SEGMENTS, shorten
from vsx_ros.occupancy.distance import joined_distance
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.planning import lattice_ways
from vsx_ros.planning.coarse_path import ArcBounds, CoarsePath, shortest_word
from vsx_ros.planning.corridor import Corridor, build_corridor
from vsx_ros.planning.lattice_ways import coarse_lattice, is_stuck, search, search_lattice_back, word_table
from vsx_ros.planning.path import Plan, Refusal
from vsx_ros.planning.planner import Planner

ROBOT, CONFIG = RobotConfig(), PlannerConfig(phi_rad_m=1.0)


def margins(map_: OccupancyGrid, start: SE2, goal: SE2) -> DistanceField:
    corridor = build_corridor(map_, start, goal, CONFIG, ROBOT)
    assert isinstance(corridor, Corridor)
    return corridor.margin


def assert_leads_freely(way: CoarsePath, start: SE2, goal: SE2, margin: DistanceField) -> None:
    end = way.arcs(start)[-1].end
    assert end.distance_to(goal) < 1e-9
    assert abs(end.angle_to(goal)) < 1e-9
    assert way.longest_reverse_m <= 1.5 + 1e-9
    for piece in way.pieces(start):
        assert margin.at(piece.table[:, 1:3]).min() >= -1e-3


@pytest.mark.parametrize("seed", range(4))
def test_a_way_searched_from_the_goal_leads_from_the_start_to_it(seed):
    draw = np.random.default_rng(seed)
    map_ = with_wall(slice(55, 75))
    start, goal = SE2(0.5, 0.5, draw.uniform(-3.0, 3.0)), SE2(3.5, 0.5, draw.uniform(-3.0, 3.0))
    margin = margins(map_, start, goal)
    way = search_lattice_back(start, goal, ArcBounds(margin, 1.0, 1.5), coarse_lattice(1.0))
    assert way is not None
    assert_leads_freely(way, start, goal, margin)


def test_only_a_pose_without_room_for_an_arc_is_stuck():
    data = np.full((80, 80), OCCUPIED, np.int8)
    data[20:32, 20:32] = FREE  # a cell of 0.6 m, and a hall beside it
    data[40:75, 5:75] = FREE
    map_ = OccupancyGrid(data, 0.05, 0.0, 0.0)
    pocket, hall, far = SE2(1.3, 1.3, 0.4), SE2(2.0, 3.0, 0.4), SE2(3.0, 3.2, 0.0)
    margin = margins(map_, pocket, hall)
    assert is_stuck(pocket, far, ArcBounds(margin, 1.0, 1.5), coarse_lattice(1.0))
    assert not is_stuck(hall, pocket, ArcBounds(margin, 1.0, 1.5), coarse_lattice(1.0))


def test_shortcuts_of_a_way_with_the_most_segments_write_within_their_arrays():
    field = DistanceField(np.full((10, 10), -1.0), 0.05, -5.0, -1.0)  # nothing is free
    turns = np.where(np.arange(MAX_SEGMENTS) % 2 == 0, 1, -1)
    lengths = np.where(np.arange(MAX_SEGMENTS) < MAX_SEGMENTS - 6, 1e-3, 0.4)  # most places are near the end
    uncompiled = shorten.__wrapped__  # it checks indices
    with np.errstate(over="ignore"):
        left = uncompiled(field, np.zeros(3), turns, lengths, 2.0, 1.5, 0.15, np.uint64(1), 100)
    assert (left[0] == turns).all()
    assert (left[1] == lengths).all()


def test_travel_costs_go_around_obstacles():
    planner = Planner(CONFIG, ROBOT)
    start = SE2(0.5, 0.0, 0.0)
    map_ = with_wall(slice(55, 75))
    poses = np.array([
        [1.2, 0.0, 0.0],
        [3.0, 0.0, 0.0],  # behind the wall
        [1.98, 0.0, 0.0],  # in the wall
        [90.0, 0.0, 0.0],
        [0.5, 0.0, math.pi],  # here, but turned round
    ])  # fmt: skip
    costs = planner.travel_costs(start, map_, CONFIG.clearance_m, poses)
    assert costs[0] == pytest.approx(0.7, abs=0.2)
    assert 5.0 < costs[1] < 10.0
    assert np.isinf(costs[2])
    assert np.isinf(costs[3])
    assert 1.5 < costs[4] < 5.0
    plan = planner.plan(start, SE2(*poses[1]), map_, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    assert costs[1] == pytest.approx(plan.path.length_m, rel=0.2)
    blocked = planner.travel_costs(SE2(50.0, 50.0, 0.0), map_, CONFIG.clearance_m, poses)
    assert np.all(np.isinf(blocked))


@pytest.mark.compiled
def test_travel_costs_in_a_large_hall_are_as_long_as_the_ways():
    hall = OccupancyGrid(np.zeros((800, 800), np.int8), 0.05, -20.0, -20.0)
    headings = np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
    poses = np.column_stack([15.0 * np.cos(headings), 15.0 * np.sin(headings), headings])
    costs = Planner(CONFIG, ROBOT).travel_costs(SE2(), hall, CONFIG.clearance_m, poses)
    least = [shortest_word(SE2(), SE2(*pose), CONFIG.phi_rad_m).length_m for pose in poses.tolist()]
    assert costs == pytest.approx(np.array(least), rel=0.05)


def test_travel_costs_do_not_depend_on_the_order_of_the_poses_nor_on_full_turns():
    planner, map_ = Planner(CONFIG, ROBOT), with_wall(slice(55, 75))
    draw = np.random.default_rng(3)
    poses = np.repeat(draw.uniform((-0.9, -0.9, -3.0), (4.9, 2.9, 3.0), (60, 3)), 3, axis=0)
    poses[:, 2] += np.tile([0.0, 1.0, 2.0], 60)
    start = SE2(0.5, 0.0, 7.0)
    costs = planner.travel_costs(start, map_, CONFIG.clearance_m, poses)
    assert 20 < np.isfinite(costs).sum() < 180
    shuffled = draw.permutation(180)
    assert planner.travel_costs(start, map_, CONFIG.clearance_m, poses[shuffled]).tobytes() == costs[shuffled].tobytes()
    turned = planner.travel_costs(start, map_, CONFIG.clearance_m, poses + np.array([0.0, 0.0, 2.0 * math.pi]))
    assert turned == pytest.approx(costs, abs=1e-4)


def test_a_goal_in_a_pocket_is_reached_by_arcs_that_are_short_there_only():
    data = np.full((200, 200), OCCUPIED, np.int8)
    data[20:180, 20:120] = FREE
    data[90:104, 120:144] = FREE  # a niche of 0.7 x 1.2 m, where the base needs 0.44 m
    map_ = OccupancyGrid(data, 0.05, 0.0, 0.0)
    start, goal = SE2(2.0, 2.0, 0.3), SE2(6.6, 4.86, 1.3)
    margin = margins(map_, start, goal)
    bounds = ArcBounds(margin, 0.9, 1.5)
    assert is_stuck(SE2(goal.x, goal.y, goal.theta + math.pi), start, bounds, coarse_lattice(0.9))
    way = search(start, goal, bounds, joined_distance(margin, (goal.x, goal.y)))
    assert way is not None
    assert_leads_freely(way, start, goal, margin)


@pytest.mark.compiled
def test_a_goal_that_faces_out_of_a_dead_end_is_given_up_without_a_search_of_the_whole_map(monkeypatch):
    data = np.full((500, 620), OCCUPIED, np.int8)
    data[10:490, 10:490] = FREE
    data[244:256, 490:610] = FREE  # 60 cm wide and 6 m long: no room to turn
    map_, searched = OccupancyGrid(data, 0.05, 0.0, 0.0), list[int]()

    def counted(*args):
        found = lattice_search(*args)
        searched.append(len(found[0]))
        return found

    monkeypatch.setattr(lattice_ways, "lattice_search", counted)
    planner, start = Planner(PlannerConfig(), ROBOT), SE2(3.0, 3.0, 0.0)
    refused = planner.plan(start, SE2(30.0, 12.5, math.pi), map_, np.random.default_rng(0))
    assert isinstance(refused, Refusal)
    assert 10_000 < sum(searched) < 250_000
    assert isinstance(planner.plan(start, SE2(30.0, 12.5, 0.0), map_, np.random.default_rng(0)), Plan)


def test_the_memory_of_a_search_grows_with_its_arrivals_and_not_with_the_map():
    field, goal = DistanceField(np.full((20, 20), 99.0), 50.0, 0.0, 0.0), np.array([503.0, 501.0, 1.0])
    lattice = Lattice(headings=96, bins=2, cell_m=0.025, most_states=120_000)  # a byte for each state would be 154 GB
    start, hopes = np.array([500.0, 500.0, 0.0]), np.zeros((20, 20))
    poses, *_, winner = lattice_search(field, start, 1.0, lattice, 1.5, goal, hopes, word_table())
    assert 0 <= winner < len(poses) < 1000
