"""Small valid files of every kind that this stack reads, to be damaged."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
import yaml
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from vsx_ros.config import Config, to_dict
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.experiments.rows import Store
from vsx_ros.exploration.decision import SavedMission
from vsx_ros.geometry.camera import PinholeCamera, Shutter, kernel_camera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.io.dock_file import save_dock
from vsx_ros.io.map_export import write_ply
from vsx_ros.io.map_file import map_png
from vsx_ros.io.room_file import save_rooms
from vsx_ros.io.zone_file import save_zones
from vsx_ros.kernels.vision.patches import PATCH
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.rooms import RoomTracker
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.robot import Odometry
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import ClockLine, FrameLine, Journal, PictureLine, RunEvent, TruthLine, flat
from vsx_ros.runs.moments import map_line, preview
from vsx_ros.runs.parameters import update_robot_file
from vsx_ros.runs.self_calibration import FILE
from vsx_ros.slam.keyframe import FrameData, Observations
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.slam.templates import NewTemplates
from vsx_ros.slam.track import nothing_tracked
from vsx_ros.slam.tracking_record import TrackingRecord
from vsx_ros.vision.corners import CornerDetector
from vsx_ros.vision.patch_search import moving
from vsx_ros.vision.pyramid import build_pyramid, small_image

CAMERA = PinholeCamera(160, 120, 130.1, 131.7, 80.3, 59.9, (0.1, -0.2, 0.001, -0.002, 0.3))
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def slam_map() -> SlamMap:
    """Three keyframes, one of them culled and one compressed."""
    rng, detector, world = np.random.default_rng(3), CornerDetector(), Map()
    for k in range(3):
        pyramid = build_pyramid(cv2.GaussianBlur(rng.integers(0, 256, (120, 160), np.uint8), (0, 0), 1.5))
        camera = moving(kernel_camera(CAMERA), np.zeros(6))
        data = FrameData(k + 1, pyramid, detector.detect(pyramid), small_image(pyramid), SE2(0.1 * k, 0.0, 0.0), camera)
        world.add_keyframe(data, SE3.exp(rng.normal(0.0, 0.3, 6)), Observations.none(), map_id=0)
        templates = NewTemplates(
            rng.normal(size=(20, 4)), rng.random((20, 2)), rng.integers(0, 256, (20, PATCH, PATCH))
        )
        world.add_points(rng.normal(size=(20, 3)), templates, k)
    for k in range(3):
        uv = rng.uniform(0.0, 119.0, (60, 2))
        world.observe(k, Observations(np.arange(60), uv, uv + 0.1, rng.integers(0, 4, 60)))
    world.cull_keyframe(1)
    world.compress_keyframe(2)
    return SlamMap(CAMERA, SE3.exp(np.array([0.1, 0.0, 0.3, -1.2, 1.2, -1.2])), world.view())


def grid() -> OccupancyGrid:
    """A room with a pillar."""
    data = np.full((40, 60), 100, np.int8)
    data[1:-1, 1:-1] = 0
    data[15:20, 30:35] = 100
    data[:, :3] = -1
    return OccupancyGrid(data, 0.1, -1.0, 2.0)


def run_folder(path: Path) -> RunFolder:
    """A finished run with its checkpoint and journal."""
    folder = RunFolder.create(path)
    folder.write_config(Config(), ["vsx", "explore", "--fast"], seed=0, fast=True, world="lab")
    numbers = {"frames": 20, "breaks": 0, "u1": 0.6, "u2_frames": 5.5, "ended_well": True, "stop_reason": "it is done"}
    folder.write_summary({**numbers, "world": "lab", "version": "1", "duration_s": 2.0, "keyframes": 3})
    folder.write_events([RunEvent(k * 10**9, "slam", "GOOD", "first map") for k in range(3)])
    folder.write_frames([FrameRecord(k * 10**8, "good", 100, 60 + k, k == 5, 7.5, float(k)) for k in range(20)])
    poses = [StampedPose(k * 10**8, SE3.exp(np.array([0.1 * k, 0, 0, 0, 0, 0.01 * k]))) for k in range(20)]
    for name in ("trajectory", "odometry", "groundtruth"):
        folder.write_poses(name, poses)
    folder.write_map(grid())
    write_ply(folder.path / "sparse.ply", np.random.default_rng(0).normal(size=(50, 3)))
    saved = SavedMission([SE2(0, 0, 0)], [(SE2(1, 1, 0), 3.0, 1)], [SE2(0, 0, 0)], False, SE2(0, 0, 0))
    state = {"errors_m": np.zeros(3), "plans": np.array([4]), "driven": np.zeros((4, 3))}
    folder.checkpoint.write(CheckpointData(slam_map(), 10**9, state, saved.tree()))
    folder.checkpoint.write_mission(saved.tree(), 10**9)
    journal(folder.journal, poses)
    picture = np.random.default_rng(0).integers(0, 256, (24, 32), np.uint8)
    maps = [map_line(k * 10**9, grid(), map_png(grid())) for k in range(2)]
    Journal(folder.moments, [*(PictureLine(k * 10**9, preview(picture)) for k in range(2)), *maps])
    return folder


def live_session(path: Path) -> None:
    """A run whose checkpoint holds what the node vslam goes on with: tracking counts, ground, bumps, dock and zones."""
    world, ground = slam_map(), MappedGround(Config())
    for k in range(4):
        ground.moved(SE2(0.2 * k, 0.0, 0.1 * k), k * 10**8)
    ground.bumped(SE2(0.8, 0.0, 0.3))
    ground.docked(SE2(0.1, 0.0, 0.0))
    ground.zones.add(Zone("stairs", ZoneKind.NO_GO, ((1.0, 2.0), (3.0, 2.0), (3.0, 4.5))))
    record = TrackingRecord()
    record.initialised(10**8, np.zeros(3))
    rows = np.arange(40)
    track = nothing_tracked("")._replace(state=TrackingState.GOOD, rows=rows, searched_rows=rows)
    record.tracked(2 * 10**8, track, len(world.view.points), True)
    state = {**record.state(), **ground.state()}
    run_folder(path).checkpoint.write(CheckpointData(world, 10**9, state, {}))


def found_odometry(path: Path) -> None:
    """A folder with what a run found of its wheels."""
    path.mkdir()
    values = {"linear_scale": 1.01234, "angular_scale": 0.98765}
    update_robot_file(path / FILE, "robot.odometry", values, "found while driving", {"linear_scale": 0.002})


def renewed_camera_yaml(path: Path) -> None:
    """As 'vsx calibrate camera' writes it, with a shutter."""
    lens = PinholeCamera(160, 120, 90.1, 91.7, 80.3, 59.9, (0.01, -0.02, 0.001, -0.002), model="equidistant")
    write_calibration(path, replace(lens, shutter=Shutter(0.02, 0.005)), "kinect", "24 views\nrms 0.21 px")


def every_parameter(path: Path) -> None:
    path.write_text(yaml.safe_dump(to_dict(Config()), sort_keys=False))


def journal(path: Path, poses: list[StampedPose]) -> None:
    """A line of each kind."""
    lines = Journal(path)
    for k, pose in enumerate(poses):
        result = TrackingResult(pose.stamp_ns, TrackingState.GOOD, pose.T, 100, 60, k == 5, "")
        lines.add(FrameLine.of(result, Odometry(0, SE2(0.1 * k, 0.0, 0.0)), 7.0, 1.0))
    lines.add(RunEvent(stamp_ns=1, source="slam", state="GOOD", reason=""))
    lines.add(TruthLine(stamp_ns=2, T_world_cam=flat(poses[0].T), T_world_base=(0.0, 0.0, 0.0), collisions=0))
    lines.add(ClockLine(stamp_ns=3, elapsed_s=1.0, plans=1, collisions=0))


def messages(store, encodings: bool = True):
    """(topic, message): calibration, wheels, truth, raw and packed images."""
    T, ros1 = store.types, store is ROS1
    picture = np.random.default_rng(0).integers(0, 256, (24, 32), np.uint8)

    def header(stamp_ns: int):
        time = T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        return T["std_msgs/msg/Header"](0, time, "cam") if ros1 else T["std_msgs/msg/Header"](time, "cam")

    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K, R, P = np.array([30.0, 0, 15.5, 0, 30.0, 11.5, 0, 0, 1.0]), np.eye(3).ravel(), np.zeros(12)
    yield (
        "/camera/camera_info",
        T["sensor_msgs/msg/CameraInfo"](header(1), 24, 32, "plumb_bob", np.zeros(5), K, R, P, 0, 0, roi),
    )
    vector, zeros = T["geometry_msgs/msg/Vector3"], np.zeros(36)
    twist = T["geometry_msgs/msg/Twist"](vector(0.2, 0, 0), vector(0, 0, 0.1))
    for i in range(4):
        stamp = i * 10**8
        pose = T["geometry_msgs/msg/Pose"](
            T["geometry_msgs/msg/Point"](0.1 * i, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1.0)
        )
        yield "/odom", T["nav_msgs/msg/Odometry"](
            header(stamp), "base", T["geometry_msgs/msg/PoseWithCovariance"](pose, zeros),
            T["geometry_msgs/msg/TwistWithCovariance"](twist, zeros),
        )  # fmt: skip
        yield "/ground_truth/camera", T["geometry_msgs/msg/PoseStamped"](header(stamp), pose)
        yield "/camera/image_raw", T["sensor_msgs/msg/Image"](header(stamp), 24, 32, "mono8", 0, 32, picture.ravel())
        packed = cv2.imencode(".png", picture)[1].ravel()
        yield "/camera/image_raw/compressed", T["sensor_msgs/msg/CompressedImage"](header(stamp), "mono8; png", packed)


def ros1_bag(path: Path, how: str = "none") -> None:
    writer = Ros1Writer(path)
    if how != "none":
        writer.set_compression(Ros1Writer.CompressionFormat[how.upper()])
    with writer:
        _write(writer, ROS1, ROS1.serialize_ros1)


def ros2_bag(path: Path, plugin: StoragePlugin, mode: CompressionMode = CompressionMode.NONE) -> None:
    writer = Ros2Writer(path, version=8, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        _write(writer, ROS2, ROS2.serialize_cdr)


def _write(writer, store, serialize) -> None:
    connections = {}
    for index, (topic, message) in enumerate(messages(store)):
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
        writer.write(connections[topic], 1000 + index, serialize(message, message.__msgtype__))


def tum_folder(path: Path) -> None:
    """Three images with calibration, wheels and truth."""
    (path / "rgb").mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 256, (24, 32), np.uint8)
    for k in range(3):
        cv2.imwrite(str(path / "rgb" / f"{k}.png"), picture)
    (path / "rgb.txt").write_text("# stamp file\n" + "".join(f"{k}.5 rgb/{k}.png\n" for k in range(3)))
    lines = "".join(f"{k}.5 {k} 0 0 0 0 0 1\n" for k in range(3))
    for name in ("groundtruth", "odometry"):
        (path / f"{name}.txt").write_text(lines)
    numbers = {"width": 32, "height": 24, "fx": 30.0, "fy": 30.0, "cx": 15.5, "cy": 11.5, "dist": [0, 0, 0, 0, 0]}
    (path / "camera.json").write_text(json.dumps(numbers))


def camera_yaml(path: Path) -> None:
    write_calibration(path, CAMERA)


def config_yaml(path: Path) -> None:
    tree = {"robot": {"radius_m": 0.2}, "planner": {"phi_rad_m": 0.5}, "limits": {"v_m_s": 0.2}}
    path.write_text("# robot: measured\n" + yaml.safe_dump(tree))


def results_jsonl(path: Path) -> None:
    store = Store(path)
    for k in range(5):
        store.add({"seed": k}, {"u1": 0.5})


def picture(path: Path) -> None:
    """A picture of the kind given by its suffix."""
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8), (0, 0), 2.0)
    cv2.imwrite(str(path), image if path.suffix != ".pgm" else image[..., 0])


def gazebo_world(path: Path) -> None:
    """A folder with a world whose things are one mesh of each format, two of them with a picture."""
    path.mkdir()
    cv2.imwrite(str(path / "paint.png"), np.full((8, 8, 3), 120, np.uint8))
    (path / "paint.mtl").write_text("newmtl paint\nKd 0.5 0.6 0.7\nmap_Kd paint.png\n")
    box = trimesh.creation.box((1.0, 0.5, 0.6))
    for suffix in ("dae", "stl", "glb"):
        box.export(path / f"box.{suffix}")
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices)
    faces = "".join(f"f {a}/1 {b}/2 {c}/3\n" for a, b, c in box.faces + 1)
    (path / "box.obj").write_text(f"mtllib paint.mtl\n{corners}vt 0 0\nvt 1 0\nvt 0 1\nusemtl paint\n{faces}")
    models = "".join(
        f'<model name="m{i}"><pose>{2 + i} {i - 2} 0.3 0 0 {i}</pose><link name="l">'
        f'<visual name="v"><geometry><mesh><uri>{file}</uri></mesh></geometry></visual>'
        f'<collision name="c"><geometry><mesh><uri>{file}</uri></mesh></geometry></collision></link></model>'
        for i, file in enumerate(("box.dae", "box.stl", "box.glb", "box.obj"))
    )
    ground = "<include><uri>model://ground_plane</uri></include>"
    lamp = '<light name="s" type="point"><pose>0 0 2 0 0 0</pose><diffuse>1 1 1 1</diffuse></light>'
    (path / "room.world").write_text(f'<sdf version="1.6"><world name="w">{ground}{lamp}{models}</world></sdf>')


def zones_yaml(path: Path) -> None:
    """A zone of each kind."""
    corners = ((1.0, 2.0), (3.0, 2.0), (3.0, 4.5))
    kinds = (ZoneKind.NO_GO, ZoneKind.WALL, ZoneKind.ONLY, ZoneKind.SLOW, ZoneKind.LOOK)
    save_zones([Zone(kind.name.lower(), kind, corners, 0.1 if kind is ZoneKind.SLOW else None) for kind in kinds], path)


def dock_yaml(path: Path) -> None:
    save_dock(SE2(1.25, -3.5, 0.5), path)


def rooms_folder(path: Path) -> None:
    """The rooms of a ground map of two."""
    path.mkdir()
    data = np.zeros((60, 120), np.int8)
    data[:, 58:62], data[25:35, 58:62] = OCCUPIED, FREE
    ground = OccupancyGrid(np.pad(data, 3, constant_values=OCCUPIED), 0.05, 0.0, 0.0)
    save_rooms(RoomTracker(Config().rooms).update(ground), path / "map_rooms.json")
