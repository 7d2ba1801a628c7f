"""Kernel cameras by what is theirs, in an emulated sysfs: the number of /dev/videoN moves."""

import fcntl
import os
import queue
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from waiting import PATIENCE_S, wait_for

from vsx_hw import v4l
from vsx_hw.errors import DeviceNotFound
from vsx_hw.v4l import V4lCamera, V4lMode
from vsx_hw.video_names import gives_images, video_name, video_number


def plugged(root: Path, number: int, port: str, serial: str | None, function: int = 0, index: int = 0) -> None:
    """A webcam, as sysfs shows one."""
    usb = root / "sys/devices/pci0000:00/usb1" / port
    interface = usb / f"{port}:1.{function}"
    entry = interface / f"video4linux/video{number}"
    entry.mkdir(parents=True)
    files = {usb / "idVendor": "046d", usb / "idProduct": "0825", entry / "name": "UVC Camera", entry / "index": index}
    files |= {interface / "bInterfaceNumber": f"{function:02x}"} | ({} if serial is None else {usb / "serial": serial})
    for file, text in files.items():
        file.write_text(f"{text}\n", encoding="utf-8")
    (entry / "device").symlink_to(os.path.relpath(interface, entry))
    links = root / "sys/class/video4linux"
    links.mkdir(parents=True, exist_ok=True)
    (links / f"video{number}").symlink_to(os.path.relpath(entry, links))


def test_a_camera_keeps_its_name_whatever_its_number_and_port(tmp_path):
    plugged(tmp_path / "one", 0, "1-1", "A1B2")
    plugged(tmp_path / "two", 2, "1-4.3", "A1B2")
    plugged(tmp_path / "two", 0, "1-1", "C3D4")
    assert video_name(0, tmp_path / "one") == video_name(2, tmp_path / "two") == "046d_0825_A1B2"
    assert video_name(0, tmp_path / "two") == "046d_0825_C3D4"


@pytest.mark.parametrize("serial", [None, "", "00000000"])
def test_cameras_without_a_serial_number_are_told_apart_by_their_ports(serial, tmp_path):
    plugged(tmp_path, 0, "1-1", serial)
    plugged(tmp_path, 2, "1-4.3", serial)
    assert [video_name(n, tmp_path) for n in (0, 2)] == ["046d_0825_usb-1-port1", "046d_0825_usb-1-port4.3"]


def test_two_streams_of_one_camera_have_names_of_their_own(tmp_path):
    plugged(tmp_path, 0, "1-1", "A1/B 2")
    plugged(tmp_path / "more", 2, "1-1", "A1/B 2", function=3)
    plugged(tmp_path / "metadata", 1, "1-1", "A1/B 2", index=1)
    names = [video_name(0, tmp_path), video_name(2, tmp_path / "more"), video_name(1, tmp_path / "metadata")]
    assert names == ["046d_0825_A1_B_2", "046d_0825_A1_B_2_3.0", "046d_0825_A1_B_2_0.1"]


def test_a_camera_that_is_not_on_the_usb_has_the_kernel_s_names(tmp_path):
    sensor, entry = tmp_path / "sys/devices/platform/fe801000.csi", tmp_path / "sys/class/video4linux/video0"
    sensor.mkdir(parents=True)
    entry.mkdir(parents=True)
    (entry / "name").write_text("unicam\n", encoding="utf-8")
    assert video_name(0, tmp_path) == "unicam"
    (entry / "device").symlink_to(sensor)
    assert video_name(0, tmp_path) == "unicam_fe801000.csi"
    assert video_name(7, tmp_path) == "video7", "no sysfs"


WEBCAM, CODEC, DEVICE_CAPS, STREAMING = 0x84A00001, 0x04008000, 0x80000000, 0x04000000


@pytest.mark.parametrize(
    ("whole", "own", "camera"),
    [
        (WEBCAM, STREAMING | 0x1, True),  # uvcvideo
        (WEBCAM, STREAMING | 0xA00000, False),  # its metadata
        (DEVICE_CAPS | CODEC, CODEC, False),
        (DEVICE_CAPS | 0x1000, STREAMING | 0x1000, True),  # planes
        (STREAMING | 0x1, 0, True),  # before Linux 3.4
        (0x2, 0, False),  # an output
    ],
)
def test_a_device_without_images_is_told_from_a_camera(whole, own, camera, tmp_path, monkeypatch):
    def answer(handle, request, room):
        assert (os.readlink(f"/proc/self/fd/{handle}"), request, len(room)) == (str(device), 0x80685600, 104)
        words = (0x60000, whole, own, 0, 0, 0)
        return bytes(80) + b"".join(word.to_bytes(4, sys.byteorder) for word in words)

    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(fcntl, "ioctl", answer)
    assert gives_images(device) is camera


def test_what_does_not_answer_may_be_a_camera(tmp_path):
    (tmp_path / "video0").touch()
    assert gives_images(tmp_path / "video0")
    assert gives_images(tmp_path / "video1"), "absent, or not to be opened: the driver says why"


def test_a_link_leads_to_the_number(tmp_path):
    link = tmp_path / "usb-046d_0825_A1B2-video-index0"
    with pytest.raises(DeviceNotFound, match=r"leads to no /dev/videoN; check the cable"):
        video_number(str(link))
    link.symlink_to("/dev/video42")
    assert video_number(str(link)) == video_number("/dev/video42") == 42


class Webcam:
    """A capture device that gives one image of noise, then fails."""

    noise = np.random.default_rng(0)

    def __init__(self) -> None:
        self.images = [self.noise.integers(0, 256, (48, 64)).astype(np.uint8)]

    def get(self, name):
        return 0.0

    def set(self, name, value):
        return name != cv2.CAP_PROP_AUTO_EXPOSURE

    def grab(self):
        return bool(self.images)

    def retrieve(self):
        return True, self.images.pop()

    def release(self) -> None:
        pass


def test_another_camera_that_takes_the_number_is_refused(tmp_path, monkeypatch):
    """SLAM would go on with the first one's calibration."""
    monkeypatch.setattr(v4l, "BACKOFF_S", (0.01,))
    images: queue.Queue = queue.Queue()
    plugged(tmp_path / "sys1", 3, "1-1", "A1B2")
    plugged(tmp_path / "sys2", 3, "1-1", "C3D4")
    root = tmp_path / "root"
    root.symlink_to("sys1")

    def opened(number):
        return Webcam()

    with V4lCamera(3, images.put, opened, mode=V4lMode(64, 48), root=root) as camera:
        images.get(timeout=PATIENCE_S)
        assert camera.serial == camera.status().device == "046d_0825_A1B2"
        (tmp_path / "new").symlink_to("sys2")
        (tmp_path / "new").replace(root)
        wait_for(lambda: "/dev/video3 is 046d_0825_C3D4 now; plug 046d_0825_A1B2 in" in camera.status().message)
        (tmp_path / "new").symlink_to("sys1")
        (tmp_path / "new").replace(root)
        while not images.empty():
            images.get()
        images.get(timeout=PATIENCE_S)


def test_a_link_is_followed_to_the_camera_s_new_number(tmp_path, monkeypatch):
    monkeypatch.setattr(v4l, "BACKOFF_S", (0.01,))
    images, numbers, link = queue.Queue(), queue.Queue(), tmp_path / "by-id"
    plugged(tmp_path, 3, "1-1", "A1B2")
    plugged(tmp_path / "later", 5, "1-1", "A1B2")
    (tmp_path / "sys/class/video4linux/video5").symlink_to(tmp_path / "later/sys/class/video4linux/video5")
    link.symlink_to("/dev/video3")

    def opened(number):
        numbers.put(number)
        (tmp_path / "new").symlink_to("/dev/video5")
        (tmp_path / "new").replace(link)
        return Webcam()

    with V4lCamera(str(link), images.put, opened, mode=V4lMode(64, 48), root=tmp_path) as camera:
        assert [numbers.get(timeout=PATIENCE_S) for _ in range(2)] == [3, 5]
        images.get(timeout=PATIENCE_S)
        assert camera.serial == "046d_0825_A1B2"
