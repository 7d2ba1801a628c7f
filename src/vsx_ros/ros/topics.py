"""Every topic, service, frame and parameter name, once. Names are relative, so a namespace gives a second robot.

``PUBLISHED`` and ``SERVICES`` are the node graph: documentation and tests read it from here.
"""

# Frames (REP 103, 105, 120): map -> odom -> base_footprint -> base_link -> camera_link -> camera_rgb_frame
# -> camera_rgb_optical_frame; base_link -> gyro_link.
MAP_FRAME = "map"
ODOM_FRAME = "odom"
BASE_FRAME = "base_footprint"
BODY_FRAME = "base_link"
GYRO_FRAME = "gyro_link"
CAMERA_LINK_FRAME = "camera_link"
CAMERA_FRAME = "camera_rgb_frame"
OPTICAL_FRAME = "camera_rgb_optical_frame"

# tf is global by its own convention.
TF = "/tf"
TF_STATIC = "/tf_static"
DIAGNOSTICS = "/diagnostics"
CLOCK = "/clock"

# camera
IMAGE = "camera/rgb/image_raw"
CAMERA_INFO = "camera/rgb/camera_info"
SET_CAMERA_INFO = "camera/rgb/set_camera_info"

# mobile_base: driver, mux and safety
ODOM = "odom"
JOINT_STATES = "joint_states"
IMU = "mobile_base/sensors/imu_data"
IMU_RAW = "mobile_base/sensors/imu_data_raw"
BUMPER_CLOUD = "mobile_base/sensors/bumper_pointcloud"
HAZARDS = "mobile_base/hazards"
BUTTONS = "mobile_base/buttons"
BATTERY = "battery"
MUX_ACTIVE = "cmd_vel_mux/active"
COMMAND_SAFETY = "cmd_vel_mux/input/safety_controller"
COMMAND_TELEOP = "cmd_vel_mux/input/teleop"
COMMAND_NAVI = "cmd_vel_mux/input/navi"
COMMANDS = {"safety_controller": COMMAND_SAFETY, "teleop": COMMAND_TELEOP, "navi": COMMAND_NAVI}
ESTOP = "mobile_base/estop"
RESET_ODOMETRY = "mobile_base/reset_odometry"

# vslam
POSE = "vslam/pose"
SLAM_STATE = "vslam/state"
STATS = "vslam/stats"
MAP_POINTS = "vslam/map_points"
PLANES = "vslam/planes"
DENSE_POINTS = "vslam/dense_points"
SCAN = "scan"
KEYFRAMES = "vslam/keyframes"
SLAM_PATH = "vslam/path"
PREVIEW = "vslam/preview/compressed"
MAP = "map"
MAP_METADATA = "map_metadata"
STATIC_MAP = "static_map"
SAVE_MAP = "vslam/save_map"
SAVE_MAP_TO = "vslam/save_map_to"

# move_base: the planner
MOVE_BASE_ACTION = "move_base"
SIMPLE_GOAL = "move_base_simple/goal"
GLOBAL_PLAN = "move_base/global_plan"
TRAJECTORY = "move_base/trajectory"
PLAN_MS = "move_base/stats/plan_ms"
MAKE_PLAN = "move_base/make_plan"
NAVIGATION_LEASE = "move_base/lease"

# follower
FOLLOWER_STATUS = "follower/status"
FOLLOWER_CANCEL = "follower/cancel"
FOLLOWER_LEASE = "follower/lease"

# explore
FRONTIERS = "explore/frontiers"
EXPLORE_STATUS = "explore/status"
EXPLORE_EVENTS = "explore/events"
COVERAGE = "explore/coverage"
EXPLORE_PAUSE = "explore/pause"
EXPLORE_RESUME = "explore/resume"
EXPLORE_STOP = "explore/stop"
EXPLORE_HOME = "explore/home"

# emulator: what only an evaluator may hear
TRUTH = "emulator/ground_truth"
TRUTH_ODOMETRY = "emulator/ground_truth/odometry"
TRUTH_CAMERA = "emulator/ground_truth/camera_pose"
TRUTH_COLLISIONS = "emulator/ground_truth/collisions"
TRUTH_CLEARANCE = "emulator/ground_truth/least_clearance_m"
RENDER_RATE = "emulator/render_rate_hz"

STAT_TYPES = {
    "tracked_ratio": "std_msgs/Float32",
    "tracked": "std_msgs/UInt32",
    "attempted": "std_msgs/UInt32",
    "keyframes": "std_msgs/UInt32",
    "points": "std_msgs/UInt32",
    "fps": "std_msgs/Float32",
    "latency_ms": "std_msgs/Float32",
    "dropped": "std_msgs/UInt32",
}
"""Numbers a user may want to plot, one topic each below ``STATS``."""

PUBLISHED: dict[str, dict[str, str]] = {
    "camera": {IMAGE: "sensor_msgs/Image", CAMERA_INFO: "sensor_msgs/CameraInfo"},
    "mobile_base": {
        ODOM: "nav_msgs/Odometry",
        TF: "tf2_msgs/TFMessage",
        JOINT_STATES: "sensor_msgs/JointState",
        HAZARDS: "std_msgs/UInt8",
        BUTTONS: "std_msgs/UInt8",
        BATTERY: "sensor_msgs/BatteryState",
        IMU: "sensor_msgs/Imu",
        IMU_RAW: "sensor_msgs/Imu",
        BUMPER_CLOUD: "sensor_msgs/PointCloud2",
        MUX_ACTIVE: "std_msgs/String",
    },
    "vslam": {
        POSE: "geometry_msgs/PoseWithCovarianceStamped",
        TF: "tf2_msgs/TFMessage",
        TF_STATIC: "tf2_msgs/TFMessage",
        SLAM_STATE: "diagnostic_msgs/DiagnosticStatus",
        MAP_POINTS: "sensor_msgs/PointCloud2",
        PLANES: "visualization_msgs/MarkerArray",
        DENSE_POINTS: "sensor_msgs/PointCloud2",
        SCAN: "sensor_msgs/LaserScan",
        KEYFRAMES: "geometry_msgs/PoseArray",
        SLAM_PATH: "nav_msgs/Path",
        PREVIEW: "sensor_msgs/CompressedImage",
        MAP: "nav_msgs/OccupancyGrid",
        MAP_METADATA: "nav_msgs/MapMetaData",
        FOLLOWER_LEASE: "std_msgs/String",
        **{f"{STATS}/{name}": kind for name, kind in STAT_TYPES.items()},
    },
    "move_base": {
        GLOBAL_PLAN: "nav_msgs/Path",
        PLAN_MS: "std_msgs/Float32",
        TRAJECTORY: "trajectory_msgs/MultiDOFJointTrajectory",
        FOLLOWER_LEASE: "std_msgs/String",
        f"{MOVE_BASE_ACTION}/parameter_descriptions": "dynamic_reconfigure/ConfigDescription",
        f"{MOVE_BASE_ACTION}/parameter_updates": "dynamic_reconfigure/Config",
        f"{MOVE_BASE_ACTION}/status": "actionlib_msgs/GoalStatusArray",
        f"{MOVE_BASE_ACTION}/result": "move_base_msgs/MoveBaseActionResult",
        f"{MOVE_BASE_ACTION}/feedback": "move_base_msgs/MoveBaseActionFeedback",
    },
    "follower": {COMMAND_NAVI: "geometry_msgs/Twist", FOLLOWER_STATUS: "std_msgs/String"},
    "explore": {
        FRONTIERS: "visualization_msgs/MarkerArray",
        EXPLORE_STATUS: "std_msgs/String",
        EXPLORE_EVENTS: "std_msgs/String",
        COVERAGE: "std_msgs/Float32",
        NAVIGATION_LEASE: "std_msgs/String",
        f"{MOVE_BASE_ACTION}/goal": "move_base_msgs/MoveBaseActionGoal",
        f"{MOVE_BASE_ACTION}/cancel": "actionlib_msgs/GoalID",
    },
    "teleop": {COMMAND_TELEOP: "geometry_msgs/Twist"},
    "emulator": {
        TRUTH_ODOMETRY: "nav_msgs/Odometry",
        TRUTH_CAMERA: "geometry_msgs/PoseStamped",
        TRUTH_COLLISIONS: "std_msgs/UInt32",
        TRUTH_CLEARANCE: "std_msgs/Float32",
        RENDER_RATE: "std_msgs/Float32",
    },
    "dashboard": {},
}
"""Node -> topic -> type. Every node but teleop and dashboard also publishes ``DIAGNOSTICS``."""

SERVICES: dict[str, dict[str, str]] = {
    "camera": {SET_CAMERA_INFO: "sensor_msgs/SetCameraInfo"},
    "mobile_base": {ESTOP: "std_srvs/SetBool", RESET_ODOMETRY: "std_srvs/Trigger"},
    "vslam": {STATIC_MAP: "nav_msgs/GetMap", SAVE_MAP: "std_srvs/Trigger"},
    "move_base": {
        MAKE_PLAN: "nav_msgs/GetPlan",
        f"{MOVE_BASE_ACTION}/set_parameters": "dynamic_reconfigure/Reconfigure",
    },
    "follower": {FOLLOWER_CANCEL: "std_srvs/Trigger"},
    "explore": {
        EXPLORE_PAUSE: "std_srvs/Trigger",
        EXPLORE_RESUME: "std_srvs/Trigger",
        EXPLORE_STOP: "std_srvs/Trigger",
        EXPLORE_HOME: "std_srvs/Trigger",
    },
}
"""Node -> service -> type."""
