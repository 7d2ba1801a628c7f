"""Time per frame: compared with cv2.ORB, with a large map compared with a small one, and live beside the mapper."""

import threading
import time
from pathlib import Path

import cv2
import numpy as np
from slam_accuracy import SLAM, TRACKED, Row, note
from slam_drives import tour_drive
from slam_recordings import DATA, NAMES

from vsx_ros.arrays import GrayImage
from vsx_ros.io.bag import open_recording
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros.slam_input import SensorSync
from vsx_ros.slam.slam import SequentialSlam, ThreadedSlam
from vsx_ros.slam.state import TrackingResult

LIVE_S, LIVE_HZ = 60.0, 30.0
COMPARED, SMALL_MAP = 150, 100
ORB_EVERY = 3


def timed(slam: SequentialSlam, frame: Frame, odometry: Odometry | None) -> tuple[TrackingResult, float]:
    """The result of a frame and this thread's processor time [ms]. The image was just written, as by a driver."""
    frame = frame._replace(image=frame.image.copy())
    begun = time.thread_time()
    result = slam.track(frame, odometry)
    return result, 1e3 * (time.thread_time() - begun)


def timed_orb(orb: cv2.ORB, image: GrayImage) -> float:
    """This thread's processor time of the peer for an image [ms]."""
    begun = time.thread_time()
    orb.detectAndCompute(image, None)
    return 1e3 * (time.thread_time() - begun)


def is_plain(result: TrackingResult) -> bool:
    """Whether a frame was tracked and is no keyframe, whose cost is the mapper's."""
    return result.state in TRACKED and not result.keyframe_added


def pictures(seeds: range, keep: Path | None) -> list[Row]:
    """Real and rendered recordings without odometry: time per frame of ours and ORB."""
    rows = []
    for name in NAMES:
        recording, orb = open_recording(DATA / name), cv2.ORB_create(1000)
        slam = SequentialSlam(recording.camera, None, SLAM, 1)
        tracking_ms, orb_ms, searched = [], [], []
        for frame in recording.frames():
            result, ms = timed(slam, frame, None)
            orb_ms.append(timed_orb(orb, frame.image))
            if is_plain(result):
                tracking_ms.append(ms)
                searched.append(result.searched)
        told = f"{name}, {np.median(searched):.0f} points searched: tracking / ORB"
        rows.append(Row(told, "", 0.65, 0.55, [float(np.median(tracking_ms) / np.median(orb_ms))]))
    return rows


def timing(seeds: range, keep: Path | None) -> list[Row]:
    """One tour through an office; time per frame of ours and ORB, and at its end of a SLAM that started late."""
    drive, orb = tour_drive(seeds[0], keep), cv2.ORB_create(1000)
    whole, late = (SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1) for _ in range(2))
    tracking_ms, orb_ms, large_ms, small_ms = [], [], [], []
    for k in range(len(drive)):
        result, ms = timed(whole, drive.frame(k), drive.odometry_at(k))
        plain = is_plain(result)
        if plain:
            tracking_ms.append(ms)
        if k % ORB_EVERY == 0:
            orb_ms.append(timed_orb(orb, drive.images[k]))
        if k >= len(drive) - COMPARED - SMALL_MAP:
            other, other_ms = timed(late, drive.frame(k), drive.odometry_at(k))
            if k >= len(drive) - COMPARED and plain and is_plain(other):
                large_ms.append(ms)
                small_ms.append(other_ms)
        if k % 200 == 0:
            note(f"timing: frame {k} of {len(drive)}, {whole.statistics().keyframes} keyframes")
    counts = [slam.statistics().keyframes for slam in (whole, late)]
    ratios = [float(np.median(tracking_ms) / np.median(orb_ms)), float(np.median(large_ms) / np.median(small_ms))]
    return [
        Row("tracking a frame, processor time, median", "ms", None, None, [float(np.median(tracking_ms))]),
        Row("tracking a frame / cv2.ORB of 1000 features", "", 0.8, 0.45, [ratios[0]]),
        Row(f"frame with {counts[0]} keyframes / with {counts[1]}", "", 1.2, 1.0, [ratios[1]]),
    ]


def live(seeds: range, keep: Path | None) -> list[Row]:
    """Frames come at a fixed rate, only the newest is used, as in the vslam node; the mapper has its own thread."""
    drive, sync = tour_drive(seeds[0], keep), SensorSync()
    slam = ThreadedSlam(drive.camera, drive.T_base_cam, SLAM, 1)
    n = min(len(drive), round(LIVE_S * LIVE_HZ))
    offered, stopped = np.zeros(n), threading.Event()

    def feed() -> None:
        begun = time.perf_counter()
        for k in range(n):
            time.sleep(max(0.0, begun + k / LIVE_HZ - time.perf_counter()))
            odometry = drive.odometry_at(k)
            stamp_ns, faster = round(k * 1e9 / LIVE_HZ), LIVE_HZ / (1e9 / (drive.stamps_ns[1] - drive.stamps_ns[0]))
            offered[k] = time.perf_counter()
            sync.add_odometry(Odometry(stamp_ns, odometry.T_odom_base, faster * odometry.v, faster * odometry.omega))
            sync.add_frame(Frame(stamp_ns, drive.images[k]))
        stopped.set()

    feeder = threading.Thread(target=feed)
    feeder.start()
    track_ms, own_ms, age_ms, lost = [], [], [], 0
    while not stopped.is_set():
        taken = sync.take(timeout_s=0.1)
        if taken is None:
            continue
        begun, own = time.perf_counter(), time.thread_time()
        result = slam.track(*taken)
        done = time.perf_counter()
        track_ms.append(1e3 * (done - begun))
        own_ms.append(1e3 * (time.thread_time() - own))
        age_ms.append(1e3 * (done - offered[round(taken[0].stamp_ns * 1e-9 * LIVE_HZ)]))
        lost += result.state.value == "lost"
    feeder.join()
    slam.close()
    slowest = int(np.argmax(track_ms))
    note(
        f"live: {len(track_ms)} of {n} frames, {slam.statistics().keyframes} keyframes, "
        f"{track_ms[slowest]:.0f} ms at most, in frame {slowest}"
    )
    p99 = [float(np.percentile(values, 99)) for values in (track_ms, age_ms)]
    return [
        Row(
            f"live at {LIVE_HZ:.0f} Hz for {n / LIVE_HZ:.0f} s: track, median",
            "ms",
            None,
            None,
            [float(np.median(track_ms))],
        ),
        Row("live: track, 99th percentile", "ms", 33.0, None, [p99[0]]),
        Row("live: track, processor time, at most", "ms", 33.0, None, [max(own_ms)]),
        Row("live: from hand-over to pose, 99th percentile", "ms", None, None, [p99[1]]),
        Row("live: frames dropped", "", 0.0, None, [float(sync.dropped)]),
        Row("live: frames lost", "", None, None, [float(lost)]),
    ]
