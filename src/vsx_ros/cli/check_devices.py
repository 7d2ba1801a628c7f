"""``vsx doctor``: base, camera, permissions and calibration, from the kernel; ``--hw`` also opens the devices."""

import grp
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NamedTuple

from vsx_hw.video_names import FORMER, content, gives_images, video_name
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding, tried

_KINECT_CAMERAS = {"045e:02ae": "Kinect", "045e:02bf": "Kinect for Windows"}
_KINECT_PARTS = {"045e:02b0", "045e:02c2", "045e:02ad", "045e:02be", "045e:02bb", "045e:02c3"}
_GROUPS = {"dialout": "serial ports", "plugdev": "the Kinect", "video": "/dev/videoN"}
_RULE = "sudo cp hw/udev/60-vsx.rules /etc/udev/rules.d/ && sudo udevadm control --reload && sudo udevadm trigger"
_BREAKER = "check its 12 V supply; on a TurtleBot 1 the base switches it: start 'rosrun vsx_ros mobile_base' first"


class UsbDevice(NamedTuple):
    """A device on the USB. node: its file in /dev/bus/usb."""

    ids: str
    serial: str
    node: Path


def usb_devices(root: Path) -> list[UsbDevice]:
    """All USB devices of /sys/bus/usb/devices that have a file in /dev: a container sees the others, too, and was not
    given them. root: root of the file system."""
    devices = []
    for entry in sorted((root / "sys/bus/usb/devices").glob("*")):
        vendor, product, bus, number = (content(entry / n) for n in ("idVendor", "idProduct", "busnum", "devnum"))
        node = root / f"dev/bus/usb/{int(bus or 0):03d}/{int(number or 0):03d}"
        if vendor and product and node.exists():
            devices.append(UsbDevice(f"{vendor}:{product}", content(entry / "serial"), node))
    return devices


def check_devices(root: Path, environment: Mapping[str, str], speak: bool) -> Iterator[Finding]:
    """Findings about the hardware. speak: open the devices and identify them; a missing device is then a failure."""
    ports = sorted({*(root / "dev").glob("ttyUSB*"), *(root / "dev").glob("ttyACM*"), *(root / "dev").glob("kobuki")})
    kinects = [device for device in usb_devices(root) if device.ids in _KINECT_CAMERAS]
    known = sorted(entry.name for entry in (root / "sys/class/video4linux").glob("video[0-9]*"))
    videos = [video for video in known if (root / "dev" / video).exists()]  # as in usb_devices
    if speak:
        videos = [video for video in videos if gives_images(root / "dev" / video)]
    absent = FAIL if speak else NOTE
    yield from _ports(ports, absent)
    yield from _cameras(root, kinects, videos, absent)
    if ports or kinects:
        yield _udev_rule(root)
    if ports or kinects or videos:
        yield from _groups()
    if speak:
        yield from _spoken_to(ports, kinects, videos)
    # As runs.parameters.ros_home, which needs packages that this command may find missing.
    home = Path(environment.get("ROS_HOME") or Path(environment.get("HOME", "/")) / ".ros")
    files = sorted((home / "camera_info").glob("*.yaml"))
    if not files:
        remedy = "vsx calibrate camera --live --board 8x6x0.025 (docs/how-to/calibrate.md); without it the map is bent"
        yield Finding("calibration", WARN, f"{home / 'camera_info'} holds none, nominal values will be used", remedy)
    for file in files:
        if any(file.match(form) for form in FORMER.values()):
            remedy = "'mv' it to the name that its camera's line or node tells, or delete it (docs/hardware.md)"
            yield Finding("calibration", WARN, f"{file} has a name of earlier versions, which is not used", remedy)
        else:
            yield tried("calibration", partial(_calibration, file))
    if (home / "vsx_ros/robot.yaml").exists():
        yield tried("calibration", partial(_robot, home / "vsx_ros/robot.yaml"))


def _ports(ports: list[Path], absent: str) -> Iterator[Finding]:
    if not ports:
        yield Finding(
            "base", absent, "no serial port (/dev/ttyUSB*, /dev/ttyACM*)", "plug the base in and switch it on"
        )
    for port in ports:
        yield _access("base", port, str(port), "sudo usermod -aG dialout $USER, then log in again")


def _access(area: str, device: Path, name: str, remedy: str, closed: str = FAIL) -> Finding:
    if os.access(device, os.R_OK | os.W_OK):
        return Finding(area, OK, f"{name} may be opened")
    return Finding(area, closed, f"{name} may not be opened by this user", remedy)


def _cameras(root: Path, kinects: list[UsbDevice], videos: list[str], absent: str) -> Iterator[Finding]:
    for device in kinects:
        name = f"{_KINECT_CAMERAS[device.ids]} {device.serial}".rstrip()
        yield _access("camera", device.node, f"{name} at {device.node}", _RULE)
    for video in videos:
        number, kind = int(video.removeprefix("video")), content(root / "sys/class/video4linux" / video / "name")
        name = f"/dev/{video}: {kind}, as --camera v4l:{number}, calibrated by rgb_{video_name(number, root)}.yaml,"
        remedy = "sudo usermod -aG video $USER, then log in again"
        yield _access("camera", root / "dev" / video, name, remedy, WARN)  # it may be the laptop's own
    if not kinects and any(device.ids in _KINECT_PARTS for device in usb_devices(root)):
        yield Finding("camera", FAIL, "the Kinect's motor or audio is on the USB, its camera is not", _BREAKER)
    elif not kinects and not videos:
        remedy = f"plug it in, and give it to a container (docs/how-to/install.md); {_BREAKER}"
        yield Finding("camera", absent, "neither a Kinect nor a /dev/videoN", remedy)
    if kinects and (root / "sys/module/gspca_kinect").exists():
        remedy = "sudo cp hw/udev/vsx-kinect.conf /etc/modprobe.d/ && sudo rmmod gspca_kinect"
        yield Finding("camera", WARN, "the kernel's driver gspca_kinect takes the Kinect from libusb", remedy)


def _udev_rule(root: Path) -> Finding:
    rules = [root / "etc/udev/rules.d/60-vsx.rules", root / "usr/lib/udev/rules.d/60-vsx.rules"]
    if any(rule.exists() for rule in rules):
        return Finding("permissions", OK, "the udev rule is installed")
    return Finding("permissions", WARN, "the udev rule is not installed: no /dev/kobuki, 16 ms of delay", _RULE)


def _groups() -> Iterator[Finding]:
    mine = {entry.gr_name for entry in grp.getgrall() if entry.gr_gid in os.getgroups()}
    lacking = [name for name in _GROUPS if name not in mine]
    if lacking and os.geteuid() != 0:
        wanted = ", ".join(f"{name} ({_GROUPS[name]})" for name in lacking)
        remedy = f"sudo usermod -aG {','.join(lacking)} $USER, then log in again"
        yield Finding("permissions", WARN, f"this user is not in the groups {wanted}", remedy)


def _spoken_to(ports: list[Path], kinects: list[UsbDevice], videos: list[str]) -> Iterator[Finding]:
    """Listen to the base and identify it; the wheels do not turn. Open the cameras."""
    from vsx_hw.bases import detect_base
    from vsx_hw.kinect.usb_transport import UsbTransport

    def named(port: Path) -> str:
        return f"{port} is a {detect_base(str(port))}"

    def serial() -> str:
        with closing(UsbTransport()) as transport:
            return f"the Kinect opens, serial number {transport.serial}"

    once = {path.resolve(): path for path in ports}.values()
    yield from _one_is_enough([tried("base", partial(named, port)) for port in once])
    if kinects:
        yield tried("camera", serial)
    looks = [tried("camera", partial(_image, video)) for video in videos]
    yield from _one_is_enough(looks, elsewhere=bool(kinects))


def _one_is_enough(found: list[Finding], *, elsewhere: bool = False) -> list[Finding]:
    """Where one is good, here or elsewhere, the others need not be the robot's: their failures are warnings."""
    if not elsewhere and all(finding.level == FAIL for finding in found):
        return found
    return [finding._replace(level=WARN) if finding.level == FAIL else finding for finding in found]


def _image(video: str) -> Finding:
    """Take an image, as the node camera does; one of another size is for its ~mode."""
    from vsx_hw.errors import DeviceError, OtherSize
    from vsx_hw.v4l import MOST_BAD, V4lMode, grey, open_video

    number, mode, remedy = int(video.removeprefix("video")), V4lMode(), ""
    try:
        capture = open_video(number)
    except OtherSize as other:
        mode = V4lMode(other.width, other.height)
        remedy = f"where it is the robot's: rosparam set /camera/mode {mode.width}x{mode.height} (~mode of the camera)"
        capture = open_video(number, mode)
    try:
        for _ in range(MOST_BAD):
            ok, image = capture.read()
            if ok:
                height, width = grey(image, mode)[0].shape
                level, text = NOTE if remedy else OK, f"/dev/{video} gives images of {width}x{height}"
                return Finding("camera", level, text, remedy)
    finally:
        capture.release()
    raise DeviceError(f"/dev/{video} opens and gives no image; check the cable")


def _calibration(file: Path) -> str:
    from vsx_ros.io.calibration_file import read_calibration

    camera = read_calibration(file)
    return f"{file}: {camera.width}x{camera.height}, {camera.fx:.1f} px"


def _robot(file: Path) -> str:
    """Results of 'vsx calibrate odometry' and 'mount'; without this file, nominal values are used."""
    from vsx_ros.runs.parameters import load

    robot = load(file, []).robot
    mount, wheels = robot.mount, robot.odometry
    scales = f"wheels {wheels.linear_scale:.4f}, {wheels.angular_scale:.4f}"
    camera = f"camera {mount.height_m:.3f} m high, {math.degrees(mount.pitch_down_rad):.1f} deg down"
    return f"{file}: {scales}; {camera}; 'vsx explore' takes it by itself"
