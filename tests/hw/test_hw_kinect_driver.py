"""The Kinect driver against the emulated camera: its real registers, its real packets."""

import itertools
import queue
import threading
import time

import numpy as np
import pytest
from hw_scripted_transport import ScriptedTransport
from waiting import PATIENCE_S, wait_for

from vsx_hw.errors import DeviceNotFound, ProtocolError
from vsx_hw.kinect import driver as driver_module
from vsx_hw.kinect.driver import KinectCamera
from vsx_hw.kinect.emulator import KinectBoard, KinectEmulator
from vsx_hw.kinect.protocol import (
    CMOS_REGISTER,
    CMOS_WRITE,
    EXPOSURE_MODES,
    MODES,
    STOP,
    SXGA_BAYER,
    VGA_BAYER,
    VGA_UYVY,
    WRITE_REGISTER,
    decode_message,
    decode_reply,
    encode_message,
    encode_reply,
    packetize,
)
from vsx_hw.kinect.socket_transport import SocketTransport

MS = 1_000_000


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (480, 640), np.uint8)


@pytest.fixture
def rig(tmp_path):
    path = str(tmp_path / "kinect")
    images: queue.Queue = queue.Queue()
    with KinectEmulator(path, seed=2) as emulator, KinectCamera(lambda: SocketTransport(path), path, images.put) as cam:
        wait_for(lambda: emulator.streaming)
        yield emulator, cam, images


def test_register_writes_are_byte_exact_with_consecutive_tags():
    expected = ["0C000000", "0D000100", "0E001E00", "05000100", "47000000"]
    writes = [encode_message(WRITE_REGISTER, 7 + k, *register) for k, register in enumerate(VGA_BAYER.start)]
    for k, (write, payload) in enumerate(zip(writes, expected)):
        assert write == bytes.fromhex(f"474D02000300{7 + k:02X}00{payload}")
    assert encode_message(WRITE_REGISTER, 0x1234, *STOP[0]) == bytes.fromhex("474D02000300341205000000")
    assert encode_reply(3, 0x1234, 0) == bytes.fromhex("52420100030034120000")


@pytest.mark.parametrize(
    "reply", ["", "524201000300", "52420100030008000000", "47420100030007000000", "524202000300070000"]
)
def test_foreign_replies_are_refused(reply):
    assert decode_reply(bytes.fromhex("52420100030007000000"), 3, 7) == (0,)
    with pytest.raises(ProtocolError, match="replug"):
        decode_reply(bytes.fromhex(reply), 3, 7)


def test_images_arrive_byte_for_byte_with_the_stamps_of_the_camera(rig):
    emulator, camera, images = rig
    start_ns = time.time_ns()
    for k in range(20):
        assert emulator.send_frame(image(k), start_ns + k * 33_333_333)
    stamps = []
    for k in range(20):
        reading = images.get(timeout=PATIENCE_S)
        np.testing.assert_array_equal(reading.image, image(k))
        stamps.append(reading.stamp_ns - start_ns)
    assert max(abs(stamp - k * 33_333_333) for k, stamp in enumerate(stamps)) < 100
    assert camera.status().counters["frames"] == 20


def test_lost_packets_cost_their_frames_only(rig):
    emulator, camera, images = rig
    emulator.drop_rate = 0.01
    for k in range(40):
        emulator.send_frame(image(k), time.time_ns())
    emulator.drop_rate = 0.0
    emulator.send_frame(image(99), time.time_ns())
    wait_for(lambda: images.qsize() > 0 and np.array_equal(images.queue[-1].image, image(99)))
    counters = camera.status().counters
    assert 10 <= counters["torn_frames"] < 41
    assert all(any(np.array_equal(r.image, image(k)) for k in [*range(40), 99]) for r in list(images.queue)[:5])


def test_unplugged_camera_is_found_again(rig):
    emulator, camera, images = rig
    assert emulator.send_frame(image(2), time.time_ns())
    np.testing.assert_array_equal(images.get(timeout=PATIENCE_S).image, image(2))
    emulator.unplug()
    wait_for(lambda: not emulator.streaming)
    wait_for(lambda: emulator.streaming)
    wait_for(lambda: emulator.send_frame(image(3), time.time_ns()))
    np.testing.assert_array_equal(images.get(timeout=PATIENCE_S).image, image(3))
    assert camera.status().counters["connections"] == 2


def test_a_frozen_camera_is_told_so_and_its_picture_not_delivered(rig):
    emulator, camera, images = rig
    for _ in range(20):
        assert emulator.send_frame(image(1), time.time_ns())
    wait_for(lambda: camera.status().counters["frozen_frames"] == 15)
    assert images.qsize() == 5
    assert not camera.status().connected
    assert "same picture" in camera.status().message
    assert emulator.send_frame(image(2), time.time_ns())
    wait_for(lambda: camera.status().message == "streaming")
    np.testing.assert_array_equal(images.queue[-1].image, image(2))


def test_a_silent_stream_is_started_again(rig, monkeypatch):
    emulator, camera, _ = rig
    monkeypatch.setattr(driver_module, "REVIVE_AFTER_S", 0.3)
    wait_for(lambda: camera.status().counters["revivals"] >= 1)
    wait_for(lambda: emulator.streaming)


def test_nobody_there(tmp_path):
    with pytest.raises(DeviceNotFound, match="start the emulator"):
        SocketTransport(str(tmp_path / "nothing"))


def test_stop_switches_the_stream_off_before_it_cancels():
    log: list[str] = []
    camera = KinectCamera(lambda: ScriptedTransport(log), "scripted", lambda reading: None)
    with camera:
        wait_for(lambda: "47000000" in log)
    assert log[0] == "receive"
    assert log[-3:] == ["05000000", "cancel", "close"]


def test_a_hundred_starts_and_stops_leave_nothing_behind(tmp_path):
    before = threading.active_count()
    for _ in range(100):
        log: list[str] = []
        with KinectCamera(lambda log=log: ScriptedTransport(log), "scripted", lambda reading: None):
            wait_for(lambda log=log: "47000000" in log)
        assert log[-1] == "close"
    assert threading.active_count() == before


def test_the_boards_sequence_runs_on_over_frames():
    board = KinectBoard()
    first, second = board.packets(image(0), 0), board.packets(image(1), 1)
    assert (second[0][5] - first[-1][5]) % 256 == 1
    assert first == packetize(image(0), 0, 0)


def test_the_high_resolution_mode_wakes_the_depth_stream_first():
    addresses = [register.address for register in SXGA_BAYER.start]
    assert addresses == [0x105, 0x05, 0x13, 0x14, 0x06, 0x06, 0x0C, 0x0D, 0x0E, 0x05, 0x47]
    packets = [len(packetize(np.zeros(mode.frame_bytes, np.uint8), 0, 0)) for mode in MODES.values()]
    assert dict(zip(MODES, packets, strict=True)) == {"vga": 162, "uyvy": 323, "sxga": 687}
    assert {register.address: register.value for register in VGA_UYVY.start}[0x0C] == 5


@pytest.mark.parametrize("mode", MODES.values(), ids=MODES)
def test_every_mode_comes_through(tmp_path, mode):
    path = str(tmp_path / "kinect")
    images: queue.Queue = queue.Queue()
    shape = (mode.height_px, mode.width_px) + ((2,) if mode.pixel_bytes == 2 else ())
    sent = np.random.default_rng(5).integers(16, 236, shape, np.uint8)
    if mode.pixel_bytes == 2:
        sent[0, :, 1] = 235
    with KinectEmulator(path) as emulator, KinectCamera(lambda: SocketTransport(path), path, images.put, mode):
        wait_for(lambda: emulator.streaming)
        assert emulator.board.mode == mode
        assert not emulator.send_frame(np.zeros((2, 2), np.uint8), time.time_ns())
        assert emulator.send_frame(sent, time.time_ns())
        reading = images.get(timeout=PATIENCE_S)
    assert reading.image.shape == (mode.height_px, mode.width_px)
    if mode is VGA_UYVY:
        assert reading.encoding == "mono8"
        assert reading.image[0].tolist() == [255] * 640
        expected = np.clip((sent[..., 1].astype(float) - 16) * 255 / 219, 0, 255)
        assert np.abs(reading.image - expected).max() <= 0.5 + 1e-9
    else:
        assert reading.encoding == "bayer_grbg8"
        np.testing.assert_array_equal(reading.image, sent)


def test_exposure_and_white_balance_are_locked_when_the_picture_has_settled(tmp_path, monkeypatch):
    monkeypatch.setattr(driver_module, "LOCK_AFTER_S", 0.2)
    path = str(tmp_path / "kinect")
    with (
        KinectEmulator(path) as emulator,
        KinectCamera(lambda: SocketTransport(path), path, lambda reading: None, lock_exposure=True) as camera,
    ):
        wait_for(lambda: emulator.streaming)
        time.sleep(0.3)
        assert emulator.board.cmos[EXPOSURE_MODES] == 0x708E, "no image yet, nothing has settled"

        def locked():
            emulator.send_frame(image(0), time.time_ns())
            return emulator.board.cmos[EXPOSURE_MODES] == 0x708E & ~0x4002

        wait_for(locked)
        wait_for(lambda: camera.status().counters["exposure_locked"] == 1)


def test_what_one_stream_locked_is_automatic_in_the_next_and_afterwards(tmp_path, monkeypatch):
    monkeypatch.setattr(driver_module, "LOCK_AFTER_S", 0.1)
    monkeypatch.setattr(driver_module, "REVIVE_AFTER_S", 0.5)
    path, pictures = str(tmp_path / "kinect"), (image(k) for k in itertools.count())
    automatic, locked = 0x708E, 0x708E & ~0x4002

    def modes() -> int:
        return emulator.board.cmos[EXPOSURE_MODES]

    def locks() -> bool:
        emulator.send_frame(next(pictures), time.time_ns())
        return camera.status().counters["exposure_locked"] == 1

    with KinectEmulator(path) as emulator:
        with KinectCamera(lambda: SocketTransport(path), path, lambda _: None, lock_exposure=True) as camera:
            wait_for(lambda: emulator.streaming)
            wait_for(locks)
            assert modes() == locked
            wait_for(lambda: camera.status().counters["revivals"] and modes() == automatic)
            assert camera.status().counters["exposure_locked"] == 0
            wait_for(locks)
        assert modes() == automatic, "other programs leave these modes as they are"
        emulator.board.cmos[EXPOSURE_MODES] = locked
        with KinectCamera(lambda: SocketTransport(path), path, lambda _: None) as camera:
            wait_for(lambda: emulator.streaming and modes() == automatic)


def test_a_lock_that_the_sensor_does_not_take_over_is_not_said(tmp_path, monkeypatch):
    monkeypatch.setattr(driver_module, "LOCK_AFTER_S", 0.1)
    path, pictures = str(tmp_path / "kinect"), (image(k) for k in itertools.count())

    class Stubborn(dict):
        def __setitem__(self, address, value):
            tried.append(value)

    tried: list[int] = []
    with KinectEmulator(path) as emulator:
        emulator.board.cmos = Stubborn(emulator.board.cmos)
        with KinectCamera(lambda: SocketTransport(path), path, lambda _: None, lock_exposure=True) as camera:
            wait_for(lambda: (emulator.send_frame(next(pictures), time.time_ns()), tried)[1])
            time.sleep(0.3)
            assert camera.status().counters["exposure_locked"] == 0
            assert camera.status().connected


def test_a_camera_that_refuses_the_lock_is_not_said_to_be_locked(tmp_path, monkeypatch):
    monkeypatch.setattr(driver_module, "LOCK_AFTER_S", 0.1)
    asked: list[tuple[int, ...]] = []

    ask = KinectCamera._ask

    def refuse(camera, transport, command, *words):
        if command == CMOS_REGISTER and words[1] & CMOS_WRITE:
            asked.append(words)
            raise ProtocolError("no such register")
        return ask(camera, transport, command, *words)

    monkeypatch.setattr(KinectCamera, "_ask", refuse)
    path = str(tmp_path / "kinect")
    with (
        KinectEmulator(path) as emulator,
        KinectCamera(lambda: SocketTransport(path), path, lambda reading: None, lock_exposure=True) as camera,
    ):
        wait_for(lambda: emulator.streaming)
        pictures = (image(k) for k in itertools.count())
        wait_for(lambda: (emulator.send_frame(next(pictures), time.time_ns()), asked)[1])
        time.sleep(0.3)
        assert camera.status().counters["exposure_locked"] == 0
        assert camera.status().connected
        assert len(asked) == 1, "it is asked once a stream"


def test_sensor_registers_are_read_and_written():
    read, write = (1, 0x0106, 0), (1, 0x0106 | CMOS_WRITE, 0x308C)
    assert encode_message(CMOS_REGISTER, 9, *read) == bytes.fromhex("474D0300950009000100060100 00")
    assert encode_message(CMOS_REGISTER, 10, *write) == bytes.fromhex("474D030095000A00010006818C30")
    assert decode_message(encode_message(CMOS_REGISTER, 9, *read)) == (0x95, 9, read)
    board = KinectBoard()
    board.control_out(encode_message(CMOS_REGISTER, 1, *write))
    board.control_out(encode_message(CMOS_REGISTER, 2, *read))
    assert decode_reply(board.control_in(), 0x95, 2)[2] == 0x308C


def test_a_fault_in_the_listener_is_not_silent(tmp_path):
    path = str(tmp_path / "kinect")

    def fail(reading) -> None:
        raise ZeroDivisionError("listener")

    with KinectEmulator(path) as emulator, KinectCamera(lambda: SocketTransport(path), path, fail) as camera:
        wait_for(lambda: emulator.send_frame(image(0), time.time_ns()))
        wait_for(lambda: "ZeroDivisionError" in camera.status().message)
        assert not camera.status().connected
        wait_for(lambda: emulator.streaming, "and the camera is tried again")
