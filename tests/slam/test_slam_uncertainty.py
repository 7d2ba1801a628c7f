"""How well a pose is known: more along the way, less where a loop is closed, and as odometry goes on alone."""

import dataclasses

import numpy as np
from test_slam_culling import made_map

from vsx_ros.config import Config
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.local_map import LocalMap
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.track import Track
from vsx_ros.slam.uncertainty import PoseUncertainty, carried

CONFIG = Config().slam.uncertainty
RING = np.linspace(0.0, 2.0 * np.pi, 200)
PLACES = np.column_stack([6.4 * np.cos(RING), 6.4 * np.sin(RING), np.zeros(200)])


def seen_from(T_world_cam: SE3) -> Track:
    none = np.zeros(0, np.int64)
    return Track(T_world_cam, TrackingState.GOOD, none, np.zeros((0, 2)), none, none, 1e8 * np.eye(6), "")


def sigma_m(local: LocalMap, uncertainty: PoseUncertainty) -> float:
    pose = local.view.keyframes[local.reference].T_world_cam
    return float(np.sqrt(np.trace(uncertainty.tracked(seen_from(pose), local)[:3, :3])))


def test_a_covariance_is_carried_as_its_samples_are():
    rng = np.random.default_rng(1)
    T_a_b = SE3.exp(np.array([0.5, -0.3, 0.8, 0.4, -0.2, 0.6]))
    root = 1e-4 * rng.normal(size=(6, 6))
    moved = [(T_a_b.inverse() @ SE3.exp(root @ x) @ T_a_b).log() for x in rng.normal(size=(20000, 6))]
    expected = carried(root @ root.T, T_a_b)
    assert np.abs(np.cov(np.array(moved).T) - expected).max() < 0.05 * np.abs(expected).max()


def test_uncertainty_grows_along_the_way_and_goes_when_the_loop_is_closed():
    sees = [list(range(25 * k, 25 * k + 200)) for k in range(200)]
    view = made_map(sees, places=PLACES).view()
    uncertainty = PoseUncertainty(CONFIG)
    grown = []
    for k in range(0, 200, 3):
        uncertainty.enter(LocalMap(view, k))
        grown.append(sigma_m(LocalMap(view, k), uncertainty))
    assert grown[0] < 0.003
    assert np.all(np.diff(np.array(grown)[5:30]) > 0.0)
    last = LocalMap(view, 199)
    uncertainty.enter(last)
    open_m = sigma_m(last, uncertainty)
    sees[199] = [*sees[199], *range(20)]
    closed = LocalMap(made_map(sees, places=PLACES).view(), 199)
    uncertainty.enter(closed)
    assert open_m > 0.03
    assert sigma_m(closed, uncertainty) < 0.5 * open_m


def test_a_map_made_before_is_known_by_the_way_through_it():
    sees = [list(range(25 * k, 25 * k + 200)) for k in range(200)]
    local = LocalMap(made_map(sees, places=PLACES).view(), 100)
    uncertainty = PoseUncertainty(CONFIG)
    uncertainty.enter(local)
    assert 0.02 < sigma_m(local, uncertainty) < 0.5


def test_a_map_that_is_joined_is_no_more_certain_than_what_it_is_joined_to():
    sees = [list(range(25 * k, 25 * k + 200)) for k in range(60)]
    world, uncertainty = made_map(sees), PoseUncertainty(CONFIG)
    for k in range(40, 60):
        world.keyframes[k] = dataclasses.replace(world.keyframes[k], map_id=1)
    apart = world.view()
    for map_id, numbers in ((0, range(40)), (1, range(40, 60))):
        for k in numbers:
            uncertainty.enter(LocalMap(apart.part(map_id), k))
    alone = sigma_m(LocalMap(apart.part(0), 39), uncertainty)
    world.join(1, 0)
    joined = world.view()
    for k in [*range(39, 60), *range(59, 37, -1)]:
        uncertainty.enter(LocalMap(joined, k))
    assert sigma_m(LocalMap(joined, 39), uncertainty) > 0.9 * alone
    assert sigma_m(LocalMap(joined, 50), uncertainty) > alone


def test_odometry_alone_adds_its_own_noise():
    uncertainty = PoseUncertainty(CONFIG)
    step, information = SE3(np.eye(3), np.array([0.0, 0.0, 0.01])), np.full(6, 1e6)
    for _ in range(100):
        uncertainty.moved(step, information)
    assert abs(np.sqrt(uncertainty.covariance[2, 2]) - 0.01) < 1e-6, "a hundred times 1 mm, along the way"
    assert uncertainty.covariance[0, 0] > 1.1e-4, "and aside, turned by 1 mrad at each of them"


def test_a_pose_beyond_a_gap_is_no_more_certain_than_odometry_across_it():
    sees = [list(range(25 * k, 25 * k + 200)) for k in range(20)]
    sees += [[1000 + row for row in rows] for rows in sees]
    before, after = made_map(sees[:20]).view(), made_map(sees).view()
    uncertainty = PoseUncertainty(CONFIG)
    for k in range(20):
        uncertainty.enter(LocalMap(before, k))
    known_m = sigma_m(LocalMap(before, 19), uncertainty)
    step, information = SE3(np.eye(3), np.array([0.001, 0.0, 0.0])), np.full(6, 1e6)
    for _ in range(100):
        by_odometry = uncertainty.moved(step, information)
    crossed_m = float(np.sqrt(np.trace(by_odometry[:3, :3])))
    assert crossed_m > 1.2 * known_m
    for k in range(20, 40):
        uncertainty.enter(LocalMap(after, k))
        assert sigma_m(LocalMap(after, k), uncertainty) > 0.9 * crossed_m
    uncertainty.enter(LocalMap(after, 25))
    assert sigma_m(LocalMap(after, 25), uncertainty) > known_m


def test_every_pose_of_a_drive_has_a_covariance(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    sigmas = []
    for frame, odometry, _ in arc_drive.frames[:80]:
        result = slam.track(frame, odometry)
        assert (result.covariance is None) == (result.T_world_cam is None) or result.reason == "map started"
        if result.covariance is not None:
            assert np.linalg.eigvalsh(result.covariance).min() > 0.0
            sigmas.append(np.sqrt(np.trace(result.covariance[:3, :3])))
    assert len(sigmas) > 30
    assert 2e-4 < min(sigmas) < max(sigmas) < 0.03
