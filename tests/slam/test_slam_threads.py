"""A start takes longer than a frame: the tracker goes on while the mapper makes the map."""

import threading
import time

import pytest
from waiting import PATIENCE_S

from vsx_ros.config import Config
from vsx_ros.slam.initialization import TRIED
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam
from vsx_ros.slam.start_watch import GiveUp
from vsx_ros.slam.state import TrackingState
from vsx_ros.slam.two_view_reconstruction import InitialPair

SECOND = 10**9


@pytest.fixture
def slam(arc_drive):
    slam = ThreadedSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    yield slam
    slam.close()


def until_tried(slam, frames):
    """(number of the first frame that waits for a map, its result)."""
    for k, (frame, odometry, _) in enumerate(frames):
        result = slam.track(frame, odometry)
        if result.reason == TRIED:
            return k, result
    raise AssertionError("no pair of frames was tried")


def finished(slam):
    while slam._tried is None:
        time.sleep(0.001)


def test_frames_go_on_while_the_map_is_made(slam, arc_drive, monkeypatch):
    begun, release, make = threading.Event(), threading.Event(), slam._mapper.start

    def slow(pair):
        begun.set()
        assert release.wait(PATIENCE_S)
        return make(pair)

    monkeypatch.setattr(slam._mapper, "start", slow)
    first, result = until_tried(slam, arc_drive.frames)
    assert begun.wait(PATIENCE_S)
    for frame, odometry, _ in arc_drive.frames[first + 1 : first + 4]:
        result = slam.track(frame, odometry)
        assert (result.state, result.reason) == (TrackingState.NOT_INITIALISED, TRIED)
    assert slam.slam_map() is None
    release.set()
    finished(slam)
    later = [slam.track(frame, odometry) for frame, odometry, _ in arc_drive.frames[first + 4 : first + 8]]
    assert {r.state for r in later} == {TrackingState.GOOD}
    event = next(e for e in slam.drain_events() if e.kind == "initialised")
    assert event.stamp_ns == arc_drive.frames[first][0].stamp_ns
    assert slam.statistics().frames == first + 8
    assert slam.statistics().frames_tracked == 5


def test_a_refusal_of_the_mapper_is_told_and_another_pair_tried(slam, arc_drive, monkeypatch):
    make = slam._mapper.start
    monkeypatch.setattr(slam._mapper, "start", lambda pair: "odometry disagrees with the images: by far")
    first, _ = until_tried(slam, arc_drive.frames)
    finished(slam)
    monkeypatch.setattr(slam._mapper, "start", make)
    frame, odometry, _ = arc_drive.frames[first + 1]
    result = slam.track(frame, odometry)
    assert result.state is TrackingState.NOT_INITIALISED
    assert "odometry disagrees" in result.reason
    refused = [e for e in slam.drain_events() if e.kind == "refused"][-1]
    assert (refused.stamp_ns, refused.reason) == (arc_drive.frames[first][0].stamp_ns, result.reason)
    finished(slam)
    frame, odometry, _ = arc_drive.frames[first + 2]
    assert slam.track(frame, odometry).state is TrackingState.GOOD


def begun(arc_drive, monkeypatch):
    """A map after forty frames, the pairs that it was offered, and what makes a map of a pair."""
    slam = SequentialSlam(arc_drive.camera, arc_drive.T_base_cam, Config().slam, 1)
    pairs, make = [], slam._mapper.start
    monkeypatch.setattr(slam._mapper, "start", lambda pair: pairs.append(pair) or make(pair))
    for frame, odometry, _ in arc_drive.frames[:40]:
        slam.track(frame, odometry)
    return slam, pairs, make


def test_a_camera_found_again_meanwhile_stays_where_it_is(arc_drive, monkeypatch):
    slam, pairs, make = begun(arc_drive, monkeypatch)
    front = slam._front
    assert front._bootstrap.claim(pairs[0]) is pairs[0]
    assert front._bootstrap.claim(pairs[0]) is None
    second = make(pairs[0]._replace(odom_segment=next(front._segments)))
    assert second.keyframes[-1].map_id == 1
    assert front.started(second) is None
    assert next(front._segments) > second.keyframes[-1].odom_segment > front._segment
    frame, odometry, _ = arc_drive.frames[40]
    result = slam.track(frame, odometry)
    assert (result.state, result.map_id) == (TrackingState.GOOD, 0)


def test_a_map_that_begins_before_the_end_of_the_last_was_seen_begins_anew(arc_drive, monkeypatch):
    slam, pairs, make = begun(arc_drive, monkeypatch)
    front, world = slam._front, slam._mapper.map
    assert front._bootstrap.claim(pairs[0]) is pairs[0]
    world.clear()
    front.recovery.begin_lost()
    assert front.started(make(pairs[0])).state is TrackingState.GOOD
    assert len(front._view.keyframes) == 2
    frame, odometry, _ = arc_drive.frames[40]
    front.process(frame, odometry)


def test_a_small_map_that_is_not_given_up_is_left_for_a_second_one(arc_drive, monkeypatch):
    """A loaded map of few keyframes, without wheels, is no start that could be given up: nothing watches it."""
    slam, pairs, _ = begun(arc_drive, monkeypatch)
    recovery = slam._front.recovery
    monkeypatch.setattr(recovery, "search", lambda *_: None)
    monkeypatch.setattr(recovery, "second_map", lambda *_: pairs[0])
    monkeypatch.setattr(recovery, "gives_up", lambda data, view: GiveUp(data.stamp_ns, "lost"))
    frame, _, _ = arc_drive.frames[40]
    _, work = slam._front.process(frame._replace(image=frame.image[::-1].copy()), None)
    assert isinstance(work, InitialPair), "claimed, and hence to be returned"
    _, work = slam._front.process(
        frame._replace(stamp_ns=frame.stamp_ns + SECOND, image=frame.image[::-1].copy()), None
    )
    assert isinstance(work, GiveUp)
