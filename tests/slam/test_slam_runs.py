"""Whole runs: metric start, tracking, recovery, refusals, determinism; on the emulator and on recordings."""

import os
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.evaluation.trajectory import trajectory_error
from vsx_ros.io.bag import open_recording
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.robot import Frame
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam
from vsx_ros.slam.state import TrackingState
from vsx_ros.vision.corners import PackedCorners

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[2] / "../shared/data"))
CONFIG = Config().slam


def run(drive, slam=None, change=lambda k, frame, odometry: (frame, odometry)):
    slam = slam or SequentialSlam(drive.camera, drive.T_base_cam, CONFIG, 1)
    results, pairs = [], []
    for k, (frame, odometry, truth) in enumerate(drive.frames):
        result = slam.track(*change(k, frame, odometry))
        results.append(result)
        if result.T_world_cam is not None:
            pairs.append((result.T_world_cam, truth))
    return slam, results, pairs


def test_drive_starts_metric_and_is_never_lost(arc_drive):
    slam, results, pairs = run(arc_drive)
    started = next(k for k, r in enumerate(results) if r.state is not TrackingState.NOT_INITIALISED)
    assert results[started - 1].reason
    assert all(r.state in (TrackingState.GOOD, TrackingState.DUBIOUS) for r in results[started:])
    error = trajectory_error(pairs, "se3")
    assert error.ate_rmse_m < 0.01
    assert error.scale_error < 0.02
    statistics = slam.statistics()
    assert statistics.frames == len(results)
    assert statistics.frames_tracked == len(results) - started
    assert statistics.frames_lost == 0
    assert 0.8 < statistics.u1 <= 1.0
    assert statistics.u2_frames > 5
    assert [e.kind for e in slam.drain_events()].count("initialised") == 1
    assert slam.drain_events() == []


def test_world_is_the_odometry_frame(arc_drive):
    slam, _, _ = run(arc_drive)
    heights = [T.translation[2] for T in slam.snapshot().T_world_cams]
    assert np.abs(np.array(heights) - arc_drive.T_base_cam.translation[2]).max() < 0.01
    points = slam.snapshot().points_world
    assert (points[:, 2] > -0.15).mean() > 0.95
    assert points[:, 2].max() < 3.2


def test_snapshot_is_consistent_and_cached(arc_drive):
    slam, results, _ = run(arc_drive)
    snapshot = slam.snapshot()
    assert slam.snapshot() is snapshot
    assert sum(r.keyframe_added for r in results) == len(snapshot.keyframe_ids) - 1
    assert (np.diff(snapshot.keyframe_stamps_ns) > 0).all()
    seen = np.bincount(snapshot.obs_point, minlength=len(snapshot.points_world))
    assert seen.min() >= 2
    assert snapshot.obs_keyframe.max() < len(snapshot.images)
    assert snapshot.images[0].shape == (480, 640)
    k, p = snapshot.obs_keyframe, snapshot.obs_point
    errors = []
    for index, T in enumerate(snapshot.T_world_cams):
        own = k == index
        uv = arc_drive.camera.project(T.inverse() @ snapshot.points_world[p[own]])
        errors.append(np.linalg.norm(uv - snapshot.obs_uv[own], axis=1) / 2.0 ** snapshot.obs_level[own])
    assert np.median(np.concatenate(errors)) < 0.8
    assert np.percentile(np.concatenate(errors), 99) < 4.0


def test_the_same_drive_gives_the_same_bits(arc_drive):
    first, second = run(arc_drive)[2], run(arc_drive)[2]
    assert len(first) == len(second)
    for (a, _), (b, _) in zip(first, second):
        assert a.matrix().tobytes() == b.matrix().tobytes()


def test_turn_in_place_is_survived(spin_drive):
    slam, results, pairs = run(spin_drive)
    assert sum(r.state is TrackingState.LOST for r in results) <= 8
    assert results[-1].state is not TrackingState.LOST
    assert trajectory_error(pairs, "se3").ate_rmse_m < 0.05


def test_blackout_is_marked_and_overcome(arc_drive):
    def blackout(k, frame, odometry):
        return (Frame(frame.stamp_ns, np.zeros_like(frame.image)) if 60 <= k < 75 else frame), odometry

    slam, results, pairs = run(arc_drive, change=blackout)
    assert all(r.state is TrackingState.LOST for r in results[63:75])
    assert all("0 corners" in r.reason for r in results[63:75])
    assert all(r.T_world_cam is not None for r in results[63:75])
    assert all(r.state is not TrackingState.LOST for r in results[78:])
    kinds = [e.kind for e in slam.drain_events()]
    assert kinds.count("lost") == 1
    assert kinds.count("relocalised") == 1
    assert slam.statistics().frames_lost == 15
    assert trajectory_error(pairs, "se3").ate_rmse_m < 0.02


def test_without_wheels_a_camera_found_again_begins_an_epoch_of_keyframes(arc_drive):
    def blackout(k, frame, odometry):
        return (Frame(frame.stamp_ns, np.zeros_like(frame.image)) if 60 <= k < 75 else frame), None

    slam, results, _ = run(arc_drive, change=blackout)
    assert results[-1].state is not TrackingState.LOST
    world = slam._mapper.map
    after = [k.id for k in world.keyframes if k.data.stamp_ns >= arc_drive.frames[75][0].stamp_ns]
    assert after
    assert {world.keyframes[k].odom_segment for k in after}.isdisjoint(
        k.odom_segment for k in world.keyframes[: after[0]]
    )
    assert world.predecessor(after[0]) is None


def test_standing_still_never_starts_and_says_so(arc_drive):
    frame, odometry, _ = arc_drive.frames[0]
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG)
    for k in range(20):
        result = slam.track(
            frame._replace(stamp_ns=frame.stamp_ns + k * 66_000_000),
            odometry._replace(stamp_ns=frame.stamp_ns + k * 66_000_000),
        )
    assert result.state is TrackingState.NOT_INITIALISED
    assert "stands still" in result.reason
    assert len(slam.snapshot().keyframe_ids) == 0
    assert slam.statistics().initialized_at_s is None


def test_a_refusal_is_an_event_only_when_its_kind_changes(arc_drive):
    slam, results, _ = run(arc_drive)
    reasons = [r.reason for r in results if r.state is TrackingState.NOT_INITIALISED]
    kinds = [reason.split(":")[0] for reason in reasons]
    changes = [reason for k, reason in enumerate(reasons) if k == 0 or kinds[k] != kinds[k - 1]]
    refusals = [e.reason for e in slam.drain_events() if e.kind == "refused"]
    assert refusals == changes
    assert len(refusals) < 5 < len(set(reasons))


def test_odometry_that_contradicts_the_images_is_refused(arc_drive):
    def sideways(k, frame, odometry):
        T = odometry.T_odom_base
        return frame, odometry._replace(T_odom_base=type(T)(T.y, T.x, T.theta))

    drive = arc_drive._replace(frames=arc_drive.frames[:47])
    _, results, _ = run(drive, change=sideways)
    assert all(r.state is TrackingState.NOT_INITIALISED for r in results)
    assert any("odometry disagrees" in r.reason for r in results)


def test_without_odometry_the_baseline_is_the_configured_unit(arc_drive):
    slam, results, pairs = run(arc_drive, change=lambda k, frame, odometry: (frame, None))
    assert results[-1].state is TrackingState.GOOD
    first, second = slam.snapshot().T_world_cams[:2]
    assert np.abs(first.matrix() - np.eye(4)).max() < 1e-12
    assert 0.05 < np.linalg.norm(second.translation) < 0.2
    assert trajectory_error(pairs, "sim3").ate_rmse_m < 0.03


def test_bad_input_is_named_and_leaves_no_trace(arc_drive):
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    pairs = []
    for k, (frame, odometry, truth) in enumerate(arc_drive.frames):
        result = slam.track(frame, odometry)
        if result.T_world_cam is not None:
            pairs.append((result.T_world_cam, truth))
        if k == 60:
            later = frame.stamp_ns + 1_000_000
            with pytest.raises(InputError, match="320x240 does not fit the calibration"):
                slam.track(Frame(later, frame.image[::2, ::2].copy()), odometry)
            with pytest.raises(InputError, match="expected .* grey"):
                slam.track(Frame(later, frame.image.astype(np.float32)), odometry)
            with pytest.raises(InputError, match="not after"):
                slam.track(frame, odometry)
    assert slam.statistics().frames == len(arc_drive.frames)
    undisturbed = run(arc_drive)[2]
    assert pairs[-1][0].matrix().tobytes() == undisturbed[-1][0].matrix().tobytes()


def test_odometry_that_is_no_number_is_a_marked_gap(arc_drive):
    def spoilt(k, frame, odometry):
        return frame, odometry._replace(v=float("nan")) if k in (70, 71) else odometry

    slam, results, pairs = run(arc_drive, change=spoilt)
    assert results[-1].state is TrackingState.GOOD
    assert trajectory_error(pairs, "se3").ate_rmse_m < 0.01
    gaps = [e for e in slam.drain_events() if e.kind == "gap"]
    assert len(gaps) == 2
    assert "not a number" in gaps[0].reason


def test_threads_track_the_same_drive(arc_drive):
    slam = ThreadedSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)
    try:
        _, results, pairs = run(arc_drive, slam)
        assert results[-1].state is not TrackingState.LOST
        assert trajectory_error(pairs, "se3").ate_rmse_m < 0.03
        snapshot = slam.snapshot()
        assert len(snapshot.keyframe_ids) >= 3
        assert slam.statistics().frames == len(results)
    finally:
        slam.close()
    slam.close()


def test_a_broken_mapper_is_reported_to_the_caller(arc_drive, monkeypatch):
    slam = ThreadedSlam(arc_drive.camera, arc_drive.T_base_cam, CONFIG, 1)

    def broken(request):
        raise RuntimeError("mapper broke")

    monkeypatch.setattr(slam._mapper, "add_keyframe", broken)
    with pytest.raises(RuntimeError, match="mapper broke"):
        run(arc_drive, slam)
    slam.close()


def test_packed_keyframes_are_searched_and_their_map_goes_on_from_a_file(arc_drive, tmp_path):
    culling = msgspec.structs.replace(CONFIG.culling, behind=1)
    config = msgspec.structs.replace(CONFIG, culling=culling)
    slam, results, _ = run(arc_drive, SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, config, 1))
    assert results[-1].state is TrackingState.GOOD
    assert sum(isinstance(k.data.corners, PackedCorners) for k in slam.slam_map().view.keyframes if k.alive) > 3
    save_slam_map(slam.slam_map(), tmp_path / "map.vsx")
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, config, 1, load_slam_map(tmp_path / "map.vsx"))
    assert run(arc_drive, slam)[1][-1].state is TrackingState.GOOD


def recording(name):
    if not (DATA / name).exists():
        pytest.skip(f"{DATA / name} is absent (set VSX_DATA)")
    return open_recording(DATA / name)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "tracked", "ate_m"),
    [("vamr_checkerboard", 88, 0.0013), ("new_tsukuba_150", 138, 0.009), ("visp_rbt_desk", 80, 0.025)],
)
def test_recordings_are_tracked(name, tracked, ate_m):
    source = recording(name)
    slam = SequentialSlam(source.camera, None, CONFIG, 1)
    truth = {p.stamp_ns: p.T for p in source.ground_truth}
    pairs = []
    for frame in source.frames():
        result = slam.track(frame)
        if result.T_world_cam is not None and frame.stamp_ns in truth:
            pairs.append((result.T_world_cam, truth[frame.stamp_ns]))
    assert slam.statistics().frames_tracked >= tracked
    assert slam.statistics().frames_lost == 0
    assert trajectory_error(pairs, "sim3").ate_rmse_m < ate_m


@pytest.mark.data
@pytest.mark.parametrize("first", [5, 35])
def test_a_map_keeps_up_with_a_camera_that_turns_at_60_deg_a_second(first):
    source = recording("new_tsukuba_150")
    frames, slam = list(source.frames())[first::3], SequentialSlam(source.camera, None, CONFIG, 1)
    for frame in frames:
        slam.track(frame)
    assert slam.statistics().frames_lost == 0
    assert slam.statistics().frames_tracked >= 0.9 * len(frames)


@pytest.mark.data
@pytest.mark.parametrize(("width_px", "step_px", "first"), [(224, 50, 90), (224, 25, 60), (300, 50, 60)])
def test_somebody_who_passes_close_by_is_no_rotation_of_the_camera(width_px, step_px, first):
    source, clothes = recording("new_tsukuba_150"), np.random.default_rng(3).integers(0, 255, (24, width_px // 20))
    slam = SequentialSlam(source.camera, None, CONFIG, 1)
    folds = cv2.resize(clothes.astype(np.uint8), (width_px, 420), interpolation=cv2.INTER_CUBIC).astype(float)
    person = np.clip(100 + 0.35 * (folds - folds.mean()), 0, 255).astype(np.uint8)
    for k, frame in enumerate(source.frames()):
        left = (k - first) * step_px - width_px
        image, at = frame.image.copy(), slice(max(0, left), max(0, left + width_px))
        image[60:, at] = person[:, max(0, -left) :][:, : image[:, at].shape[1]]
        slam.track(frame._replace(image=image if k >= first else frame.image))
    assert slam.statistics().frames_lost == 0


@pytest.mark.data
def test_a_standing_camera_never_starts():
    source = recording("euroc_v101_stationary")
    slam = SequentialSlam(source.camera, None, CONFIG, 1)
    for frame in source.frames():
        result = slam.track(frame)
        assert result.state is TrackingState.NOT_INITIALISED
    assert "stands still" in result.reason
    assert [e.kind for e in slam.drain_events()] == ["refused", "refused"]
