"""SLAM maps on disk: everything comes back bit for bit, and whatever is not such a map is one sentence."""

import dataclasses
import io
import json
import tracemalloc

import cv2
import numpy as np
import pytest

from vsx_ros.errors import MapFileError
from vsx_ros.geometry.camera import PinholeCamera, kernel_camera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.sealed_archive import array_bytes, seal, unseal
from vsx_ros.io.slam_map_arrays import LAYOUT, arrays_of
from vsx_ros.io.slam_map_file import _check_pictures, image_name, load_slam_map, save_slam_map, suffix_of
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.vision.corners import CornerDetector, no_corners
from vsx_ros.vision.patch_search import moving
from vsx_ros.vision.pyramid import CompressedPyramid, build_pyramid, picture_file, small_image

CAMERA = PinholeCamera(160, 120, 130.1, 131.7, 80.3, 59.9, (0.1, -0.2, 0.001, -0.002, 1 / 3))
T_BASE_CAM = SE3.exp(np.array([0.1, 0.0, 0.3, -1.2, 1.2, -1.2]))


@pytest.fixture(scope="module")
def slam_map():
    """Five keyframes, one culled, one compressed, one without odometry, one of a second map, in two chains."""
    rng, detector, world = np.random.default_rng(3), CornerDetector(), Map()
    for k in range(5):
        pyramid = build_pyramid(cv2.GaussianBlur(rng.integers(0, 256, (120, 160), np.uint8), (0, 0), 1.5))
        wheels = None if k == 2 else SE2(0.1 * k, 0.2, -0.3 * k)
        camera = moving(kernel_camera(CAMERA), rng.normal(0.0, 0.01, 6))
        data = FrameData(7 * k + 10**18, pyramid, detector.detect(pyramid), small_image(pyramid), wheels, camera)
        world.odom_segment = k // 3
        world.add_keyframe(data, SE3.exp(rng.normal(0.0, 0.3, 6)), Observations.none(), map_id=int(k == 4))
        templates = NewTemplates(
            rng.normal(size=(30, 4)), rng.random((30, 2)), rng.integers(0, 256, (30, PATCH, PATCH))
        )
        world.add_points(rng.normal(size=(30, 3)), templates, k)
    for k in range(5):
        uv = rng.uniform(0.0, 119.0, (150, 2))
        world.observe(k, Observations(np.arange(150), uv, uv + 0.1, rng.integers(0, 4, 150)))
    world.remove_points(np.array([3, 77]))
    world.cull_keyframe(1)
    holder = world.keyframes[1].anchor.keyframe
    world.resize_keyframe(holder, world.keyframes[holder].T_world_cam, 1.05)
    world.compress_keyframe(3)
    world.version = 42
    return SlamMap(CAMERA, T_BASE_CAM, world.view())


@pytest.fixture
def saved(slam_map, tmp_path):
    save_slam_map(slam_map, tmp_path / "lab.vsxmap")
    return tmp_path / "lab.vsxmap"


def test_everything_comes_back_bit_for_bit(slam_map, saved):
    back = load_slam_map(saved)
    assert back.camera == CAMERA
    assert back.T_base_cam.matrix().tobytes() == T_BASE_CAM.matrix().tobytes()
    assert (back.view.version, back.view.living.tolist()) == (42, [0, 2, 3, 4])
    assert [k.alive for k in back.view.keyframes] == [True, False, True, True, True]
    for ours, theirs in zip(slam_map.view.keyframes, back.view.keyframes, strict=True):
        assert (ours.id, ours.odom_segment, ours.map_id) == (theirs.id, theirs.odom_segment, theirs.map_id)
        assert (ours.median_depth, ours.scale) == (theirs.median_depth, theirs.scale)
        assert (ours.data.stamp_ns, ours.data.T_odom_base) == (theirs.data.stamp_ns, theirs.data.T_odom_base)
        assert all(np.array_equal(a, b) for a, b in zip(ours.data.pyramid, theirs.data.pyramid, strict=True))
        assert ours.data.corners.counts == theirs.data.corners.counts
        assert np.array_equal(ours.data.corners.positions, theirs.data.corners.positions)
        assert np.array_equal(ours.data.corners.row_table, theirs.data.corners.row_table)
        assert ours.data.small.tobytes() == theirs.data.small.tobytes()
        assert all(np.array_equal(a, b) for a, b in zip(ours.observations, theirs.observations, strict=True))
    ours, theirs = arrays_of(slam_map.view), arrays_of(back.view)
    assert {name: array.tobytes() for name, array in ours.items()} == {n: a.tobytes() for n, a in theirs.items()}


def test_what_was_seen_from_a_keyframe_before_and_after_it_was_scaled_comes_back(slam_map, saved):
    keyframes, back = slam_map.view.keyframes, load_slam_map(saved).view.keyframes
    culled = keyframes[1].anchor
    assert back[1].anchor.pose(back).matrix() == pytest.approx(culled.pose(keyframes).matrix(), abs=1e-12)
    for scale in (1.0, keyframes[culled.keyframe].scale):
        frame = Anchor(culled.keyframe, SE3(np.eye(3), [0.3, 0.0, 0.0]), scale)
        assert frame.pose(back).matrix().tobytes() == frame.pose(keyframes).matrix().tobytes()


def test_a_file_from_before_scales_were_kept_is_read(saved):
    entries = unseal(saved.read_bytes())
    del entries["arrays/scale.npy"]
    saved.write_bytes(seal(entries))
    assert {keyframe.scale for keyframe in load_slam_map(saved).view.keyframes} == {1.0}


def test_a_file_of_the_second_version_is_read(slam_map, saved):
    """Its rows and levels were wider, and zeros stood for the pixels of culled keyframes."""
    culled, entries = 1, unseal(saved.read_bytes())
    entries["manifest.json"] = json.dumps({**json.loads(entries["manifest.json"]), "version": 2}).encode()
    counts = [len(keyframe.observations.rows) for keyframe in slam_map.view.keyframes]
    for name in ("row", "level"):
        column = np.load(io.BytesIO(entries[f"arrays/observation_{name}.npy"]))
        entries[f"arrays/observation_{name}.npy"] = array_bytes(column.astype(np.int64))
    for name in ("uv", "ideal"):
        pixels = np.load(io.BytesIO(entries[f"arrays/observation_{name}.npy"]))
        padded = np.insert(pixels, [sum(counts[:culled])] * counts[culled], 0.0, axis=0)
        entries[f"arrays/observation_{name}.npy"] = array_bytes(padded)
    whole = saved.read_bytes()
    saved.write_bytes(seal(entries))
    back = load_slam_map(saved)
    save_slam_map(back, saved)
    assert saved.read_bytes() == whole
    kinds = {array.dtype for keyframe in back.view.keyframes for array in keyframe.observations}
    assert kinds == {np.dtype(np.int64), np.dtype(np.float64)}


def test_a_map_with_ten_thousand_culled_keyframes_comes_back(slam_map, tmp_path):
    rng, view, count = np.random.default_rng(5), slam_map.view, 10_000
    keyframes, levels = list(view.keyframes), rng.integers(0, 4, 150)
    for k in range(len(keyframes), len(keyframes) + count):
        rows = np.flatnonzero(rng.random(150) < 0.9)
        seen = Observations(rows, np.zeros((0, 2)), np.zeros((0, 2)), levels[rows])
        keyframes.append(dataclasses.replace(view.keyframes[1], id=k, observations=seen))
    R, t = (np.concatenate([a, np.repeat(a[1:2], count, axis=0)]) for a in (view.R_world_cam, view.centres))
    view = view._replace(keyframes=tuple(keyframes), R_world_cam=R, centres=t, depths=np.ones(len(keyframes)))
    save_slam_map(dataclasses.replace(slam_map, view=view), tmp_path / "long.vsxmap")
    back = load_slam_map(tmp_path / "long.vsxmap").view
    assert len(back.keyframes) == len(keyframes)
    for ours, theirs in zip(keyframes, back.keyframes):
        assert all(np.array_equal(a, b) for a, b in zip(ours.observations, theirs.observations, strict=True))


def test_the_same_map_gives_the_same_file_and_replaces_the_old_one(slam_map, saved, tmp_path):
    (tmp_path / "again").write_bytes(b"something else")
    save_slam_map(load_slam_map(saved), tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == saved.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again", "lab.vsxmap"]


def test_saving_takes_little_memory_beside_the_map(tmp_path):
    rng, world, camera = np.random.default_rng(4), Map(), PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
    for k in range(40):
        pyramid = build_pyramid(rng.integers(0, 256, (480, 640), np.uint8))
        frame = FrameData(k, pyramid, no_corners(pyramid), small_image(pyramid), None, kernel_camera(camera))
        world.add_keyframe(frame, SE3.identity(), Observations.none())
    large = SlamMap(camera, None, world.view())
    tracemalloc.start()
    try:
        save_slam_map(large, tmp_path / "large.vsxmap")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (tmp_path / "large.vsxmap").stat().st_size > 40 * 640 * 480
    assert peak < 0.25 * 40 * 640 * 480


def test_a_map_without_odometry_has_no_mount(slam_map, tmp_path):
    save_slam_map(SlamMap(CAMERA, None, slam_map.view), tmp_path / "m")
    assert load_slam_map(tmp_path / "m").T_base_cam is None


def refused(path, message):
    with pytest.raises(MapFileError, match=message) as caught:
        load_slam_map(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value).split("; ")) >= 2 or "(" in str(caught.value), "the remedy is missing"


def test_flipped_bits_all_over_the_file_are_noticed(saved):
    whole = saved.read_bytes()
    rng = np.random.default_rng(0)
    positions = {*range(40), *range(len(whole) - 90, len(whole)), *rng.integers(0, len(whole), 150).tolist()}
    for position in sorted(positions):
        changed = bytearray(whole)
        changed[position] ^= 1 << int(rng.integers(8))
        saved.write_bytes(changed)
        refused(saved, r"checksum does not fit|no sealed archive")


def test_truncated_files_are_noticed(saved):
    whole = saved.read_bytes()
    for length in (0, 1, 3, 100, len(whole) // 2, len(whole) - 64, len(whole) - 1):
        saved.write_bytes(whole[:length])
        refused(saved, r"truncated|no sealed archive")


def test_files_that_are_missing_or_cannot_be_written_are_named(slam_map, tmp_path):
    refused(tmp_path / "absent.vsxmap", "cannot be read .*check the path")
    refused(tmp_path, "cannot be read")
    (tmp_path / "text").write_text("image: m.pgm\n")
    refused(tmp_path / "text", "no sealed archive.*give a file that this program saved")
    with pytest.raises(MapFileError, match="cannot be written.*choose another folder"):
        save_slam_map(slam_map, tmp_path / "absent" / "m.vsxmap")


def rewrite(path, name, change):
    """Change one entry of a map and seal it again, as a faulty program would have written it."""
    entries = unseal(path.read_bytes())
    if name == "manifest.json":
        tree = json.loads(entries[name])
        change(tree)
        entries[name] = json.dumps(tree).encode()
    elif name in LAYOUT:
        array = np.load(io.BytesIO(entries[f"arrays/{name}.npy"]))
        changed = change(array)
        buffer = io.BytesIO()
        np.save(buffer, array if changed is None else changed)
        entries[f"arrays/{name}.npy"] = buffer.getvalue()
    else:
        entries = change(entries)
    path.write_bytes(seal(entries))


def put(index, value):
    def change(array):
        array[index] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 4}, "format version 4.*reads up to 3, update vsx_ros"),
        ({"version": None}, "format version None"),
        ({"format": "another"}, "not that of a SLAM map"),
        ({"camera": {"width": 160}}, "'height' is missing"),
        ({"camera": None}, "cannot be used"),
        ({"T_base_cam": [[1.0]]}, "T_base_cam in its manifest is no pose"),
        ({"T_base_cam": [[float("nan")] * 4] * 4}, "T_base_cam in its manifest is no pose"),
        ({"map_version": "x"}, "invalid literal"),
    ],
)
def test_manifests_that_cannot_be(saved, change, message):
    rewrite(saved, "manifest.json", lambda tree: tree.update(change))
    refused(saved, message)


def test_a_file_of_the_first_version_whose_culled_keyframes_saw_nothing_is_read(slam_map, tmp_path):
    before = list(slam_map.view.keyframes)
    before[1] = dataclasses.replace(before[1], observations=Observations.none())
    old = dataclasses.replace(slam_map, view=slam_map.view._replace(keyframes=tuple(before)))
    save_slam_map(old, tmp_path / "old.vsxmap")
    rewrite(tmp_path / "old.vsxmap", "manifest.json", lambda tree: tree.update({"version": 1}))
    back = load_slam_map(tmp_path / "old.vsxmap").view
    assert [len(k.observations.rows) for k in back.keyframes] == [len(k.observations.rows) for k in before]
    assert len(back.keyframes[1].observations.rows) == 0


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("point", put((5, 1), np.nan), "point holds a number that is not finite"),
        ("translation", put((0, 0), np.inf), "translation holds a number that is not finite"),
        ("odometry", put((3, 2), np.nan), "odometry holds"),
        ("rotation", put(1, 2.0), "rotation holds a matrix that is no rotation"),
        ("rotation", lambda R: R * [[1.0], [1.0], [-1.0]], "no rotation"),
        ("point", lambda a: a[:-1], r"point_alive is bool of shape \(150,\), expected bool of \(149,\)"),
        ("point", lambda a: a.astype(np.float32), "point is float32"),
        ("point", lambda a: a.T, "point is float64 of shape"),
        ("template_patch", lambda a: a[:, :8], "template_patch is uint8 of shape"),
        ("observation_row", put(3, 150), "observation_row reaches from 0 to 150"),
        ("observation_row", put(3, -1), "observation_row reaches from -1"),
        ("observation_level", put(0, 4), "observation_level reaches"),
        ("observation_uv", put((0, 0), 1e9), "outside an image of 160x120"),
        ("observation_uv", lambda a: a[:-1], r"observation_ideal is float64 of shape"),
        ("observation_row", lambda a: a.astype(np.int16), "observation_row is int16"),
        ("observation_count", put(0, 10), "observation_count does not add up"),
        ("observation_count", put(slice(0, 2), [-5, 5]), "observation_count does not add up"),
        ("point_source", put(0, 5), "point_source reaches"),
        ("point_templates", put((0, 0), 10**6), "point_templates reaches"),
        ("template_source", put(0, -1), "template_source reaches"),
        ("anchor", put(1, 5), "anchor reaches"),
        ("anchor", put(1, 1), "anchor names a culled keyframe"),
        ("anchor", put(0, 2), "is not zero for a culled keyframe"),
        ("median_depth", put(0, -1.0), "median_depth reaches"),
        ("chain", put(0, -1), "chain reaches"),
        ("map_id", put(2, -1), "map_id reaches"),
        ("corner", put((0, 0), 160), "corner lies outside its image"),
        ("corner", put((0, 1), 60), "corner lies outside its image or out of order"),
        ("corner_count", put((0, 0), 0), "corner_count does not add up"),
        ("stamp_ns", lambda a: a[:0], r"rotation is float64 of shape \(5, 3, 3\)"),
    ],
)
def test_contents_that_cannot_be(saved, name, change, message):
    rewrite(saved, name, change)
    refused(saved, message)


def huge_array():
    """The head of an array of 10^17 bytes, and no body."""
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**16, 3)})
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("keyframes/000002.png", None, "'keyframes/000002.png' is missing"),
        ("keyframes/000002.png", b"no picture", "image of keyframe 2 is no grey picture of 160x120"),
        ("keyframes/000002.png", b"", "image of keyframe 2"),
        ("keyframes/000002.png", cv2.imencode(".png", np.zeros((120, 80), np.uint8))[1].tobytes(), "of 160x120"),
        ("keyframes/000002.png", cv2.imencode(".png", np.zeros((120, 160, 3), np.uint8))[1].tobytes(), "of 160x120"),
        ("arrays/point.npy", None, "'arrays/point.npy' is missing"),
        ("arrays/point.npy", b"\x93NUMPY", "cannot be used"),
        ("arrays/point.npy", b"", "cannot be used"),
        ("arrays/point.npy", huge_array(), "cannot be used"),
        ("manifest.json", None, "'manifest.json' is missing"),
        ("manifest.json", b"[1, 2]", "not that of a SLAM map"),
        ("manifest.json", b"{", "cannot be used"),
        ("manifest.json", b"\xff\xfe", "cannot be used"),
    ],
)
def test_entries_that_are_missing_or_something_else(saved, name, content, message):
    def change(entries):
        return {k: v for k, v in {**entries, name: content}.items() if v is not None}

    rewrite(saved, "all", change)
    refused(saved, message)


def test_a_dark_room_may_have_many_pictures_and_bytes_that_hide_more_are_refused():
    camera, black = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5), np.zeros((480, 640), np.uint8)
    jpg = CompressedPyramid.of(build_pyramid(black)).content
    _check_pictures({image_name(k, ".jpg"): jpg for k in range(1000)}, 1000, camera)
    for short in (jpg[: len(jpg) // 2], picture_file(build_pyramid(black))[: len(jpg)]):
        with pytest.raises(ValueError, match="1000 pictures asks for"):
            _check_pictures({image_name(k, suffix_of(short)): short for k in range(1000)}, 1000, camera)


def test_pickled_arrays_are_never_unpickled(saved):
    buffer = io.BytesIO()
    np.save(buffer, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    rewrite(saved, "all", lambda entries: {**entries, "arrays/point.npy": buffer.getvalue()})
    refused(saved, "allow_pickle=False|pickle")
