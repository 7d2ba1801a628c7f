"""Node ``vslam``: computes pose, sparse map and ground map from images and odometry.

Subscribers: camera/rgb/{image_raw,camera_info,shutter}, odom, mobile_base/{hazards,docked,odometry_factors}.
Publishers: vslam/pose (base_footprint in map, stamp of the image), /tf map -> odom, /tf_static (camera, gyro),
    vslam/state, vslam/stats/*, follower/lease; vslam/preview/compressed (while someone looks); map, map_metadata,
    vslam/{map_points,keyframes,keyframe_places,path}, zones, zones/markers, rooms, rooms/markers, dock/pose (latched);
    vslam/planes, vslam/dense_points, scan (while someone listens).
Services: static_map; zones/change (AddDiagnostics: JSON {"add": zone}, {"remove": name} or {"clear": true});
    rooms/name (AddDiagnostics: JSON {"room": name or number, "name": new name});
    vslam/save_map (Trigger: saves the SLAM map, the answer is its path).
Parameters: ~config (tree of 'vsx config'), ~seed (int, 0), ~run_dir (folder for the results of the run; auto: the one
    of the launch file; if it holds the map of an interrupted run, that run is resumed; none),
    ~use_odometry (bool, true: wait for odom, the map is metric; false: the map has no scale and no floor),
    ~load_map (SLAM map to continue, the robot anywhere in it; none; not read if ~run_dir is resumed),
    ~room (explore only this room of ~load_map; none),
    ~zones (YAML with zones to begin with, in the coordinates of the map; none; not read if ~run_dir is resumed),
    ~save_map (file for the map at the end; none),
    ~save_map_to (file for the service; default map.vsxmap in ~run_dir, else in the folder for temporary files),
    ~publish_tf (bool, true; false: another node, e.g. an EKF, publishes odom in map)."""

import time

import rospy

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.kernels.warmup import warm_up
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import node, threads, topics
from vsx_ros.ros.callbacks import offer_trigger
from vsx_ros.ros.driving import Lease
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_input import SlamInput
from vsx_ros.ros.slam_maps import SlamMaps
from vsx_ros.ros.slam_messages import PosePublisher, Preview, SlamStatus
from vsx_ros.ros.slam_run import SlamRun
from vsx_ros.slam.slam import ThreadedSlam

_WRITE_PERIOD_S = 1.0  # between checks for a noted map (runs.checkpoint_s)


class VslamNode:
    """Tracks on one thread, beside the mapping and writing threads; callbacks only pass data."""

    def __init__(self, config: Config) -> None:
        warm_up("mapping", "tracking", "loops", "ground")
        self._metric = bool(rospy.get_param("~use_odometry", True))
        self._run = SlamRun(config)
        self._session = self._run.session
        self._slam: ThreadedSlam | None = None
        self._status, self._preview = SlamStatus(), Preview()
        self._clock = SlamClock()
        self._maps = SlamMaps(config, self._session, self._status, self._clock, self._run.continued, self._run.map_file)
        self._lease = Lease(topics.FOLLOWER_LEASE, "vslam")
        self._poses = PosePublisher(self._session, config.robot.mount)
        self._input = SlamInput(self._run, self._status, self._clock, metric=self._metric)
        threads.every(_WRITE_PERIOD_S, "checkpoint", lambda: self._run.write(self._maps.driven))
        offer_trigger(topics.SAVE_MAP, lambda: self._run.save_map(self._slam, self._maps.write_beside))
        self._tracking = threads.worker("tracking", self._track)

    def _track(self) -> None:
        camera, seed = self._input.camera(), int(rospy.get_param("~seed", 0))
        self._slam = slam = self._session.begin(ThreadedSlam, camera, seed, metric=self._metric)
        self._maps.begin(slam, camera, seed, metric=self._metric)
        while not threads.is_ending():
            if (taken := self._input.next()) is not None:
                self._track_frame(slam, *taken)

    def _track_frame(self, slam: ThreadedSlam, frame: Frame, odometry: Odometry | None) -> None:
        began_s = time.monotonic()
        try:
            result = self._session.track(frame, odometry)
        except InputError as error:
            self._input.refused(str(error))
            return
        if not (result.frozen or self._input.waits_for_odometry(result)):
            self._lease.renew()
        self._poses.publish(self._clock.left(result), odometry)
        where = self._session.locate(result, odometry)
        self._input.used(result, where.stuck)
        self._run.frame(slam, result, odometry, time.monotonic() - began_s)
        self._run.see(frame, self._maps.grid)
        self._preview.show(self._clock.left(frame), slam.tracked_features)

    def close(self) -> None:
        """Let nothing drive by this camera any more; after the last frame, write the run's results."""
        self._lease.release()
        threads.join(self._tracking, 1.0)
        if self._slam is not None:
            self._slam.close()
        surface, grid = self._maps.close()
        if self._slam is not None:
            self._run.end(self._slam, self._maps.driven, surface, grid, self._maps.write_beside)


def main() -> None:
    """Entry point of scripts/vslam."""
    node.run("vslam", VslamNode)
