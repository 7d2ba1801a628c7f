"""Every topic, service, frame and parameter name, once. Names are relative, so a second robot only needs a namespace.

``PUBLISHED`` and ``SERVICES`` are the node graph; documentation and tests read it from here."""

from vsx_ros.robot import BASE_FRAME as BASE_FRAME
from vsx_ros.robot import BODY_FRAME as BODY_FRAME
from vsx_ros.robot import MAP_FRAME as MAP_FRAME
from vsx_ros.robot import ODOM_FRAME as ODOM_FRAME

_NODES = (
    "camera",
    "mobile_base",
    "vslam",
    "move_base",
    "follower",
    "explore",
    "dock",
    "teleop",
    "emulator",
    "dashboard",
    "run_folder",
)
PUBLISHED: dict[str, dict[str, str]] = {node: {} for node in _NODES}
"""Node -> topic -> type. Every node but teleop, dashboard and run_folder also publishes ``DIAGNOSTICS``."""

SERVICES: dict[str, dict[str, str]] = {}  # Node -> service -> type


def _topic(name: str, kind: str, *nodes: str) -> str:
    """A topic of this type that these nodes publish."""
    for node in nodes:
        PUBLISHED[node][name] = kind
    return name


def _service(name: str, kind: str, node: str) -> str:
    """A service of this type that a node offers."""
    SERVICES.setdefault(node, {})[name] = kind
    return name


# Frames (REP 103, 105, 120): map -> odom -> base_footprint -> base_link -> camera_link -> camera_rgb_frame
# -> camera_rgb_optical_frame; base_link -> gyro_link.
GYRO_FRAME = "gyro_link"
CAMERA_LINK_FRAME = "camera_link"
CAMERA_FRAME = "camera_rgb_frame"
OPTICAL_FRAME = "camera_rgb_optical_frame"
BLIND_FRAME = "odom_blind"  # not in tf: a goal in odom of a client that wants it driven to without the map

# tf is global by convention.
TF = _topic("/tf", "tf2_msgs/TFMessage", "mobile_base", "vslam")
TF_STATIC = _topic("/tf_static", "tf2_msgs/TFMessage", "vslam")
DIAGNOSTICS = "/diagnostics"
CLOCK = "/clock"

# camera
IMAGE = _topic("camera/rgb/image_raw", "sensor_msgs/Image", "camera")
CAMERA_INFO = _topic("camera/rgb/camera_info", "sensor_msgs/CameraInfo", "camera")
SHUTTER = _topic("camera/rgb/shutter", "std_msgs/Float64MultiArray", "camera")  # readout, exposure [s], or nothing
SET_CAMERA_INFO = _service("camera/rgb/set_camera_info", "sensor_msgs/SetCameraInfo", "camera")

# mobile_base: driver, mux and safety
ODOM = _topic("odom", "nav_msgs/Odometry", "mobile_base")
ODOM_FACTORS = _topic("mobile_base/odometry_factors", "std_msgs/Float64MultiArray", "mobile_base")  # distance, turn
JOINT_STATES = _topic("joint_states", "sensor_msgs/JointState", "mobile_base")
HAZARDS = _topic("mobile_base/hazards", "std_msgs/UInt8", "mobile_base")
OPERATOR_HOLD = _topic("mobile_base/operator_hold", "std_msgs/String", "mobile_base")  # JSON: by, since_ns
BUTTONS = _topic("mobile_base/buttons", "std_msgs/UInt8", "mobile_base")
BATTERY = _topic("battery", "sensor_msgs/BatteryState", "mobile_base")
IMU = _topic("mobile_base/sensors/imu_data", "sensor_msgs/Imu", "mobile_base")
IMU_RAW = _topic("mobile_base/sensors/imu_data_raw", "sensor_msgs/Imu", "mobile_base")
DOCK_IR = _topic("mobile_base/sensors/dock_ir", "std_msgs/UInt8MultiArray", "mobile_base")  # right, centre, left
DOCKED = _topic("mobile_base/docked", "std_msgs/Bool", "mobile_base")
BUMPER_CLOUD = _topic("mobile_base/sensors/bumper_pointcloud", "sensor_msgs/PointCloud2", "mobile_base")
MUX_ACTIVE = _topic("cmd_vel_mux/active", "std_msgs/String", "mobile_base")
COMMAND_SAFETY = "cmd_vel_mux/input/safety_controller"
COMMAND_TELEOP = _topic("cmd_vel_mux/input/teleop", "geometry_msgs/Twist", "teleop", "dashboard")
COMMAND_NAVI = _topic("cmd_vel_mux/input/navi", "geometry_msgs/Twist", "follower", "dock")
COMMANDS = {"safety_controller": COMMAND_SAFETY, "teleop": COMMAND_TELEOP, "navi": COMMAND_NAVI}
ESTOP = _service("mobile_base/estop", "std_srvs/SetBool", "mobile_base")
RESET_ODOMETRY = _service("mobile_base/reset_odometry", "std_srvs/Trigger", "mobile_base")

# vslam
POSE = _topic("vslam/pose", "geometry_msgs/PoseWithCovarianceStamped", "vslam")
SLAM_STATE = _topic("vslam/state", "diagnostic_msgs/DiagnosticStatus", "vslam")
MAP_POINTS = _topic("vslam/map_points", "sensor_msgs/PointCloud2", "vslam")
PLANES = _topic("vslam/planes", "visualization_msgs/MarkerArray", "vslam")
DENSE_POINTS = _topic("vslam/dense_points", "sensor_msgs/PointCloud2", "vslam")
SCAN = _topic("scan", "sensor_msgs/LaserScan", "vslam")
KEYFRAMES = _topic("vslam/keyframes", "geometry_msgs/PoseArray", "vslam")
# id, x, y [m] and heading [rad] of the optical axis of each keyframe of the map, also of culled ones; ids ascending
KEYFRAME_PLACES = _topic("vslam/keyframe_places", "std_msgs/Float64MultiArray", "vslam")
SLAM_PATH = _topic("vslam/path", "nav_msgs/Path", "vslam")
PREVIEW = _topic("vslam/preview/compressed", "sensor_msgs/CompressedImage", "vslam")
MAP = _topic("map", "nav_msgs/OccupancyGrid", "vslam")
MAP_METADATA = _topic("map_metadata", "nav_msgs/MapMetaData", "vslam")
STATIC_MAP = _service("static_map", "nav_msgs/GetMap", "vslam")
ZONES = _topic("zones", "std_msgs/String", "vslam")  # JSON, latched: zones in the map
ZONE_MARKERS = _topic("zones/markers", "visualization_msgs/MarkerArray", "vslam")
CHANGE_ZONES = _service("zones/change", "diagnostic_msgs/AddDiagnostics", "vslam")  # JSON in; success, words out
ROOMS = _topic("rooms", "std_msgs/String", "vslam")  # JSON, latched: rooms of the map
ROOM_MARKERS = _topic("rooms/markers", "visualization_msgs/MarkerArray", "vslam")
NAME_ROOM = _service("rooms/name", "diagnostic_msgs/AddDiagnostics", "vslam")
DOCK_POSE = _topic("dock/pose", "geometry_msgs/PoseStamped", "vslam")  # of the base when it charges; latched
SAVE_MAP = _service("vslam/save_map", "std_srvs/Trigger", "vslam")
SAVE_MAP_TO = "vslam/save_map_to"
STATS = "vslam/stats"
STAT_TYPES = {
    "tracked_ratio": "std_msgs/Float32",
    "tracked": "std_msgs/UInt32",
    "attempted": "std_msgs/UInt32",
    "keyframes": "std_msgs/UInt32",
    "points": "std_msgs/UInt32",
    "map_mib": "std_msgs/Float32",  # memory that the map takes
    "dense_mib": "std_msgs/Float32",  # and what the process of the dense map holds of it
    "fps": "std_msgs/Float32",
    "latency_ms": "std_msgs/Float32",
    "dropped": "std_msgs/UInt32",
}
"""Numbers a user may want to plot, one topic each below ``STATS``."""
for _name, _kind in STAT_TYPES.items():
    _topic(f"{STATS}/{_name}", _kind, "vslam")

# follower
FOLLOWER_STATUS = _topic("follower/status", "std_msgs/String", "follower")
FOLLOWER_CANCEL = _service("follower/cancel", "std_srvs/Trigger", "follower")
FOLLOWER_LEASE = _topic("follower/lease", "std_msgs/String", "vslam", "move_base")

# move_base: the planner
MOVE_BASE_ACTION = "move_base"
MOVE_BASE_GOAL = _topic("move_base/goal", "move_base_msgs/MoveBaseActionGoal", "explore", "dock", "dashboard")
MOVE_BASE_CANCEL = _topic("move_base/cancel", "actionlib_msgs/GoalID", "explore", "dock", "dashboard", "follower")
MOVE_BASE_STATUS = _topic("move_base/status", "actionlib_msgs/GoalStatusArray", "move_base")
_topic("move_base/result", "move_base_msgs/MoveBaseActionResult", "move_base")
_topic("move_base/feedback", "move_base_msgs/MoveBaseActionFeedback", "move_base")
_topic("move_base/parameter_descriptions", "dynamic_reconfigure/ConfigDescription", "move_base")
_topic("move_base/parameter_updates", "dynamic_reconfigure/Config", "move_base")
_service("move_base/set_parameters", "dynamic_reconfigure/Reconfigure", "move_base")
SIMPLE_GOAL = "move_base_simple/goal"
GLOBAL_PLAN = _topic("move_base/global_plan", "nav_msgs/Path", "move_base")
TRAJECTORY = _topic("move_base/trajectory", "trajectory_msgs/MultiDOFJointTrajectory", "move_base")
PLAN_MS = _topic("move_base/stats/plan_ms", "std_msgs/Float32", "move_base")
MAKE_PLAN = _service("move_base/make_plan", "nav_msgs/GetPlan", "move_base")
PREVIEW_GOAL = _service("move_base/preview_goal", "diagnostic_msgs/AddDiagnostics", "move_base")  # JSON in and out
NAVIGATION_LEASE = _topic("move_base/lease", "std_msgs/String", "explore", "dock")

# explore
FRONTIERS = _topic("explore/frontiers", "visualization_msgs/MarkerArray", "explore")
EXPLORE_STATUS = _topic("explore/status", "std_msgs/String", "explore")
EXPLORE_EVENTS = _topic("explore/events", "std_msgs/String", "explore")
COVERAGE = _topic("explore/coverage", "std_msgs/Float32", "explore")
EXPLORE_PAUSE = _service("explore/pause", "std_srvs/Trigger", "explore")
EXPLORE_RESUME = _service("explore/resume", "std_srvs/Trigger", "explore")
EXPLORE_STOP = _service("explore/stop", "std_srvs/Trigger", "explore")
EXPLORE_HOME = _service("explore/home", "std_srvs/Trigger", "explore")

# dock
DOCK_STATUS = _topic("dock/status", "std_msgs/String", "dock")  # JSON: see nodes.dock
DOCK_START = _service("dock/start", "diagnostic_msgs/AddDiagnostics", "dock")  # JSON in; success, words out
DOCK_LEAVE = _service("dock/leave", "std_srvs/Trigger", "dock")
DOCK_CANCEL = _service("dock/cancel", "std_srvs/Trigger", "dock")

# emulator: only for evaluation
TRUTH_ODOMETRY = _topic("emulator/ground_truth/odometry", "nav_msgs/Odometry", "emulator")
TRUTH_CAMERA = _topic("emulator/ground_truth/camera_pose", "geometry_msgs/PoseStamped", "emulator")
TRUTH_COLLISIONS = _topic("emulator/ground_truth/collisions", "std_msgs/UInt32", "emulator")
TRUTH_CLEARANCE = _topic("emulator/ground_truth/least_clearance_m", "std_msgs/Float32", "emulator")
RENDER_RATE = _topic("emulator/render_rate_hz", "std_msgs/Float32", "emulator")
