"""Cameras by name, for the node ``camera``: their settings, drivers and calibrations."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Protocol

import rospy

from vsx_hw.errors import DeviceNotFound
from vsx_hw.kinect.driver import KinectCamera, KinectTransport
from vsx_hw.kinect.protocol import MODES
from vsx_hw.kinect.socket_transport import SocketTransport
from vsx_hw.kinect.usb_transport import UsbTransport
from vsx_hw.readings import ImageReading, LinkStatus
from vsx_hw.v4l import V4lCamera, V4lMode
from vsx_hw.video_names import FORMER
from vsx_ros.errors import CalibrationError, ConfigError
from vsx_ros.geometry.camera import KINECT_SHUTTER, PinholeCamera, nominal_camera
from vsx_ros.io.calibration_file import read_calibration, write_calibration
from vsx_ros.registry import Registry
from vsx_ros.ros.environment import path_of_url
from vsx_ros.ros.topic_camera import TopicCamera
from vsx_ros.runs.parameters import ros_home

_MUCH = 0.05  # of the focal length: two calibrations that differ by more are not of one camera


class Camera(Protocol):
    """A driver; it delivers images on its own thread. If it knows its calibration, it also has ``calibration``, and
    ``rectified`` if its images are."""

    serial: str
    """Part of the calibration file's name."""

    def start(self) -> None:
        """Begin connecting; returns at once."""

    def status(self) -> LinkStatus:
        """Health, with the counter ``frames``."""

    def close(self) -> object:
        """Release the device."""


class CameraSettings(NamedTuple):
    """name: the part of ~device after the colon. latency_s: only for a kernel (v4l) camera."""

    name: str
    on_image: Callable[[ImageReading], None]
    mode: str = "vga"
    lock_exposure: bool = False
    latency_s: float = 0.0


def _kinect(device: str, transport: Callable[[], KinectTransport], wanted: CameraSettings) -> Camera:
    if wanted.mode not in MODES:
        raise ConfigError(f"camera ~mode {wanted.mode!r}: give one of {', '.join(MODES)}")
    return KinectCamera(transport, device, wanted.on_image, MODES[wanted.mode], wanted.lock_exposure)


def _on_usb(wanted: CameraSettings) -> Camera:
    def transport() -> KinectTransport:
        """Of the camera of before, although another one may come first on the bus now."""
        if not wanted.name and camera.serial:
            with suppress(DeviceNotFound):
                return UsbTransport(camera.serial)
        return UsbTransport(wanted.name)

    camera = _kinect(f"kinect:{wanted.name}" if wanted.name else "kinect", transport, wanted)
    return camera


def _emulated(wanted: CameraSettings) -> Camera:
    if not wanted.name:
        raise ConfigError("camera emulator: give its socket, emulator:SOCKET")
    return _kinect(f"emulator:{wanted.name}", lambda: SocketTransport(wanted.name), wanted)


def _v4l(wanted: CameraSettings) -> Camera:
    if not wanted.name.isdigit() and not wanted.name.startswith("/dev/"):
        raise ConfigError(f"camera v4l:{wanted.name}: give N of /dev/videoN, e.g. v4l:0, or v4l:/dev/v4l/by-id/...")
    device = int(wanted.name) if wanted.name.isdigit() else wanted.name
    mode = V4lMode() if wanted.mode == "vga" else V4lMode.parse(wanted.mode)
    if mode is None:
        raise ConfigError(f"camera ~mode {wanted.mode!r}: give size, rate and format, e.g. 1280x720@30/mjpeg")
    locked, latency_s = wanted.lock_exposure, wanted.latency_s
    return V4lCamera(device, wanted.on_image, mode=mode, lock_exposure=locked, latency_s=latency_s)


def _nominal_kinect(width: int, height: int) -> PinholeCamera:
    """A Kinect's 4:3 image is the upper part of its 1280 x 1024 image, so the optical centre lies above the middle of
    the latter."""
    return replace(nominal_camera(width, width * 3 // 4), height=height, shutter=KINECT_SHUTTER)


class CameraEntry(NamedTuple):
    """One kind of camera. driver: makes it. nominal: from width and height of its images [px] to what is assumed where
    nothing was measured; the shutter also where only that is missing."""

    driver: Callable[[CameraSettings], Camera]
    nominal: Callable[[int, int], PinholeCamera] = nominal_camera


CAMERAS: Registry[CameraEntry] = Registry(
    "camera",
    {
        "kinect": CameraEntry(_on_usb, _nominal_kinect),
        "emulator": CameraEntry(_emulated, _nominal_kinect),
        "v4l": CameraEntry(_v4l),
        "ros": CameraEntry(lambda wanted: TopicCamera(wanted.name, wanted.on_image)),
    },
    CameraEntry,
)


def open_camera(
    device: str,
    on_image: Callable[[ImageReading], None],
    mode: str = "vga",
    lock_exposure: bool = False,
    latency_s: float = 0.0,
) -> Camera:
    """The driver of a ~device, KIND or KIND:NAME; it connects when started. Raises ConfigError for an invalid
    ~device."""
    kind, _, name = device.partition(":")
    settings = CameraSettings(name, on_image, mode=mode, lock_exposure=lock_exposure, latency_s=latency_s)
    return CAMERAS[kind].driver(settings)


class CameraCalibration:
    """The first that fits the images: the user's file or latest calibration, the stored file, the newest of the camera
    itself; else nominal values with a warning. For rectified images that of the camera itself comes before the stored
    file: only the driver knows how it rectifies. known: whether it was measured."""

    def __init__(self, device: str, url: str) -> None:
        """Raises CalibrationError if the file of ``url`` cannot be used."""
        self._device, self._url = device, url
        self._chosen: PinholeCamera | None = None  # by the user
        self._stored: PinholeCamera | None = None
        self._camera: PinholeCamera | None = None  # the one in use
        self._compared: PinholeCamera | None = None  # of the camera itself, with the stored one
        self._lack = ""  # why there is no stored one, until it is told
        self._refused: list[tuple[PinholeCamera, int, int]] = []  # with the size of the images
        if url and not device.startswith("emulator:"):
            self._chosen = read_calibration(Path(path_of_url(url)))
        self.known = self._looked = self._chosen is not None

    def of(self, source: Camera, width: int, height: int) -> PinholeCamera:
        """The calibration for images of this size from the opened ``source``."""
        refused, camera = list[tuple[PinholeCamera, int, int]](), None
        for measured in self._measured(source):
            if (measured.width, measured.height) == (width, height):
                camera = measured
                break
            refused.append((measured, width, height))
            if refused[-1] not in self._refused:
                size = measured.width, measured.height
                rospy.logwarn("calibration is of %dx%d, images are %dx%d", *size, width, height)
        self._refused, self.known = refused, camera is not None
        if camera is None:
            self._tell_lack()
        elif camera is self._stored:
            self._tell_difference(source, camera)
        assumed = nominal(self._device, width, height)
        camera = camera or assumed
        if camera.shutter is None:
            camera = replace(camera, shutter=assumed.shutter)
        self._camera = camera
        return camera

    def _measured(self, source: Camera) -> Iterator[PinholeCamera]:
        """What was measured, the best first. The stored file is read once."""
        if not self._looked:
            self._stored, self._looked = self._read(source), True
        given: PinholeCamera | None = getattr(source, "calibration", None)
        ranked = [given, self._stored] if getattr(source, "rectified", False) else [self._stored, given]
        return (each for each in (self._chosen, *ranked) if each is not None)

    def store(self, source: Camera, camera: PinholeCamera) -> Path:
        """Store a new calibration where the node reads it. Raises OSError, or CalibrationError while the camera is not
        known, or if the next start would not use it."""
        path = self._file(source)
        if not self._url and getattr(source, "rectified", False) and getattr(source, "calibration", None) is not None:
            raise CalibrationError(
                f"the images of {self._device} are rectified, and its driver says how; calibrate the topic of its raw "
                "images and use that"
            )
        if path.name == "rgb_.yaml" and not source.status().counters["frames"]:
            raise CalibrationError(f"{self._device} was not opened yet, so its serial number is unknown; try again")
        if self._camera is not None:
            camera = replace(camera, shutter=camera.shutter or self._camera.shutter)  # not part of CameraInfo
        path.parent.mkdir(parents=True, exist_ok=True)
        write_calibration(path, camera, path.stem)
        self._chosen = self._camera = camera
        self.known = True
        return path

    def _file(self, source: Camera) -> Path:
        if self._url:
            return Path(path_of_url(self._url))
        if self._device.startswith("emulator:"):
            return Path(self._device.partition(":")[2] + ".yaml")
        return ros_home() / "camera_info" / f"rgb_{source.serial}.yaml"

    def _read(self, source: Camera) -> PinholeCamera | None:
        file = self._file(source)
        try:
            return read_calibration(file)
        except CalibrationError as error:
            self._lack = str(error)
            if file.exists():
                rospy.logwarn("the stored calibration is not used: %s", error)
            else:
                self._tell_former(file)
            return None

    def _tell_lack(self) -> None:
        """Tell once that nothing was stored, when nothing else fits."""
        if self._lack:
            rospy.logwarn("camera is not calibrated: %s. Nominal values are used; expect a bent map", self._lack)
            self._lack = ""

    def _tell_difference(self, source: Camera, stored: PinholeCamera) -> None:
        """Tell of each calibration of the camera itself that is far from the stored one, which is used."""
        given: PinholeCamera | None = getattr(source, "calibration", None)
        if given is None or given == self._compared:
            return
        self._compared = given
        here, there = (camera.parameters()[:4] for camera in (stored, given))
        if (given.width, given.height) == (stored.width, stored.height) and max(abs(here - there)) > _MUCH * stored.fx:
            words = (" ".join(f"{value:.0f}" for value in values) for values in (here, there))
            form = "%s is used (fx fy cx cy: %s px); its driver says %s. If that is right, delete it and start anew"
            rospy.logwarn(form, self._file(source), *words)

    def _tell_former(self, wanted: Path) -> None:
        """Tell of files with names of earlier versions, which may be of other cameras; none is used."""
        form = FORMER.get(self._device.partition(":")[0], "")
        for found in sorted(wanted.parent.glob(form)) if form else ():
            remedy = f"if it is of this camera, 'mv {found} {wanted}' and start anew"
            rospy.logwarn("%s is not used, as it has a name of earlier versions; %s", found.name, remedy)


def nominal(device: str, width: int, height: int) -> PinholeCamera:
    """Assumed calibration of an uncalibrated camera. Raises ConfigError for an unknown kind of camera."""
    return CAMERAS[device.partition(":")[0]].nominal(width, height)
