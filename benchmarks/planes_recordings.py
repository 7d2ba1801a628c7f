"""Planes of real pictures: ``PYTHONPATH=src:hw python benchmarks/planes_recordings.py [NAME ...] [--out DIR]``.

Each recording goes through the SLAM and the whole dense stage, as with ``vsx replay --map``, with three seeds. It
prints each plane. For each recording and seed, DIR gets a picture of keyframes with the planes' outlines, their points
as dots, surface cells as crosses, and numbers. A person must judge which plane is right, false or missing. Recordings
are read from $VSX_DATA.
"""

import argparse
import os
import sys
from pathlib import Path

import cv2
import numpy as np

from vsx_ros.config import Config
from vsx_ros.dense.finished_map import FinishedMap
from vsx_ros.dense.planes import Plane
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import MapSnapshot

DATA = Path(os.environ.get("VSX_DATA", Path(__file__).parents[1] / "../shared/data"))
NAMES = ("vamr_tag_corner", "visp_rbt_desk", "new_tsukuba_150", "mononav_hallway/hallway.bag")
CAMERA_HEIGHT_M = 1.04  # of the only recording with odometry
COLOURS = ((60, 60, 255), (60, 255, 60), (255, 100, 60), (0, 220, 220), (255, 60, 255), (255, 255, 0), (0, 128, 255))


def mapped(path: Path) -> tuple[SequentialSlam, PinholeCamera]:
    """The SLAM of a recording at its end, and the camera."""
    recording = open_recording(path)
    camera = recording.camera or read_calibration(path.parent / "camera.json")
    mount = mount_pose(0.0, 0.0, CAMERA_HEIGHT_M, 0.0) if recording.odometry else None
    slam = SequentialSlam(camera, mount, Config().slam, 0)
    for frame in recording.frames():
        slam.track(frame, recording.odometry_at(frame.stamp_ns) if recording.odometry else None)
    return slam, camera


def outline(plane: Plane) -> np.ndarray:
    """(80, 3) points along the edges of the plane's extent."""
    a, b, c, d = plane.extent
    share = np.linspace(0.0, 1.0, 20)[:, None]
    corners = np.array([[a, c], [b, c], [b, d], [a, d], [a, c]])
    return plane.points_at(np.concatenate([p + share * (q - p) for p, q in zip(corners, corners[1:])]))


def drawn(k: int, snapshot: MapSnapshot, camera: PinholeCamera, finished: FinishedMap) -> np.ndarray:
    """A keyframe with the planes on it."""
    picture, T_cam_world = cv2.cvtColor(snapshot.images[k], cv2.COLOR_GRAY2BGR), snapshot.T_world_cams[k].inverse()
    seen = np.zeros(len(snapshot.points_world), bool)
    seen[snapshot.obs_point[snapshot.obs_keyframe == k]] = True

    def pixels(points: np.ndarray) -> np.ndarray:
        ahead = T_cam_world @ points
        return np.nan_to_num(camera.project(ahead[ahead[:, 2] > 0.0])).clip(-9999, 9999).astype(int)

    for number, plane in enumerate(finished.planes or ()):
        colour = COLOURS[number % len(COLOURS)]
        own = pixels(snapshot.points_world[plane.points[seen[plane.points]]])
        cv2.polylines(picture, [pixels(outline(plane)).reshape(-1, 1, 2)], False, colour, 1)
        for uv in own.tolist():
            cv2.circle(picture, uv, 3, colour, -1)
        on_it = np.abs(plane.distances(finished.cloud.points)) < 1e-6
        for uv in pixels(finished.cloud.points[on_it][::4]).tolist():
            cv2.drawMarker(picture, uv, colour, cv2.MARKER_CROSS, 5)
        if len(own):
            middle = np.median(own, axis=0).astype(int).tolist()
            cv2.putText(picture, f"{plane.id} {plane.kind.value}", middle, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2)
    return picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(NAMES))
    parser.add_argument("--out", type=Path, default=Path("."), help="folder for the pictures (default: here)")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.names:
        if not (DATA / name).exists():
            print(f"{DATA / name} is absent (set VSX_DATA): left out", file=sys.stderr)
            continue
        slam, camera = mapped(DATA / name)
        snapshot, slam_map = slam.snapshot(), slam.slam_map()
        for seed in range(3):
            finished = FinishedMap(snapshot, camera, slam_map.T_base_cam if slam_map else None, Config(), seed)
            print(f"{name}, seed {seed}: {len(snapshot.points_world)} points, {finished.note or 'in metres'}")
            for plane in finished.planes or ():
                facts = f"normal {plane.normal.round(3)}, {len(plane.points)} points"
                print(f"  {plane.id} {plane.kind.value}: {facts}")
            count = len(snapshot.images)
            chosen = sorted({0, count // 3, 2 * count // 3, count - 1}) if count else []
            if chosen:
                pictures = [drawn(k, snapshot, camera, finished) for k in chosen]
                cv2.imwrite(str(args.out / f"{Path(name).parts[0]}_{seed}.png"), np.hstack(pictures))


if __name__ == "__main__":
    main()
