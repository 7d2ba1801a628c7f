"""What wheels may do wrong: left out with a reason, or counted on; never a silently wrong pose."""

import math
from pathlib import Path

import numpy as np
import pytest
from spoilt_drives import FIRST, LAST, TRACKED, between, run

from vsx_ros.config import Config, overridden
from vsx_ros.evaluation.trajectory import align
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.io.recording import Recording
from vsx_ros.robot import Odometry, OdometryEpochs
from vsx_ros.session import SlamSession
from vsx_ros.slam.preprocessing import ContinuousOdometry
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda o: o._replace(T_odom_base=SE2(math.nan, 0.0, 0.0)), "not a number"),
        (lambda o: o._replace(T_odom_base=SE2(0.0, 0.0, math.inf)), "not a number"),
        (lambda o: o._replace(omega=-math.inf), "not a number"),
        (lambda o: o._replace(v=1e9), "cannot be"),
        (lambda o: o._replace(T_odom_base=SE2(1e300, 0.0, 0.0)), "cannot be"),
        (lambda o: o._replace(stamp_ns=o.stamp_ns - 10**9), "s older than"),
        (lambda o: o._replace(stamp_ns=o.stamp_ns + 10**9), "s newer than"),
    ],
)
def test_odometry_that_cannot_be_is_left_out(arc_drive, spoil, words):
    done = run(arc_drive, between(FIRST, LAST, odometry=spoil))
    gaps = done.reasons("gap")
    assert len(gaps) == LAST - FIRST
    assert all(words in gap for gap in gaps)
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.03


@pytest.mark.parametrize("jump", [SE2(3.0, 0.0, 0.0), SE2(0.3, 0.0, 0.0), SE2(0.0, 0.0, 2.0)])
@pytest.mark.parametrize("last", [FIRST + 1, 999])
def test_odometry_that_jumps_is_counted_on(arc_drive, jump, last):
    moved = between(FIRST, last, odometry=lambda o: o._replace(T_odom_base=jump @ o.T_odom_base))
    done = run(arc_drive, moved)
    assert len(done.reasons("gap")) == (2 if last == FIRST + 1 else 1)
    assert all("odometry jumped" in gap for gap in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.02


@pytest.mark.parametrize(("silent_s", "v"), [(0.4, 0.2), (0.5, 0.0), (2.5, 0.2), (6.0, 0.0), (30.0, 0.3)])
@pytest.mark.parametrize("restarted", [False, True])
def test_after_a_silence_a_base_that_restarted_is_counted_on(silent_s, v, restarted):
    gaps = []
    odometry, epochs = ContinuousOdometry(lambda stamp_ns, reason: gaps.append(reason)), OdometryEpochs()
    before, after_ns = Odometry(0, SE2(-5.7, -2.9, 1.0), v, 0.0), round(silent_s * 1e9)
    driven = SE2(v * silent_s, 0.0, 0.0)
    assert odometry.at(0, epochs.enter(before)) == before.T_odom_base
    now = epochs.enter(Odometry(after_ns, SE2() if restarted else before.T_odom_base @ driven, v, 0.0))
    counted, unknown = odometry.at(after_ns, now), restarted and silent_s > 0.5
    moved = SE2() if unknown else driven
    assert (before.T_odom_base.inverse() @ counted).as_array() == pytest.approx(moved.as_array(), abs=1e-9)
    assert ["as if the base had stood" in gap for gap in gaps] == [unknown] * restarted
    assert [odometry.parted(), odometry.parted()] == [unknown, False]
    on = odometry.at(after_ns + 10**8, now._replace(stamp_ns=after_ns + 10**8, T_odom_base=now.T_odom_base @ SE2(0.02)))
    assert (counted.inverse() @ on).as_array() == pytest.approx([0.02, 0.0, 0.0], abs=1e-9)


def test_no_odometry_connects_the_keyframes_before_and_after_a_long_silence_of_a_base_that_restarted(arc_drive):
    """In it the base drove on, 0.15 m; only the images tell."""
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    epochs, states = OdometryEpochs(), []
    for k, (frame, odometry, _) in enumerate(arc_drive.frames):
        moved = odometry._replace(T_odom_base=SE2(3.0, 1.0, 0.5) @ odometry.T_odom_base) if k >= LAST else odometry
        states.append(slam.track(frame, None if FIRST <= k < LAST else epochs.enter(moved)).state)
    assert set(states[FIRST:]) <= set(TRACKED)
    (gap,) = (event.reason for event in slam.drain_events() if event.kind == "gap")
    assert gap.endswith("as if the base had stood")
    keyframes, heard_ns = slam.slam_map().view.keyframes, arc_drive.frames[LAST][0].stamp_ns
    before = {k.odom_segment for k in keyframes if k.data.stamp_ns < heard_ns}
    after = {k.odom_segment for k in keyframes if k.data.stamp_ns >= heard_ns}
    assert after
    assert before.isdisjoint(after)


def test_odometry_that_jumps_before_the_start_does_not_hinder_it(arc_drive):
    done = run(
        arc_drive, between(10, 999, odometry=lambda o: o._replace(T_odom_base=SE2(3.0, 0.0, 0.0) @ o.T_odom_base))
    )
    assert done.results[-1].state is TrackingState.GOOD
    assert done.worst_m < 0.02


@pytest.mark.parametrize("last", [LAST, 999])
def test_wheels_that_stand_while_the_image_moves_are_not_believed(arc_drive, last):
    stuck = arc_drive.frames[FIRST - 1][1].T_odom_base
    still = between(FIRST, last, odometry=lambda o: o._replace(T_odom_base=stuck, v=0.0, omega=0.0))
    done = run(arc_drive, still)
    assert any("contradicts the images" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.04


@pytest.mark.parametrize("share", [0.7, 1.3, 2.0])
def test_wheels_that_slip_are_not_believed(arc_drive, share):
    counted = [arc_drive.frames[39][1].T_odom_base]
    for (_, before, _), (_, after, _) in zip(arc_drive.frames[39:90], arc_drive.frames[40:91]):
        motion = before.T_odom_base.inverse() @ after.T_odom_base
        counted.append(counted[-1] @ SE2(share * motion.x, share * motion.y, motion.theta))
    rest = counted[-1] @ arc_drive.frames[90][1].T_odom_base.inverse()

    def slipping(k, frame, odometry):
        if k < 40:
            return frame, odometry
        T = counted[k - 39] if k < 91 else rest @ odometry.T_odom_base
        return frame, odometry._replace(T_odom_base=T, v=odometry.v * (share if k < 91 else 1.0))

    done = run(arc_drive, slipping)
    assert any("contradicts the images" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    assert done.worst_m < 0.04


def _turned(drive, wrong):
    """Headings of the wheels that are off by wrong(seconds, turn) from frame FIRST on."""
    began = drive.frames[FIRST][1]

    def change(k, frame, odometry):
        if k < FIRST:
            return frame, odometry
        T = odometry.T_odom_base
        seconds = (odometry.stamp_ns - began.stamp_ns) * 1e-9
        off = wrong(seconds, T.theta - began.T_odom_base.theta)
        return frame, odometry._replace(T_odom_base=SE2(T.x, T.y, T.theta + off))

    return change


@pytest.mark.parametrize(
    "wrong",
    [
        lambda seconds, turn: 0.2,
        lambda seconds, turn: -0.25,
        lambda seconds, turn: 0.1,
        lambda seconds, turn: math.radians(5.0) * seconds,
        lambda seconds, turn: -2.0 * turn,
        lambda seconds, turn: -turn,
    ],
    ids=["jumps left", "jumps right", "jumps a little", "drifts", "wrong sign", "stands"],
)
def test_a_heading_of_the_wheels_that_the_image_contradicts_is_never_tracked(arc_drive, wrong):
    """A jump of 0.2 rad, less than a base can turn in a frame and its slack, once turned the map by 12 deg for good."""
    done = run(arc_drive, _turned(arc_drive, wrong))
    assert any("contradicts the images" in reason for reason in done.reasons("gap"))
    assert set(done.states(FIRST)) <= set(TRACKED)
    T_cam_base = arc_drive.T_base_cam.inverse()
    headings = [
        wrap_angle((r.T_world_cam @ T_cam_base).to_se2().theta - (truth @ T_cam_base).to_se2().theta)
        for r, (_, _, truth) in zip(done.results, arc_drive.frames)
        if r.state in TRACKED
    ]
    assert max(abs(wrap_angle(heading - headings[0])) for heading in headings) < math.radians(1.0)
    assert done.worst_m < 0.04


_BLIND = 72  # the first frame without light


@pytest.mark.parametrize(
    "wrong",
    [
        lambda k, o: o._replace(T_odom_base=SE2(0.01 * max(0, min(k, _BLIND) - FIRST)) @ o.T_odom_base),
        lambda k, o: None if k == _BLIND - 1 else o,
        lambda k, o: None if _BLIND - 3 <= k <= _BLIND else o,
    ],
    ids=["slipped", "one is missing", "some are missing"],
)
def test_a_camera_that_is_lost_is_placed_by_odometry_that_was_not_used_just_before(arc_drive, wrong):
    dark = between(_BLIND, _BLIND + 15, image=np.zeros_like)

    def change(k, frame, odometry):
        frame, _ = dark(k, frame, odometry)
        return frame, wrong(k, odometry)

    done = run(arc_drive, change)
    truths = [truth for _, _, truth in arc_drive.frames]
    before = [(r.T_world_cam, T) for r, T in zip(done.results[:_BLIND], truths) if r.T_world_cam is not None]
    to_truth = align(*(np.array([T.translation for T in poses]) for poses in zip(*before)), "yaw")
    lost = range(_BLIND + 4, _BLIND + 15)
    assert {done.results[k].state for k in lost} == {TrackingState.LOST}
    placed = [done.results[k].T_world_cam for k in lost]
    assert all(T is not None for T in placed)
    seen = to_truth.apply(np.array([T.translation for T in placed]))
    assert np.linalg.norm(seen - [truths[k].translation for k in lost], axis=1).max() < 0.03
    assert done.results[-1].state is TrackingState.GOOD
    assert done.worst_m < 0.04


def _heard_late(drive, first, before=0):
    """A session that hears odometry in the first ``before`` frames and from frame ``first`` on, its SLAM, and each
    frame's result and place."""
    session = SlamSession(drive.T_base_cam, overridden(Config(), {"self_calibration.enabled": True}))
    slam, known = session.begin(SequentialSlam, drive.camera, 1), []
    for k, (frame, odometry, _) in enumerate(drive.frames):
        heard = odometry if k < before or k >= first else None
        result = session.track(frame, heard)
        known.append((result, session.locate(result, heard)))
    return session, slam, known


def test_a_map_waits_for_wheels_that_begin_soon_after_the_camera(arc_drive):
    session, slam, known = _heard_late(arc_drive, 8)
    assert slam.slam_map().T_base_cam is session.T_base_cam
    assert known[-1][0].state is TrackingState.GOOD
    there, (_, wheels, _) = known[-1][1].T_map_base, arc_drive.frames[-1]
    assert there.distance_to(wheels.T_odom_base) < 0.05


@pytest.mark.parametrize("stood", [SE2(3.0, 1.0, 0.0), SE2(0.3, 0.0, 0.0)])
def test_a_map_begins_where_odometry_counts_when_it_begins(arc_drive, stood):
    """A base that restarts before the map takes the place of the map with it."""
    session, epochs = SlamSession(arc_drive.T_base_cam, Config()), OdometryEpochs()
    session.begin(SequentialSlam, arc_drive.camera, 1)
    for k, (frame, odometry, _) in enumerate(arc_drive.frames[:FIRST]):
        moved = stood @ odometry.T_odom_base if k < 3 else odometry.T_odom_base
        heard = epochs.enter(odometry._replace(T_odom_base=moved))
        where = session.locate(session.track(frame, heard), heard)
        assert session.T_map_odom.distance_to(SE2()) < 0.05
    assert heard.odom_epoch == 1
    assert where.T_map_base.distance_to(heard.T_odom_base) < 0.05


@pytest.mark.parametrize("before", [0, 5])
def test_a_map_waits_for_wheels_however_long_they_are_silent(arc_drive, before):
    """A base that is switched off, and whose robot is carried, costs nothing but the time."""
    _, slam, known = _heard_late(arc_drive, FIRST, before)
    silent = [result for result, _ in known[before + 1 : FIRST]]
    assert {result.state for result in silent} == {TrackingState.NOT_INITIALISED}
    assert {result.reason for result in silent} == {"odometry is silent: waiting for it"}
    assert known[-1][0].state is TrackingState.GOOD
    there, (_, wheels, _) = known[-1][1].T_map_base, arc_drive.frames[-1]
    assert there.distance_to(wheels.T_odom_base) < 0.05
    assert slam.slam_map().T_base_cam is arc_drive.T_base_cam


@pytest.mark.parametrize("late", [1, 5])
def test_a_recording_whose_odometry_begins_late_is_mapped_in_its_true_size(straight_drive, late):
    """Begun in motion, with images before the first reading: 5 are 0.33 s."""
    frames, readings, truths = zip(*straight_drive.frames[30:])
    recording = Recording(Path("x"), None, None, len(frames), None, readings[late:], [], lambda: iter(frames))
    slam = SequentialSlam(straight_drive.camera, straight_drive.T_base_cam, Config().slam, 1, needs_scale=True)
    results = [slam.track(frame, recording.odometry_at(frame.stamp_ns)) for frame in recording.frames()]
    assert results[-1].state is TrackingState.GOOD
    placed = [(r.T_world_cam, truth) for r, truth in zip(results, truths) if r.T_world_cam is not None]
    seen, true = (np.array([T.translation for T in poses]) for poses in zip(*placed))
    assert align(seen, true, "sim3").scale == pytest.approx(1.0, abs=0.01)
