"""What the node vslam hears and does beside its SLAM: images that do not fit, touches, and what it leaves behind."""

import copy
import errno
import threading
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import UInt8

from vsx_hw.readings import Hazard
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.atomic import write_bytes
from vsx_ros.navigation.lease import ImageLease
from vsx_ros.robot import Frame, Odometry, OdometryEpochs
from vsx_ros.ros import callbacks, convert, headers, images, logs, slam_input, slam_run, threads, topics
from vsx_ros.ros.nodes.vslam import VslamNode
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_input import SlamInput
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.ros.slam_run import SlamRun
from vsx_ros.slam.state import TrackingResult, TrackingState

STAMP_NS = 1_700_000_000 * 10**9


class Notes:
    """Takes any call, and remembers those that matter by their name."""

    def __init__(self) -> None:
        self.said: list[tuple[str, Any]] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *words, **_: self.said.append((name, words[0] if words else None))


def bare(kind: type[Any], **parts: Any) -> Any:
    """One of its kind with nothing but these parts."""
    made = kind.__new__(kind)
    made.__dict__.update(parts)
    return made


def test_an_image_of_another_size_is_as_if_it_had_never_come(monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = [(480, 640), (480, 640), (240, 320), (480, 640), (480, 640)]
    waiting = [(Frame(k, np.zeros(shape, np.uint8)), Odometry(k, SE2())) for k, shape in enumerate(shapes)]
    tracked: list[int] = []

    def track(frame: Frame, odometry: Odometry | None) -> SimpleNamespace:
        if frame.image.shape != (480, 640):
            raise InputError("image of 320x240 does not fit")
        tracked.append(frame.stamp_ns)
        return TrackingResult(frame.stamp_ns, TrackingState.GOOD, frozen=frame.stamp_ns == 4)

    monkeypatch.setattr(rospy, "get_param", lambda _, usual: usual)
    monkeypatch.setattr(threads, "is_ending", lambda: not waiting)
    status, lease = Notes(), Notes()
    slam = SimpleNamespace(track=track, tracked_features=None)
    sync = SimpleNamespace(take=lambda timeout_s: waiting.pop(0), dropped=0, was_set_back=False)
    heard = bare(SlamInput, _sync=sync, _status=status, _used_s=1e12, _metric=True, camera=lambda: None)
    heard._lease, heard._clock = ImageLease(), SlamClock()
    node = bare(
        VslamNode, _metric=True, _input=heard, _maps=Notes(), _status=status, _lease=lease, _poses=Notes(),
        _session=SimpleNamespace(begin=lambda *_, **__: slam, track=track, locate=lambda *_: SimpleNamespace(stuck="")),
        _run=Notes(), _preview=Notes(), _clock=SlamClock(),
    )  # fmt: skip
    node._track()
    assert tracked == [0, 1, 3, 4]
    assert len(lease.said) == 3, "nobody drives by an image that could not be used, or is frozen"
    assert [name for name, _ in status.said] == ["frame", "frame", "refused", "frame", "frame"]
    assert "320x240" in status.said[2][1]


@pytest.mark.parametrize(("resumed", "placed"), [(False, None), (False, SE2()), (True, None)])
def test_the_ground_that_is_free_at_the_start_follows_the_odometry_until_the_map(
    resumed: bool, placed: SE2 | None
) -> None:
    """A base that restarts its counting before the map begins it elsewhere."""
    ground, epochs, starts = SimpleNamespace(start="of the map"), OdometryEpochs(), list[Any]()
    session = SimpleNamespace(ground=ground, resumed=resumed, where=SimpleNamespace(T_map_base=None))
    heard = bare(SlamInput, _session=session, _odometry=None, _sync=Notes(), _clock=SlamClock())
    for stamp_s, at in ((1, SE2(3.0, 1.0)), (2, SE2(3.1, 1.0)), (5, SE2()), (6, SE2(0.1, 0.0))):
        heard._on_odometry(epochs.enter(Odometry(stamp_s * 10**9, at)))
        starts.append(ground.start)
        session.where.T_map_base = placed
    assert starts[0] == ("of the map" if resumed else SE2(3.0, 1.0))
    assert starts[1:] == [starts[0], *[SE2() if placed is None and not resumed else starts[0]] * 2]


@pytest.mark.parametrize(
    ("topic", "change", "told"),
    [
        ("image_raw", {}, False),
        ("image_raw", {"P": [1.0] * 12}, False),
        ("image_raw", {"K": [501.0] * 9}, True),
        ("image_raw", {"K": [0.0] * 9}, True),
        ("image_raw", {"D": [0.1]}, True),
        ("image_raw", {"width": 320}, True),
        ("image_rect_color", {"D": [0.1]}, False),
        ("image_rect_color", {"P": [430.0] * 12}, True),
    ],
)
def test_another_calibration_than_the_one_in_use_is_told(
    topic: str, change: dict[str, Any], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may come late from a slow driver, or from a calibration while vslam runs. Rectified images, which a launch
    file may give the topic of raw ones, have that of P."""
    info = CameraInfo(width=640, height=480, distortion_model="plumb_bob", D=[-0.3, 0.1, 0.0, 0.0, 0.0])
    info.K = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
    info.P = [420.0, 0.0, 318.0, 0.0, 0.0, 450.0, 239.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    hears: list[Callable[[CameraInfo], None]] = []
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/cam/{topic}" if name == topics.IMAGE else f"/{name}")
    monkeypatch.setattr(rospy, "wait_for_message", lambda *_, **__: info)
    monkeypatch.setattr(slam_input, "subscribe", lambda _, __, callback, **___: hears.append(callback))
    status, heard = Notes(), threading.Event()
    heard.set()
    made = bare(SlamInput, _status=status, _shutter=None, _shutter_heard=heard)
    made._session = SimpleNamespace(knows_readout=True)
    camera = made.camera()
    assert (camera.fx, any(camera.distortion)) == ((500.0, True) if topic == "image_raw" else (420.0, False))
    later = copy.deepcopy(info)
    for name, value in change.items():
        setattr(later, name, value)
    hears[0](later)
    assert [name for name, _ in status.said] == ["camera_changed"] * told


@pytest.mark.parametrize("metric", [False, True])
def test_odometry_that_is_missing_before_the_map_is_named_while_it_is(metric: bool) -> None:
    """Not for a single image: readings may come late. A map without scale needs none."""
    status, second_ns = Notes(), 10**9
    heard = bare(SlamInput, _sync=SimpleNamespace(dropped=0), _status=status, _used_s=0.0, _metric=metric)
    heard._odometry, heard._lease, heard._clock, heard._odometry_s = None, ImageLease(), SlamClock(), 0.0
    for state, stamp_s, heard_s in (
        (TrackingState.NOT_INITIALISED, 1.0, None), (TrackingState.NOT_INITIALISED, 2.0, 1.9),
        (TrackingState.NOT_INITIALISED, 2.5, 1.9), (TrackingState.NOT_INITIALISED, 5.0, 1.9),
        (TrackingState.NOT_INITIALISED, 6.0, 6.0), (TrackingState.GOOD, 9.0, 6.0),
    ):  # fmt: skip
        heard._odometry = None if heard_s is None else Odometry(round(heard_s * second_ns), SE2())
        heard.used(TrackingResult(round(stamp_s * second_ns), state), "")
    missing = "waiting_for" if metric else "frame"
    assert [name for name, _ in status.said] == [missing, "frame", "frame", missing, "frame", "frame"]


@pytest.mark.parametrize(("period_s", "silence_s"), [(0.1, 0.3), (0.33, 0.7)])
def test_slow_images_are_no_missing_images(period_s: float, silence_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, status = [100.0], Notes()
    monkeypatch.setattr(slam_input.time, "monotonic", lambda: now_s[0])
    sync = SimpleNamespace(take=lambda timeout_s: None, dropped=0, was_set_back=False)
    heard = bare(SlamInput, _sync=sync, _status=status, _used_s=100.0, _metric=False, _lease=ImageLease())
    heard._clock = SlamClock()
    for _ in range(10):
        now_s[0] += period_s
        heard.used(TrackingResult(round(1e9 * now_s[0]), TrackingState.GOOD), "")
    begun_s = now_s[0]
    for now_s[0] in (begun_s + silence_s - 0.02, begun_s + silence_s + 0.02):
        heard.next()
    assert [name for name, _ in status.said] == ["frame"] * 10 + ["without_images"]


def test_a_missing_message_is_the_reason_why_there_is_no_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    monkeypatch.setattr(logs, "due", lambda *_: False)
    told, words = Notes(), []
    status = bare(
        SlamStatus, _diagnostics=Notes(), _state_pub=told, _state=TrackingState.NOT_INITIALISED,
        _reason="waiting for the first image", _ahead="", _stuck="",
    )  # fmt: skip
    for state in (TrackingState.NOT_INITIALISED, TrackingState.GOOD):
        status._state = state
        status.waiting_for(topics.ODOM)
        words.append([message.message for _, message in told.said])
    assert words[0] == ["no message on /odom; 'rostopic info /odom' shows who publishes it"]
    assert words[1] == words[0], "a map that there is does not need it"


@pytest.fixture
def hearing(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A SlamInput without a map and a master at ``now_s``, who hears what is given to ``hears`` by its topic; ``told``
    are its states in words. ROS time stands at STAMP_NS."""
    rig = SimpleNamespace(now_s=100.0, hears={}, told=[])
    monkeypatch.setattr(callbacks, "_refusals", {})
    monkeypatch.setattr(headers, "now_ns", lambda: STAMP_NS)
    monkeypatch.setattr(logs, "due", lambda *_: False)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    monkeypatch.setattr(rospy, "Subscriber", lambda topic, _, take, **__: rig.hears.update({topic: take}))
    monkeypatch.setattr(slam_input.time, "monotonic", lambda: rig.now_s)
    status = bare(
        SlamStatus, _diagnostics=Notes(), _stats=defaultdict(Notes), _fps=0.0, _ahead="", _stuck="", _reason="",
        _state_pub=SimpleNamespace(publish=lambda msg: rig.told.append(msg.message)),
        _state=TrackingState.NOT_INITIALISED,
    )  # fmt: skip
    session = Notes()
    session.__dict__.update(exposed=lambda frame: frame, resumed=True)
    rig.input = SlamInput(SimpleNamespace(session=session, first_epoch=0), status, SlamClock(), metric=True)
    return rig


@pytest.mark.parametrize(
    ("ages_s", "encoding", "words"),
    [
        ([0.0] * 9, "mono8", "images come, but none with a newer stamp"),
        ([-9.0] * 9, "mono8", "a stamp 9.0 s ahead"),
        ([0.0] * 9, "mono7", "encoding"),
        ([], "mono8", "no message on /camera/rgb/image_raw"),
    ],
)
def test_why_images_that_come_cannot_be_used_is_the_state(
    ages_s: list[float], encoding: str, words: str, hearing: SimpleNamespace
) -> None:
    hearing.input._metric = False
    for k in range(9):
        hearing.now_s += 0.5
        for age_s in ages_s[k : k + 1]:
            stamp_ns = STAMP_NS - round(age_s * 1e9)
            msg = images.image_msg(stamp_ns, np.zeros((16, 16), np.uint8), "mono8", topics.OPTICAL_FRAME)
            msg.encoding = encoding
            hearing.hears[topics.IMAGE](msg)
        if (taken := hearing.input.next()) is not None:
            hearing.input.used(TrackingResult(taken[0].stamp_ns, TrackingState.NOT_INITIALISED), "")
    assert words in hearing.told[-1]
    assert any("no message" in said for said in hearing.told) == (not ages_s)


def test_an_image_that_does_not_fit_is_the_state(hearing: SimpleNamespace) -> None:
    for _ in range(5):
        hearing.now_s += 1.0
        hearing.input.next()
        hearing.input.refused("image of 320x240 does not fit")
    assert hearing.told == ["no image comes", "/camera/rgb/image_raw: image of 320x240 does not fit"]


@pytest.mark.parametrize(
    ("age_s", "period_s", "words"),
    [
        (-9.0, 0.1, "/odom: a stamp 9.0 s ahead"),
        (3.0, 0.1, "/odom: stamps are 3 s behind those of the images"),
        (3.0, 1.0, "no message on /odom"),
        (0.1, 0.1, "drive on"),
    ],
)
def test_why_odometry_that_comes_cannot_be_used_is_the_state(
    age_s: float, period_s: float, words: str, hearing: SimpleNamespace
) -> None:
    moved = Odometry(STAMP_NS - round(age_s * 1e9), SE2())
    hearing.hears[topics.ODOM](convert.odometry_msg(moved, topics.ODOM_FRAME, topics.BASE_FRAME))
    hearing.now_s += period_s
    hearing.input.used(TrackingResult(STAMP_NS, TrackingState.NOT_INITIALISED, reason="drive on"), "")
    assert len(hearing.told) == 1
    assert words in hearing.told[0]


@pytest.mark.parametrize(
    ("hazard", "met"),
    [
        (Hazard.BUMPER_LEFT, True),
        (Hazard.BUMPER_CENTER, True),
        (Hazard.CLIFF_LEFT, True),
        (Hazard.CLIFF_CENTER | Hazard.CLIFF_RIGHT, True),
        (Hazard.NONE, False),
        (Hazard.WHEEL_DROP_LEFT, False),
        (Hazard.WHEEL_DROP, False),
        (Hazard.CLIFF | Hazard.BUMPER_LEFT | Hazard.WHEEL_DROP_LEFT, False),  # it is lifted
    ],
)
def test_bumpers_and_cliffs_meet_something_and_a_raised_wheel_nothing(hazard: Hazard, met: bool) -> None:
    ground = Notes()
    session = SimpleNamespace(base_at=lambda odometry: odometry.T_odom_base, bumped=ground.bumped, lifted=lambda: None)
    heard = bare(SlamInput, _session=session, _odometry=None, _hazards=Hazard.NONE)
    heard._on_hazards(UInt8(hazard))
    assert ground.said == [], "nobody knows where"
    heard._odometry = Odometry(7, SE2(3.0, 0.5, 0.2))
    heard._on_hazards(UInt8(hazard))
    assert ground.said == [("bumped", SE2(3.0, 0.5, 0.2))] * met


def test_the_session_is_told_that_the_base_is_lifted_and_put_down() -> None:
    session, told = Notes(), list[int]()
    heard = bare(SlamInput, _session=session, _odometry=None, _hazards=Hazard.NONE)
    for hazard in (Hazard.WHEEL_DROP_LEFT, Hazard.WHEEL_DROP, Hazard.WHEEL_DROP_LEFT, Hazard.NONE, Hazard.NONE):
        heard._on_hazards(UInt8(hazard))
        told.append(len(session.said))
    assert told == [0, 1, 2, 2, 2]


@pytest.mark.parametrize(
    "trouble", [OSError(errno.ENOSPC, "full", "summary.json"), InputError("no"), ZeroDivisionError()]
)
def test_results_that_cannot_be_written_cost_neither_the_checkpoint_nor_the_map(
    trouble: Exception, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    saved: list[str] = []
    monkeypatch.setattr(slam_run, "save_slam_map", lambda _, path: saved.append(str(path)))
    monkeypatch.setattr(rospy, "logerr", lambda form, *values: saved.append("told"))

    def finish(*_: Any) -> None:
        raise trouble

    run = bare(
        SlamRun, _save_map="end.vsxmap", _folder=SimpleNamespace(path=Path("run")), map_file=Path("run/map.yaml"),
        _keeper=SimpleNamespace(
            finish=finish, write_seen=lambda: None, write=lambda ground: saved.append(f"bumps {ground['bumps']}"),
            record=SimpleNamespace(frames=[]),
        ),
    )  # fmt: skip
    slam = SimpleNamespace(close=lambda: saved.append("slam ended"), slam_map=lambda: "a map")
    maps = SimpleNamespace(
        close=lambda: (saved.append("maps ended"), None), driven={"bumps": 1},
        write_beside=lambda _, path: saved.append(f"beside {path}"),
    )  # fmt: skip
    bare(VslamNode, _lease=Notes(), _tracking=Notes(), _maps=maps, _slam=slam, _run=run).close()
    kept = ["slam ended", "maps ended", "bumps 1", "beside run/map.yaml", "end.vsxmap", "beside end.vsxmap"]
    assert [entry for entry in saved if entry != "told"] == kept
    assert ("told" in saved) != ("failed" in caplog.text), "one sentence, but for a mistake in here"


def test_two_who_save_the_map_at_once_save_it_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Both write the same temporary file: the second found it gone, or the first one's map was half the other's."""
    map_bytes, saved = [bytes([k]) * 2**24 for k in (1, 2)], list[bytes]()
    monkeypatch.setattr(rospy, "get_param", lambda _, default: default)
    monkeypatch.setattr(slam_run, "save_slam_map", lambda content, path: write_bytes(path, content))
    run = bare(SlamRun, _saving=threading.Lock(), _save_map_to=tmp_path / "map.vsxmap")

    def save(content: bytes) -> None:
        run.save_map(SimpleNamespace(slam_map=lambda: content), lambda _, path: saved.append(path.read_bytes()))

    callers = [threading.Thread(target=save, args=(content,)) for content in map_bytes]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert sorted(saved) == map_bytes
