"""Converts poses, motion, states and maps between messages and our types. Pure functions: no node, no master.

A message from outside may hold anything; unusable content raises InputError or MapFileError."""

import math
from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Twist, Vector3
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Odometry as OdometryMsg
from nav_msgs.msg import Path as PathMsg
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Float64MultiArray

from vsx_hw.readings import Hazard
from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.config import MountConfig
from vsx_ros.errors import InputError, MapFileError
from vsx_ros.geometry.level import refuse_tilt
from vsx_ros.geometry.mount import mount_pose, mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.anchored_poses import KeyframePlaces
from vsx_ros.occupancy.grid import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.robot import UNSURE_HEADING_RAD2, Odometry, VelocityCommand
from vsx_ros.ros import topics
from vsx_ros.ros.headers import header, own
from vsx_ros.slam.state import TrackingState

# map_server's thresholds: other mappers also publish values between 0 and 100.
_FREE_BELOW_PERCENT = 19.6
_OCCUPIED_ABOVE_PERCENT = 65

_STATES = {state.word: state for state in TrackingState}
_LEVELS = {
    TrackingState.NOT_INITIALISED: DiagnosticStatus.WARN,
    TrackingState.GOOD: DiagnosticStatus.OK,
    TrackingState.DUBIOUS: DiagnosticStatus.WARN,
    TrackingState.LOST: DiagnosticStatus.ERROR,
}
UNKNOWN_VARIANCE = 1e10
"""For quantities that a planar robot cannot know (z, roll, pitch). Huge, because 0 would mean certainty."""


# Poses ---------------------------------------------------------------------------------------------------------


def quaternion_of_heading(theta: float) -> Quaternion:
    """Rotation about z by theta [rad]."""
    return Quaternion(0.0, 0.0, math.sin(0.5 * theta), math.cos(0.5 * theta))


def se3(pose: Pose) -> SE3:
    """The pose in space. Raises InputError for a number that is not finite or an invalid quaternion."""
    p, q = pose.position, pose.orientation
    refuse_no_pose(p, q)
    return SE3.from_quaternion(np.array([p.x, p.y, p.z]), (q.x, q.y, q.z, q.w))


def refuse_no_pose(p: Point | Vector3, q: Quaternion) -> None:
    """Raises InputError for a number that is not finite, or a quaternion whose length is near 0 or huge."""
    numbers = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
    if not (all(map(math.isfinite, numbers)) and 1e-3 < math.hypot(*numbers[3:]) < 1e3):
        raise InputError(f"pose message holds {numbers}; positions must be finite and quaternions of length 1")


def se2(pose: Pose) -> SE2:
    """The pose on the floor. Raises InputError as ``se3`` does."""
    return se3(pose).to_se2()


def pose_msg(T: SE2 | SE3) -> Pose:
    """A pose on the floor or in space."""
    if isinstance(T, SE2):
        return Pose(Point(T.x, T.y, 0.0), quaternion_of_heading(T.theta))
    return Pose(Point(*T.translation.tolist()), Quaternion(*T.quaternion()))


def pose_stamped(frame_id: str, stamp_ns: int, T: SE2 | SE3) -> PoseStamped:
    """A pose with its frame and time."""
    return PoseStamped(header(frame_id, stamp_ns), pose_msg(T))


def floor_covariance(T_frame_base: SE2, covariance: FloatArray) -> list[float]:
    """The 6x6 covariance of x, y, z, roll, pitch, yaw (or their speeds) of a robot on the floor, row by row, along the
    frame's axes. covariance (6, 6): in the base's axes; only x, y and yaw are used."""
    c, s = math.cos(T_frame_base.theta), math.sin(T_frame_base.theta)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    on_floor = np.array([0, 1, 5])
    told = UNKNOWN_VARIANCE * np.eye(6)
    told[np.ix_(on_floor, on_floor)] = axes @ covariance[np.ix_(on_floor, on_floor)] @ axes.T
    return [float(value) for value in told.ravel()]


def path_msg(frame_id: str, stamp_ns: int, poses: Sequence[SE2]) -> PathMsg:
    """Poses on the floor as a path."""
    return PathMsg(header(frame_id, stamp_ns), [pose_stamped(frame_id, stamp_ns, T) for T in poses])


def transform_stamped(parent: str, child: str, stamp_ns: int, T_parent_child: SE2 | SE3) -> TransformStamped:
    """One edge of the tf tree."""
    pose = pose_msg(T_parent_child)
    translation = Vector3(pose.position.x, pose.position.y, pose.position.z)
    return TransformStamped(header(parent, stamp_ns), own(child), Transform(translation, pose.orientation))


def mount_transforms(mount: MountConfig, stamp_ns: int) -> list[TransformStamped]:
    """base_footprint -> base_link -> camera_link -> camera_rgb_frame -> camera_rgb_optical_frame, as mounted. Also
    base_link -> gyro_link, upright: the gyro's position on the base affects neither heading nor rate."""
    T_base_optical = mounted(mount)
    T_camera_optical = mount_pose(0.0, 0.0, 0.0, 0.0)
    T_base_camera = T_base_optical @ T_camera_optical.inverse()
    identity = SE3.identity()
    return [
        transform_stamped(topics.BASE_FRAME, topics.BODY_FRAME, stamp_ns, identity),
        transform_stamped(topics.BODY_FRAME, topics.CAMERA_LINK_FRAME, stamp_ns, T_base_camera),
        transform_stamped(topics.CAMERA_LINK_FRAME, topics.CAMERA_FRAME, stamp_ns, identity),
        transform_stamped(topics.CAMERA_FRAME, topics.OPTICAL_FRAME, stamp_ns, T_camera_optical),
        transform_stamped(topics.BODY_FRAME, topics.GYRO_FRAME, stamp_ns, identity),
    ]


# Motion and states ---------------------------------------------------------------------------------------------


def odometry(msg: OdometryMsg) -> Odometry:
    """Wheel odometry; not trusted if its heading variance is 1 rad2 or more. Raises InputError for numbers that are not
    finite, and a pose that no base on wheels has."""
    v, omega = msg.twist.twist.linear.x, msg.twist.twist.angular.z
    if not (math.isfinite(v) and math.isfinite(omega)):
        raise InputError(f"odometry message holds speeds {v} m/s, {omega} rad/s; they must be finite")
    T_odom_base, trusted = se3(msg.pose.pose), msg.pose.covariance[35] < UNSURE_HEADING_RAD2
    refuse_tilt(T_odom_base)
    return Odometry(msg.header.stamp.to_nsec(), T_odom_base.to_se2(), v=v, omega=omega, trusted=trusted)


def odometry_msg(reading: Odometry, frame_id: str, child_frame_id: str) -> OdometryMsg:
    """The message of wheel odometry. The caller, who knows the base, sets the covariances."""
    msg = OdometryMsg(header=header(frame_id, reading.stamp_ns), child_frame_id=own(child_frame_id))
    msg.pose.pose = pose_msg(reading.T_odom_base)
    msg.twist.twist = twist(VelocityCommand(reading.v, reading.omega))
    return msg


def twist(command: VelocityCommand) -> Twist:
    """A velocity command as a message."""
    return Twist(linear=Vector3(command.v, 0.0, 0.0), angular=Vector3(0.0, 0.0, command.omega))


def state_msg(state: TrackingState, reason: str, ahead: str = "", stuck: str = "") -> DiagnosticStatus:
    """The SLAM's state. name: NOT_INITIALISED, TRACKING, POOR or LOST; message: the reason. Values, if any: ``ahead``:
    what hides the map before the camera; ``stuck``: that the wheels turn although the camera stands."""
    values = [KeyValue(key, words) for key, words in (("ahead", ahead), ("stuck", stuck)) if words]
    return DiagnosticStatus(_LEVELS[state], state.word, reason, "vslam", values)


def tracking_state(msg: DiagnosticStatus) -> TrackingState:
    """The state of a message. Raises InputError for an unknown name."""
    if msg.name not in _STATES:
        raise InputError(f"SLAM state {msg.name!r} is unknown; expected one of {', '.join(_STATES)}")
    return _STATES[msg.name]


def ahead_and_stuck(msg: DiagnosticStatus) -> tuple[str, str]:
    """What hides the map before the camera, and that the base is stuck, in words; empty if nothing does."""
    values = {value.key: str(value.value) for value in msg.values}
    return values.get("ahead", ""), values.get("stuck", "")


def hazard_words(mask: int) -> str:
    """The bits of mobile_base/hazards in words; empty if none is set."""
    hazards = Hazard(mask)
    single = [hazard for hazard in Hazard if hazard & hazards and hazard & (hazard - 1) == 0]
    return ", ".join(str(hazard.name).replace("_", " ").lower() for hazard in single)


# Maps ----------------------------------------------------------------------------------------------------------


def grid(msg: OccupancyGridMsg) -> OccupancyGrid:
    """The map: at most 19 % is free, 65 % and more occupied, anything between is unknown (map_server's rule). Raises
    MapFileError if the sizes disagree or the map is rotated in its frame."""
    info = msg.info
    if len(msg.data) != info.width * info.height or not 0 < len(msg.data) <= MAX_CELLS:
        raise MapFileError(
            f"map message says {info.width}x{info.height} cells and holds {len(msg.data)}; publish all of them, "
            f"at most {MAX_CELLS}"
        )
    data = np.asarray(msg.data, np.int16)
    origin = se2(info.origin)
    if abs(origin.theta) > 1e-6:
        raise MapFileError(
            f"map message is rotated by {origin.theta:.3f} rad; publish it with axes parallel to its frame"
        )
    cells = np.full(data.shape, UNKNOWN, np.int8)
    cells[(data >= 0) & (data <= _FREE_BELOW_PERCENT)] = FREE
    cells[data >= _OCCUPIED_ABOVE_PERCENT] = OCCUPIED
    resolution = float(str(np.float32(info.resolution)))  # the shortest number with this float32
    return OccupancyGrid(cells.reshape(info.height, info.width), resolution, origin.x, origin.y)


def grid_msg(grid: OccupancyGrid, frame_id: str, stamp_ns: int) -> OccupancyGridMsg:
    """The message of a map: free cells have the percentage of their obstacle probability, ``OccupancyGrid.percent``."""
    msg = OccupancyGridMsg(header=header(frame_id, stamp_ns))
    msg.info.map_load_time = msg.header.stamp
    msg.info.resolution = grid.resolution
    msg.info.height, msg.info.width = grid.shape
    msg.info.origin = pose_msg(SE2(grid.origin_x, grid.origin_y, 0.0))
    msg.data = grid.percent().ravel().tolist()
    return msg


def places_msg(ids: IntArray, T_world_cams: Sequence[SE3]) -> Float64MultiArray:
    """Where these keyframes are, for ``keyframe_places``."""
    places = KeyframePlaces.of(ids, T_world_cams)
    return Float64MultiArray(data=np.column_stack(places).ravel().tolist())


def keyframe_places(msg: Float64MultiArray) -> KeyframePlaces:
    """Raises InputError for what ``places_msg`` does not make."""
    rows = np.asarray(msg.data, np.float64)
    if len(rows) % 4 or not (np.abs(rows) < 2**53).all() or (np.diff(rows[::4]) <= 0.0).any():
        raise InputError(f"{len(rows)} numbers are no places of keyframes, each with id, x, y and heading")
    return KeyframePlaces(rows[::4].astype(np.int64), rows.reshape(-1, 4)[:, 1:])


def cloud_msg(points: Points3, frame_id: str, stamp_ns: int) -> PointCloud2:
    """(N, 3) points [m] as float32 x, y, z."""
    packed = np.ascontiguousarray(points, dtype="<f4").reshape(-1, 3)
    fields = [PointField(name, 4 * k, PointField.FLOAT32, 1) for k, name in enumerate("xyz")]
    return PointCloud2(
        header(frame_id, stamp_ns), 1, len(packed), fields, False, 12, 12 * len(packed), packed.tobytes(), True
    )


def cloud_points(msg: PointCloud2) -> FloatArray:
    """(N, 3) x, y, z of a cloud whose first three fields are little-endian float32 x, y, z. Raises InputError for
    another layout or a number that is not finite."""
    names = [field.name for field in msg.fields[:3]]
    count = msg.width * msg.height
    if names != ["x", "y", "z"] or msg.is_bigendian or msg.point_step < 12 or len(msg.data) < count * msg.point_step:
        raise InputError(f"cloud with fields {names} and {len(msg.data)} bytes is not float32 x, y, z")
    rows = np.frombuffer(msg.data, np.uint8, count * msg.point_step).reshape(count, msg.point_step)
    points = np.ascontiguousarray(rows[:, :12]).view("<f4").reshape(-1, 3).astype(np.float64)
    if not np.all(np.isfinite(points)):
        raise InputError(f"cloud of {count} points holds a coordinate that is not finite")
    return points
