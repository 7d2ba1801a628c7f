"""What the node vslam hears: images with the odometry of their instant, and the camera's calibration."""

import time

import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import UInt8

from vsx_hw.readings import Hazard
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import clock, images, topics
from vsx_ros.ros.callbacks import hear_odometry, image_subscriber, subscribe
from vsx_ros.ros.lease import TIMEOUT_S
from vsx_ros.ros.sensor_sync import SensorSync
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.ros.slam_run import SlamRun

_SILENCE_S = 3.0
_CLOCK_BACK_S = 1.0


class SlamInput:
    """``next`` frame on the thread that tracks. What does not come is told to ``status``. Subscribers:
    camera/rgb/image_raw, camera/rgb/camera_info, odom, mobile_base/hazards."""

    def __init__(self, run: SlamRun, status: SlamStatus) -> None:
        self._run, self._session = run, run.session
        self._sync = SensorSync()
        self._odometry: Odometry | None = None
        self._status = status
        self._used_s = time.monotonic()
        self.period_s = 0.0
        hear_odometry(self._on_odometry, first_epoch=run.first_epoch)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)
        image_subscriber(self._on_image)

    def _on_image(self, msg: Image) -> None:
        frame = images.frame(msg)
        clock.refuse_future(frame.stamp_ns)
        self._sync.add_frame(frame)

    def _on_odometry(self, odometry: Odometry) -> None:
        if self._odometry is None and self._session.slam_map is None:
            self._session.ground.start = odometry.T_odom_base  # the map frame begins as the odometry frame
        self._odometry = odometry
        self._run.odometry(odometry)
        self._sync.add_odometry(odometry)

    def _on_hazards(self, msg: UInt8) -> None:
        touches = Hazard(msg.data) & (Hazard.BUMPER | Hazard.CLIFF)
        if touches and self._odometry is not None and (pose := self._session.base_at(self._odometry)) is not None:
            self._session.ground.bumped(pose)

    @property
    def dropped(self) -> int:
        """How many images nobody looked at."""
        return self._sync.dropped

    def camera(self) -> PinholeCamera:
        """The calibration, which comes with the images; until then say what is missing."""
        while True:
            try:
                camera = images.camera(rospy.wait_for_message(topics.CAMERA_INFO, CameraInfo, timeout=_SILENCE_S))
                self._used_s = time.monotonic()
                return camera
            except rospy.ROSInterruptException:
                raise
            except rospy.ROSException:
                self._status.waiting_for(topics.CAMERA_INFO)

    def next(self) -> tuple[Frame, Odometry | None] | None:
        """The newest image and its odometry; None when there is none for now."""
        taken = self._sync.take(timeout_s=0.2)
        if taken is not None:
            return taken
        silent_s = time.monotonic() - self._used_s
        if self._sync.behind_s > _CLOCK_BACK_S:
            self._status.clock_set_back(self._sync.behind_s)
        elif silent_s > _SILENCE_S:
            self._status.waiting_for(topics.IMAGE)
        elif silent_s > TIMEOUT_S:
            self._status.without_images()
        return None

    def used(self) -> None:
        """The last frame was tracked; ``period_s``: how long after the one before."""
        now_s = time.monotonic()
        self.period_s, self._used_s = now_s - self._used_s, now_s

    def refused(self, reason: str) -> None:
        """The last frame could not be used, which is as if it had never come."""
        self._status.refused(reason)
        if time.monotonic() - self._used_s > TIMEOUT_S:
            self._status.without_images("no image comes that fits")
