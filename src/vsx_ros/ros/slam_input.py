"""Inputs of the node vslam: images with the odometry at their time, and the camera's calibration."""

import math
import threading
import time
from collections import deque
from dataclasses import replace

import rospy
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64MultiArray, UInt8

from vsx_hw.readings import Hazard
from vsx_ros.errors import CalibrationError
from vsx_ros.geometry.camera import PinholeCamera, Shutter
from vsx_ros.navigation.lease import ImageLease
from vsx_ros.robot import SILENCE_NS, Frame, Odometry, odometry_at
from vsx_ros.ros import headers, images, topics
from vsx_ros.ros.callbacks import hear_odometry, image_subscriber, refusal, remember_refusal, subscribe
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.ros.slam_run import SlamRun
from vsx_ros.slam.state import TrackingResult, TrackingState

_SILENCE_S = 3.0  # without images: reported
_ODOMETRY_COMES_S = 0.5  # since a reading; then it is not silent, whatever its stamp
_SHUTTER_WAIT_S = 1.0  # cameras with other drivers do not publish it
_CLOCK_BACK_S = 1.0  # a clock that was set back, or a recording that started again
_BELIEVED = 3  # so many images in a row, and the clock was set back
_KEEP_ODOMETRY = 300  # readings: 6 s at 50 Hz
_NO_NEWER = "images come, but none with a newer stamp; see to the camera's own driver"
# Odometry comes 30 to 50 times a second: a reading after the image arrives within this time, or not at all.
_WAIT_FOR_ODOMETRY_S = 0.06


class SlamInput:
    """The tracking thread calls ``next``. Missing inputs are reported to ``status``. Subscribers: camera/rgb/image_raw,
    camera/rgb/camera_info, camera/rgb/shutter, odom, mobile_base/hazards."""

    def __init__(self, run: SlamRun, status: SlamStatus, clock: SlamClock, *, metric: bool) -> None:
        """clock: what is taken from here is in its time. metric: whether a new map waits for odometry."""
        self._session, self._clock, self._metric = run.session, clock, metric
        self._sync, self._frames = SensorSync(clock), images.Frames()
        self._odometry: Odometry | None = None
        self._odometry_s = -math.inf  # when it came
        self._hazards = Hazard.NONE
        self._status = status
        self._lease, self._used_s = ImageLease(), time.monotonic()
        hear_odometry(self._on_odometry, first_epoch=run.first_epoch)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)
        self._shutter: Shutter | None = None
        self._shutter_heard = threading.Event()
        subscribe(topics.SHUTTER, Float64MultiArray, self._on_shutter, queue_size=1)
        image_subscriber(self._on_image)

    def _on_image(self, msg: Image) -> None:
        frame = self._session.exposed(self._frames.of(msg))
        headers.refuse_future(frame.stamp_ns)
        self._sync.add_frame(frame)

    def _on_odometry(self, reading: Odometry) -> None:
        odometry = self._clock.entered(reading)
        before, self._odometry, self._odometry_s = self._odometry, odometry, time.monotonic()
        session, begins = self._session, before is None or before.odom_epoch != odometry.odom_epoch
        if begins and not session.resumed and session.where.T_map_base is None:
            session.ground.start = odometry.T_odom_base  # the map frame starts equal to the odometry frame
        self._sync.add_odometry(odometry)

    def _on_hazards(self, msg: UInt8) -> None:
        before, self._hazards = self._hazards, Hazard(msg.data)
        hazards = self._hazards
        if Hazard.WHEEL_DROP in (hazards & Hazard.WHEEL_DROP, before & Hazard.WHEEL_DROP):
            self._session.lifted()
        touches = hazards & (Hazard.BUMPER | Hazard.CLIFF) and not hazards & Hazard.WHEEL_DROP  # else it is lifted
        if touches and self._odometry is not None:
            self._session.bumped(self._session.base_at(self._odometry))

    def _on_shutter(self, msg: Float64MultiArray) -> None:
        self._shutter = images.shutter(msg)
        self._shutter_heard.set()

    def _on_info(self, msg: CameraInfo) -> None:
        try:
            changed = images.our_camera(msg) != self._camera
        except CalibrationError:
            changed = True
        if changed:
            self._status.camera_changed()

    def camera(self) -> PinholeCamera:
        """Wait for the calibration, which comes with the images; meanwhile report what is missing."""
        while True:
            try:
                info = rospy.wait_for_message(topics.CAMERA_INFO, CameraInfo, timeout=_SILENCE_S)
                self._camera = images.our_camera(info)
                subscribe(topics.CAMERA_INFO, CameraInfo, self._on_info, queue_size=1)
                self._used_s = time.monotonic()
                self._shutter_heard.wait(_SHUTTER_WAIT_S)
                if self._shutter is None and not self._session.knows_readout:
                    rospy.logwarn("the camera's shutter is not known: its rows are taken to be exposed at once")
                return replace(self._camera, shutter=self._shutter)
            except rospy.ROSInterruptException:
                raise
            except rospy.ROSException:
                self._status.waiting_for(topics.CAMERA_INFO)

    def next(self) -> tuple[Frame, Odometry | None] | None:
        """The newest image and its odometry; None if there is no new image now."""
        taken = self._sync.take(timeout_s=0.2)
        if taken is not None:
            return taken
        silent_s = time.monotonic() - self._used_s
        if self._sync.was_set_back:
            rospy.logwarn("the clock was set back by %.1f s; the map goes on", self._sync.behind_s)
        elif silent_s > _SILENCE_S:
            self._status.waiting_for(topics.IMAGE, refusal(topics.IMAGE, self._used_s))
        elif silent_s > self._lease.length_s:
            self._status.without_images(refusal(topics.IMAGE, self._used_s))
        return None

    def used(self, result: TrackingResult, stuck: str) -> None:
        """Report that the last frame was tracked, and, in words, that the base is stuck."""
        before_s, self._used_s = self._used_s, time.monotonic()
        self._lease.see(round(1e9 * self._used_s), 0.0)
        if self.waits_for_odometry(result):
            self._status.waiting_for(topics.ODOM, refusal(topics.ODOM) or self._odometry_behind(result))
        else:
            self._status.frame(self._clock.left(result), self._used_s - before_s, self._sync.dropped, stuck)

    def waits_for_odometry(self, result: TrackingResult) -> bool:
        """Whether there is no map at this frame because odometry is silent."""
        if not self._metric or result.state is not TrackingState.NOT_INITIALISED:
            return False
        return self._odometry is None or result.stamp_ns - self._odometry.stamp_ns > SILENCE_NS

    def _odometry_behind(self, result: TrackingResult) -> str:
        """That odometry comes with stamps older than that of a frame; empty if none comes."""
        if self._odometry is None or time.monotonic() - self._odometry_s > _ODOMETRY_COMES_S:
            return ""
        name, behind_s = rospy.resolve_name(topics.ODOM), (result.stamp_ns - self._odometry.stamp_ns) * 1e-9
        return f"{name}: stamps are {behind_s:.0f} s behind those of the images; 'vsx doctor' compares the clocks"

    def refused(self, reason: str) -> None:
        """Report that the last frame was unusable; it counts as missing."""
        remember_refusal(topics.IMAGE, reason)
        self._status.refused(reason)
        if time.monotonic() - self._used_s > self._lease.length_s:
            self._status.without_images(refusal(topics.IMAGE))


class SensorSync:
    """Two callbacks write, one thread reads. Images that are replaced before they are read are dropped and counted.
    ``behind_s``: how much older the last image was than the one read before it; it was then dropped; else 0.
    ``was_set_back``: whether the clock was found set back by it."""

    def __init__(self, clock: SlamClock) -> None:
        """clock: turned on when several images in a row are much older. Odometry comes in its time, images do not."""
        self._clock = clock
        self._changed = threading.Condition()
        self._odometry: deque[Odometry] = deque(maxlen=_KEEP_ODOMETRY)
        self._frame: Frame | None = None
        self._last_taken_ns, self._taken_s = -1, 0.0
        self._much_older = 0
        self.dropped = 0
        self.behind_s, self.was_set_back = 0.0, False

    def add_odometry(self, odometry: Odometry) -> None:
        """Store a reading; readings out of order are ignored, but not those after the clock was set back."""
        with self._changed:
            if self._odometry and odometry.stamp_ns < self._odometry[-1].stamp_ns - _CLOCK_BACK_S * 1e9:
                self._odometry.clear()
            if not self._odometry or odometry.stamp_ns > self._odometry[-1].stamp_ns:
                self._odometry.append(odometry)
                self._changed.notify_all()

    def add_frame(self, frame: Frame) -> None:
        """Offer an image; it replaces one that was not read yet."""
        with self._changed:
            if self._frame is not None:
                self.dropped += 1
            self._frame = frame
            self._changed.notify_all()

    def take(self, timeout_s: float) -> tuple[Frame, Odometry | None] | None:
        """The newest image and the odometry at its stamp (see ``odometry_at``). None if no newer image came in time."""
        with self._changed:
            self.was_set_back = False
            if not self._changed.wait_for(lambda: self._frame is not None, timeout_s) or self._frame is None:
                return None
            frame, self._frame = self._clock.entered(self._frame), None
            if not self._is_newer(frame.stamp_ns):
                remember_refusal(topics.IMAGE, _NO_NEWER)
                self.dropped += 1
                return None
            self._last_taken_ns, self._taken_s = frame.stamp_ns, time.monotonic()
            if self._odometry:
                self._changed.wait_for(lambda: self._odometry[-1].stamp_ns >= frame.stamp_ns, _WAIT_FOR_ODOMETRY_S)
            return frame, odometry_at(self._odometry, frame.stamp_ns)

    def _is_newer(self, stamp_ns: int) -> bool:
        """Whether an image comes after the one read last; turns the clock on if it and others before are much older."""
        behind_ns = self._last_taken_ns - stamp_ns
        self.behind_s = max(0.0, behind_ns * 1e-9)
        self._much_older = self._much_older + 1 if self.behind_s > _CLOCK_BACK_S else 0
        if self._much_older == _BELIEVED:
            self._clock.set_back(behind_ns + round(1e9 * (time.monotonic() - self._taken_s)))
            self._much_older, self.was_set_back = 0, True
        return behind_ns < 0
