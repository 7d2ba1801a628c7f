import numpy as np
import pytest

from vsx_ros import __version__
from vsx_ros.evaluation.summary import Summary, tracking_summary, with_accuracy
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.slam.state import SlamStatistics

PROMISED = (
    "frames frames_tracked frames_lost breaks odometry_jumps relocalizations initialized_at_s keyframes map_points "
    "u1 u2_frames u2_seconds u2_metres visible_ratio track_ms_median track_ms_p99 ate_rmse_m ate_rmse_sim3_m "
    "ate_final_rmse_m ate_final_rmse_sim3_m ate_of scale_error path_length_m duration_s "
    "coverage coverage_correct occupied_precision "
    "occupied_recall free_inside_obstacle collisions collisions_with_people touched_by_people driven_m "
    "min_clearance_m planned_vs_executed_rms_m plans "
    "plan_ms_median plan_ms_p99 map_note stop_reason ended_well world seed planner phi continued_map version"
)
STATISTICS = SlamStatistics(20, 15, 1, 1, 0.8, 7.0, 0.5, 0.1, 4, 300, 0.4)


def test_exactly_the_promised_keys():
    assert " ".join(Summary().as_dict()) == PROMISED


def test_what_is_unknown_is_none_and_so_is_not_a_number():
    tree = Summary(u1=float("nan"), coverage=float("inf"), frames=0).as_dict()
    assert (tree["u1"], tree["coverage"], tree["frames"], tree["version"]) == (None, None, 0, __version__)
    assert tree["ate_rmse_m"] is None


def test_statistics_and_times_are_taken_over():
    summary = tracking_summary(STATISTICS, [10.0, 20.0, 90.0])
    assert (summary.frames, summary.u2_metres, summary.map_points, summary.track_ms_median) == (20, 0.1, 300, 20.0)
    assert 85 < summary.track_ms_p99 <= 90
    assert tracking_summary(STATISTICS, []).track_ms_median is None


@pytest.fixture
def walk():
    positions = np.cumsum(np.random.default_rng(1).normal(0, 0.1, (30, 3)), axis=0)
    return [StampedPose(i * 10**8, SE3(np.eye(3), p)) for i, p in enumerate(positions)]


def test_accuracy_of_a_metric_map(walk):
    small = [StampedPose(s, SE3(T.rotation, 0.9 * T.translation)) for s, T in walk]
    summary = with_accuracy(Summary(), small, walk, walk, "yaw")
    assert summary.ate_rmse_sim3_m < 1e-9 < summary.ate_rmse_m
    assert summary.scale_error == pytest.approx(0.1)
    assert summary.ate_of == "live poses (trajectory.txt)"
    assert summary.ate_final_rmse_m < 1e-9, "the final poses are right"
    assert summary.path_length_m > 1


def test_a_map_without_scale_claims_none(walk):
    summary = with_accuracy(Summary(), walk, walk, walk, None)
    assert (summary.ate_rmse_m, summary.scale_error, summary.path_length_m) == (None, None, None)
    assert summary.ate_final_rmse_m is None
    assert summary.ate_final_rmse_sim3_m < 1e-9
    assert summary.ate_rmse_sim3_m < 1e-9


def test_no_truth_no_error(walk):
    assert with_accuracy(Summary(), walk, walk, [], "se3").ate_rmse_m is None
    late = [StampedPose(s + 10**15, T) for s, T in walk]
    assert with_accuracy(Summary(), walk, walk, late, "se3").ate_of is None
