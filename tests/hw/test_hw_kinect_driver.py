"""The Kinect driver against the emulated camera: its real registers, its real packets."""

import queue
import threading
import time

import numpy as np
import pytest

from vsx_hw.errors import DeviceNotFound, ProtocolError
from vsx_hw.kinect import driver as driver_module
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectBoard, KinectEmulator
from vsx_hw.kinect.packets import packetize
from vsx_hw.kinect.protocol import START_VGA_BAYER, STOP, check_write_reply, encode_write, encode_write_reply
from vsx_hw.kinect.socket_transport import SocketTransport

MS = 1_000_000


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (480, 640), np.uint8)


def until(condition, timeout_s=5.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


@pytest.fixture
def rig(tmp_path):
    path = str(tmp_path / "kinect")
    images: queue.Queue = queue.Queue()
    with KinectEmulator(path, seed=2) as emulator, KinectCamera(lambda: SocketTransport(path), path, images.put) as cam:
        assert until(lambda: emulator.streaming)
        yield emulator, cam, images


def test_register_writes_are_byte_exact_with_consecutive_tags():
    expected = ["0C000000", "0D000100", "0E001E00", "05000100", "47000000"]
    writes = [encode_write(register, 7 + k) for k, register in enumerate(START_VGA_BAYER)]
    for k, (write, payload) in enumerate(zip(writes, expected)):
        assert write == bytes.fromhex(f"474D02000300{7 + k:02X}00{payload}")
    assert encode_write(STOP[0], 0x1234) == bytes.fromhex("474D02000300341205000000")
    assert encode_write_reply(0x1234) == bytes.fromhex("52420100030034120000")


@pytest.mark.parametrize(
    "reply", ["", "524201000300", "52420100030008000000", "47420100030007000000", "524202000300070000"]
)
def test_foreign_replies_are_refused(reply):
    check_write_reply(bytes.fromhex("52420100030007000000"), STOP[0], 7)
    with pytest.raises(ProtocolError, match="replug"):
        check_write_reply(bytes.fromhex(reply), STOP[0], 7)


def test_images_arrive_byte_for_byte_with_the_stamps_of_the_camera(rig):
    emulator, camera, images = rig
    start_ns = time.time_ns()
    for k in range(20):
        assert emulator.send_frame(image(k), start_ns + k * 33_333_333)
    stamps = []
    for k in range(20):
        reading = images.get(timeout=5.0)
        np.testing.assert_array_equal(reading.image, image(k))
        stamps.append(reading.stamp_ns - start_ns)
    assert max(abs(stamp - k * 33_333_333) for k, stamp in enumerate(stamps)) < 100
    assert camera.status().counters["frames"] == 20


def test_lost_packets_cost_their_frames_only(rig):
    emulator, camera, images = rig
    emulator.faults.drop_rate = 0.01
    for k in range(40):
        emulator.send_frame(image(k), time.time_ns())
    emulator.faults.drop_rate = 0.0
    emulator.send_frame(image(99), time.time_ns())
    assert until(lambda: images.qsize() > 0 and np.array_equal(images.queue[-1].image, image(99)))
    counters = camera.status().counters
    assert 10 <= counters["torn_frames"] < 41
    assert all(any(np.array_equal(r.image, image(k)) for k in [*range(40), 99]) for r in list(images.queue)[:5])


def test_unplugged_camera_is_found_again(rig):
    emulator, camera, images = rig
    emulator.unplug()
    assert until(lambda: not emulator.streaming)
    assert until(lambda: emulator.streaming)
    assert until(lambda: emulator.send_frame(image(3), time.time_ns()))
    np.testing.assert_array_equal(images.get(timeout=5.0).image, image(3))
    assert camera.status().counters["connections"] == 2


def test_a_silent_stream_is_started_again(rig, monkeypatch):
    emulator, camera, _ = rig
    monkeypatch.setattr(driver_module, "REVIVE_AFTER_S", 0.3)
    assert until(lambda: camera.status().counters["revivals"] >= 1)
    assert until(lambda: emulator.streaming)


def test_nobody_there(tmp_path):
    with pytest.raises(DeviceNotFound, match="start the emulator"):
        SocketTransport(str(tmp_path / "nothing"))


class ScriptedTransport:
    """A camera that answers at once and remembers the order of things."""

    serial = "A1"

    def __init__(self, log: list[str]) -> None:
        self.board = KinectBoard()
        self.log = log
        self.handler = None

    def control_out(self, data: bytes) -> None:
        self.log.append(data[8:].hex())
        self.board.control_out(data)

    def control_in(self, size: int) -> bytes:
        return self.board.control_in()

    def start_iso(self, handler) -> None:
        self.log.append("receive")
        self.handler = handler

    def stop_iso(self) -> None:
        self.log.append("cancel")
        self.handler = None

    def failure(self) -> str:
        return ""

    def close(self) -> None:
        self.log.append("close")


def test_stop_switches_the_stream_off_before_it_cancels():
    log: list[str] = []
    camera = KinectCamera(lambda: ScriptedTransport(log), "scripted", lambda reading: None)
    with camera:
        assert until(lambda: "47000000" in log)
    assert log[0] == "receive"
    assert log[-3:] == ["05000000", "cancel", "close"]


def test_a_hundred_starts_and_stops_leave_nothing_behind(tmp_path):
    before = threading.active_count()
    for _ in range(100):
        log: list[str] = []
        with KinectCamera(lambda log=log: ScriptedTransport(log), "scripted", lambda reading: None):
            assert until(lambda log=log: "47000000" in log)
        assert log[-1] == "close"
    assert threading.active_count() == before


def test_the_boards_sequence_runs_on_over_frames():
    board = KinectBoard()
    first, _ = board.packets(image(0), 0)
    second, _ = board.packets(image(1), 1)
    assert (int(second[0, 5]) - int(first[-1, 5])) % 256 == 1
    np.testing.assert_array_equal(first, packetize(image(0), 0, 0)[0])
