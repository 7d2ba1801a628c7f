"""Node ``vslam``: camera and wheels to pose, sparse map and ground map.

Subscribers: camera/rgb/image_raw, camera/rgb/camera_info, odom, mobile_base/hazards.
Publishers: vslam/pose (base_footprint in map, stamp of the image), /tf map -> odom, /tf_static (camera, gyro),
    vslam/state, vslam/stats/*, follower/lease; vslam/preview/compressed (while someone looks); map, map_metadata,
    vslam/{map_points,keyframes,path} (latched); vslam/planes, vslam/dense_points, scan (while someone listens).
Services: static_map; vslam/save_map (Trigger: saves the SLAM map, the answer says where).
Parameters: ~config (tree of 'vsx config'), ~seed (int, 0), ~run_dir (folder for the results of the run, gone
    on with when it holds the map of an interrupted one; none),
    ~use_odometry (bool, true: wait for odom, the map is metric; false: the map has no scale and no floor),
    ~load_map (SLAM map to go on in, the robot anywhere in it; none; not read where ~run_dir is gone on with),
    ~save_map (file to save it to at the end; none),
    ~save_map_to (file the service saves to; default map.vsxmap in ~run_dir, else in the folder for temporary files),
    ~publish_tf (bool, true; false: somebody else, an EKF, says where odom is in map).
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import UInt8
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
from tf2_msgs.msg import TFMessage

from vsx_hw.readings import Hazard
from vsx_ros.config import Config
from vsx_ros.control.stuck import StuckWatch
from vsx_ros.dense.densify import UPDATE_EVERY_S
from vsx_ros.errors import InputError, MapFileError
from vsx_ros.geometry.camera import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.slam_map_file import load_slam_map, save_slam_map
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import clock, convert, images, logs, node, threads, topics
from vsx_ros.ros.dense_mapping import DenseMapping
from vsx_ros.ros.ground_mapping import GroundMapping, touch_pose
from vsx_ros.ros.lease import TIMEOUT_S, Lease
from vsx_ros.ros.picture_watch import PictureWatch
from vsx_ros.ros.preview import Preview
from vsx_ros.ros.run_keeper import RunKeeper
from vsx_ros.ros.sensor_sync import SensorSync
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.ros.subscribers import image_subscriber, odometry_subscriber, subscribe
from vsx_ros.ros.warm_up import warm_up_slam
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import snapshot as snapshot_of
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.slam.threads import ThreadedSlam
from vsx_ros.slam.tracking_record import TrackingRecord

_MAP_PERIOD_S = 1.0
_TF_PERIOD_S = 0.05
_TF_TOLERANCE_NS = 100_000_000
_SILENCE_S = 3.0
_CLOCK_BACK_S = 1.0
# What tracking of this quality achieves against a metric map; the SLAM states no covariance of its own.
_SIGMA = {TrackingState.GOOD: (0.02, 0.01), TrackingState.DUBIOUS: (0.06, 0.03)}
_DISTRUST = 10.0


class VslamNode:
    """Tracks on one thread, maps the ground on another, densifies and writes beside both; callbacks only hand over."""

    def __init__(self, config: Config) -> None:
        mount = config.robot.mount
        warm_up_slam(config)
        self._config = config
        self._T_base_cam = mounted(mount)
        self._run_dir = str(rospy.get_param("~run_dir", ""))
        self._metric = bool(rospy.get_param("~use_odometry", True))
        self._save_map = str(rospy.get_param("~save_map", ""))  # the master may be gone before the end
        self._sync = SensorSync()
        self._keeper = RunKeeper(Path(self._run_dir), self._T_base_cam) if self._run_dir else None
        before = self._keeper.before if self._keeper is not None else None
        load_map = str(rospy.get_param("~load_map", ""))
        self._loaded = before.slam_map if before is not None else load_slam_map(Path(load_map)) if load_map else None
        self._counted = None if before is None else TrackingRecord.restored(before.state)
        self._slam: ThreadedSlam | None = None
        self._T_map_odom = SE2()
        self._odometry: Odometry | None = None
        self._ground, self._watch = GroundMapping(config), StuckWatch()
        self._dense = DenseMapping(config)
        if before is not None:
            self._ground.restore(before.state)
        elif self._loaded is not None:
            first = self._loaded.view.keyframes[0].T_world_cam
            self._ground.started(SE2.from_se3(first @ self._T_base_cam.inverse()))
        self._driven = self._ground.state()
        self._recognised = self._loaded is None
        self._status = SlamStatus()
        self._preview = Preview()
        self._lease = Lease(topics.FOLLOWER_LEASE, "vslam")
        self._pose_pub = rospy.Publisher(topics.POSE, PoseWithCovarianceStamped, queue_size=5, tcp_nodelay=True)
        if rospy.get_param("~publish_tf", True):
            self._tf_pub = rospy.Publisher(topics.TF, TFMessage, queue_size=20)
            threads.every(_TF_PERIOD_S, "tf", self._publish_tf)
        self._tf_static_pub = rospy.Publisher(topics.TF_STATIC, TFMessage, queue_size=1, latch=True)
        self._tf_static_pub.publish(convert.mount_transforms(mount, clock.now_ns()))
        odometry_subscriber(self._on_odometry)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)
        image_subscriber(self._on_image)
        self._mapping = threads.every(_MAP_PERIOD_S, "ground map", self._map)
        threads.every(UPDATE_EVERY_S, "dense map", self._densify)
        threads.every(_MAP_PERIOD_S, "checkpoint", self._keep)
        rospy.Service(topics.SAVE_MAP, Trigger, self._on_save_map)
        self._tracking = threads.worker("tracking", self._track)

    def _on_odometry(self, msg: OdometryMsg) -> None:
        odometry = convert.odometry(msg)
        clock.refuse_future(odometry.stamp_ns)
        if self._odometry is None and self._loaded is None:
            self._ground.started(odometry.T_odom_base)
        if self._odometry is not None and not odometry.counts_on_from(self._odometry):
            self._recognised = False
        self._odometry = odometry
        if self._keeper is not None:
            self._keeper.odometry(odometry)
        self._sync.add_odometry(odometry)

    def _on_hazards(self, msg: UInt8) -> None:
        T_map_base = touch_pose(Hazard(msg.data), self._T_map_odom if self._recognised else None, self._odometry)
        if T_map_base is not None:
            self._ground.bumped(T_map_base)

    def _on_image(self, msg: Image) -> None:
        frame = images.frame(msg)
        clock.refuse_future(frame.stamp_ns)
        self._sync.add_frame(frame)

    def _on_save_map(self, _: TriggerRequest) -> TriggerResponse:
        slam_map = self._slam.slam_map() if self._slam is not None else None
        if slam_map is None:
            return TriggerResponse(False, "there is no map yet: it starts with the first straight drive")
        default = Path(self._run_dir or tempfile.gettempdir()) / "map.vsxmap"
        path = Path(str(rospy.get_param("~save_map_to", "")) or default)
        try:
            save_slam_map(slam_map, path)
        except MapFileError as error:
            return TriggerResponse(False, str(error))
        return TriggerResponse(True, str(path))

    def _track(self) -> None:
        camera = images.camera(self._first_camera_info())
        seed = int(rospy.get_param("~seed", 0))
        T_base_cam = self._T_base_cam if self._metric else None
        self._dense.start(camera, T_base_cam, seed)
        self._slam = slam = ThreadedSlam(camera, T_base_cam, self._config.slam, seed, self._loaded, self._counted)
        heard_s, tracked_any = time.monotonic(), False
        pictures = PictureWatch()
        while not threads.is_ending():
            taken = self._sync.take(timeout_s=0.2)
            now_s = time.monotonic()
            if taken is None:
                if self._sync.behind_s > _CLOCK_BACK_S:
                    self._status.clock_set_back(self._sync.behind_s)
                elif now_s - heard_s > _SILENCE_S:
                    self._status.waiting_for(topics.IMAGE)
                elif now_s - heard_s > TIMEOUT_S:
                    self._status.without_images()
                continue
            frame, odometry = taken
            if self._metric and odometry is None and not tracked_any:
                self._status.waiting_for(topics.ODOM)  # a map begun without the wheels would have no scale for good
                continue
            result = self._tracked(slam, frame, odometry)
            if result is None:
                if now_s - heard_s > TIMEOUT_S:
                    self._status.without_images("no image comes that fits")
                continue
            tracked_any = True
            if pictures.is_new(frame.image, odometry):  # who drives by an old picture drives blind
                self._lease.renew()
            self._publish_pose(result, odometry)
            self._status.frame(result, now_s - heard_s, self._sync.dropped)
            self._remember(slam, result, odometry, time.monotonic() - now_s)
            if self._preview.is_due:
                self._preview.show(frame, slam.sight())
            heard_s = now_s

    def _tracked(self, slam: ThreadedSlam, frame: Frame, odometry: Odometry | None) -> TrackingResult | None:
        """The pose of a frame; None for one that does not fit, which is as if it had never come."""
        try:
            return slam.track(frame, odometry)
        except InputError as error:
            self._status.refused(str(error))
            return None

    def _remember(self, slam: ThreadedSlam, result: TrackingResult, odometry: Odometry | None, track_s: float) -> None:
        events = slam.drain_events()
        if self._keeper is not None:
            self._keeper.frame(result, odometry, track_s, slam.statistics().u2_frames, events)
            self._keeper.note(slam, result.stamp_ns)

    def _first_camera_info(self) -> CameraInfo:
        """The calibration comes with the images; until then say what is missing."""
        while True:
            try:
                return rospy.wait_for_message(topics.CAMERA_INFO, CameraInfo, timeout=_SILENCE_S)
            except rospy.ROSInterruptException:
                raise
            except rospy.ROSException:
                self._status.waiting_for(topics.CAMERA_INFO)

    def _publish_pose(self, result: TrackingResult, odometry: Odometry | None) -> None:
        if result.T_world_cam is None or result.state not in _SIGMA:
            return
        T_map_base = SE2.from_se3(result.T_world_cam @ self._T_base_cam.inverse())
        sigma_m, sigma_rad = _SIGMA[result.state]
        if result.found == 0 and odometry is not None and not odometry.trusted:  # by wheels that nobody vouches for
            sigma_m, sigma_rad = _DISTRUST * sigma_m, _DISTRUST * sigma_rad
        self._pose_pub.publish(
            convert.pose_with_covariance(topics.MAP_FRAME, result.stamp_ns, T_map_base, sigma_m, sigma_rad)
        )
        if odometry is not None:
            self._watch.add(odometry.T_odom_base, T_map_base)
        stuck = self._watch.stuck
        if stuck is None:
            self._ground.moved(T_map_base, result.stamp_ns)
        else:
            self._ground.pushed(stuck.T_world_push, result.stamp_ns)
        if odometry is not None:
            self._T_map_odom = (T_map_base @ odometry.T_odom_base.inverse()).wrapped()
            self._recognised = True

    def _publish_tf(self) -> None:
        stamp_ns = clock.now_ns() + _TF_TOLERANCE_NS
        self._tf_pub.publish(
            [convert.transform_stamped(topics.MAP_FRAME, topics.ODOM_FRAME, stamp_ns, self._T_map_odom)]
        )

    def _map(self) -> None:
        slam = self._slam
        snapshot = slam.snapshot() if slam is not None else snapshot_of(Map().view())
        self._ground.refresh(snapshot, self._dense.spots)
        if self._ground.grid is not None:
            self._dense.publish(snapshot, self._ground.grid, self._ground.pose)
        self._status.map(snapshot if slam is not None else None)
        self._driven = self._ground.state()

    def _keep(self) -> None:
        if self._keeper is not None:
            self._keeper.write(self._driven)

    def _densify(self) -> None:
        if self._slam is not None:
            self._dense.refresh(self._slam.snapshot())

    def close(self) -> None:
        """Nobody drives by this camera any longer; write the run's results after the last frame. One that cannot be
        written keeps no other from it."""
        self._lease.release()
        threads.join(self._tracking, 1.0)
        self._dense.close()
        if self._slam is not None:
            self._slam.close()
            for last in (self._note_driven, self._write_results, self._keep, self._write_map):
                logs.attempt(last)

    def _note_driven(self) -> None:
        """What was driven and bumped after the last map, too."""
        if threads.join(self._mapping, 2.0):
            self._driven = self._ground.state()

    def _write_results(self) -> None:
        if self._keeper is not None and self._slam is not None:
            grid = self._ground.grid if self._metric else None
            self._keeper.finish(self._slam, self._dense.points(self._slam.snapshot()), grid)

    def _write_map(self) -> None:
        slam_map = self._slam.slam_map() if self._slam is not None else None
        if self._save_map and slam_map is not None:
            save_slam_map(slam_map, Path(self._save_map))


def main() -> None:
    """Entry point of scripts/vslam."""
    node.run("vslam", VslamNode)
