"""Every parameter of the stack: name, unit, default, bound. Branches have the names of the components
that receive them. ``vsx config`` prints this tree; config/default.yaml is generated from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from vsx_ros.config.driving import LEAST_PHI_RAD_M, FollowerConfig, LimitsConfig, PlannerConfig
from vsx_ros.config.maps import (
    Branch,
    Count,
    DenseConfig,
    FieldOfView,
    GroundMapConfig,
    NonNegative,
    Positive,
    Ratio,
    RoomsConfig,
    SlamConfig,
)
from vsx_ros.config.running import ComputingConfig, DockingConfig, RunsConfig, SelfCalibrationConfig
from vsx_ros.config.words import in_words, no_parameter
from vsx_ros.errors import ConfigError

__all__ = [
    "ComputingConfig", "Config", "DenseConfig", "DockingConfig", "ExplorationConfig", "FollowerConfig",
    "GroundMapConfig", "LEAST_PHI_RAD_M", "LimitsConfig", "MountConfig", "OdometryConfig", "PlannerConfig",
    "RobotConfig", "RoomsConfig", "RunsConfig", "SIGMAS", "SelfCalibrationConfig", "SlamConfig",
    "from_dict", "leaves", "overridden", "to_dict",
]  # fmt: skip

_MOST = 1e9  # of any number: more is a mistake, and overflows as a time in nanoseconds
_ASCENDING = (
    ("slam.initialization.baseline_m", "slam.initialization.baseline_max_m"),
    ("slam.tracker.lost_ratio", "slam.tracker.good_ratio"),
    ("ground_map.obstacle_min_height_m", "ground_map.obstacle_max_height_m"),
    ("dense.min_parallax_deg", "dense.max_parallax_deg"),
    ("dense.min_range_m", "dense.max_range_m"),
    ("docking.reserve_ratio", "docking.charged_ratio"),
)
_OR_CALIBRATED = {  # -1: the calibration's; else at least so much
    "slam.shutter.readout_s": 0.0, "slam.shutter.exposure_s": 0.0,
    "planner.sight_fov_rad": 0.1, "exploration.sensor_fov_rad": 0.1,
}  # fmt: skip


class MountConfig(Branch, frozen=True):
    """Where the camera sits on the base (T_base_cam). It looks ahead: views and ways are chosen by that."""

    forward_m: float = -0.09
    left_m: float = 0.0
    height_m: Positive = 0.31
    pitch_down_rad: Annotated[float, Meta(ge=-0.8, le=0.8)] = 0.0
    yaw_left_rad: Annotated[float, Meta(ge=-0.2, le=0.2)] = 0.0


class OdometryConfig(Branch, frozen=True):
    """Factors on the distance and turn of the base's wheels; 'vsx calibrate odometry' finds them."""

    linear_scale: Annotated[float, Meta(ge=0.5, le=2)] = 1.0
    angular_scale: Annotated[float, Meta(ge=0.5, le=2)] = 1.0


class RobotConfig(Branch, frozen=True):
    """The body."""

    radius_m: Annotated[float, Meta(gt=0, le=1)] = 0.18
    height_m: Positive = 0.45
    mount: MountConfig = MountConfig()
    odometry: OdometryConfig = OdometryConfig()


class ExplorationConfig(Branch, frozen=True):
    """Frontiers, views and the mission (paper 5.2). sensor_fov_rad: as planner.sight_fov_rad."""

    ranker: str = "views"
    decide_s: Annotated[float, Meta(gt=0, le=2)] = 0.2  # live, the permission to drive ends 5 s after a decision
    sensor_range_m: Positive = 3.0
    sensor_fov_rad: FieldOfView = -1.0
    mean_free_path_m: Positive = 1.0
    init_drive_m: Annotated[float, Meta(gt=0, le=1)] = 0.45
    init_headings: Count = 4  # a quarter turn apart, in which it drives ahead and back to start the map
    min_frontier_m: NonNegative = 0.25
    min_gain_m2: NonNegative = 0.08
    min_utility_m: NonNegative = 0.03
    stop_cost_m: Positive = 2.0
    look_range_m: Positive = 3.0
    looks_to_half: Positive = 1.5
    wall_gap_m: Positive = 1.0  # in any straight row; ground behind it counts less (ground_map.wall_gap_m: gap is wall)
    goal_seen_ratio: Ratio = 0.3
    look_spacing_m: Positive = 0.35
    view_spacing_m: Positive = 0.2
    view_margin_m: NonNegative = 0.05
    max_ranked_views: Count = 300
    min_landmarks: Annotated[int, Meta(ge=0)] = 15
    good_landmarks: Count = 60
    blacklist_radius_m: Positive = 0.4
    blacklist_s: Positive = 60.0
    backtrack_step_m: Annotated[float, Meta(gt=0, le=1)] = 0.35
    backtrack_max_m: Positive = 1.5
    retries_without_view: Count = 2
    retries_boxed_in: Count = 10
    # After the last command of teleop the robot waits for so long, then it goes on exploring.
    teleop_quiet_s: Annotated[float, Meta(ge=0, le=60)] = 3.0
    stay_at_user_goal: bool = False  # true: after a goal of the user's it waits for explore/resume


class Config(Branch, frozen=True):
    """The whole tree."""

    robot: RobotConfig = RobotConfig()
    limits: LimitsConfig = LimitsConfig()
    slam: SlamConfig = SlamConfig()
    self_calibration: SelfCalibrationConfig = SelfCalibrationConfig()
    planner: PlannerConfig = PlannerConfig()
    follower: FollowerConfig = FollowerConfig()
    ground_map: GroundMapConfig = GroundMapConfig()
    dense: DenseConfig = DenseConfig()
    rooms: RoomsConfig = RoomsConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    docking: DockingConfig = DockingConfig()
    runs: RunsConfig = RunsConfig()
    computing: ComputingConfig = ComputingConfig()


SIGMAS = "sigmas"


def from_dict(tree: dict[str, Any]) -> Config:
    """The configuration from a nested dict; missing entries take their default. ``SIGMAS``, which calibrations write
    beside their results, are no parameters.

    Raises ConfigError naming the entry, e.g. ``limits.v_m_s is 'fast'; give a number from 0.01 to 0.7``."""
    if isinstance(tree, dict):
        tree = {name: part for name, part in tree.items() if name != SIGMAS}
    try:
        config: Config = msgspec.convert(tree, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(f"configuration: {in_words(Config, _names(), tree, str(error))}") from error
    values = dict(leaves(to_dict(config)))
    for name, value in values.items():
        if isinstance(value, int | float) and not abs(value) <= _MOST:
            raise ConfigError(f"configuration: {name} is {value}; it needs a number of at most {_MOST:g}")
    for low, high in _ASCENDING:
        if values[low] >= values[high]:
            raise ConfigError(f"configuration: {low} is {values[low]:g}; it must be below {high}, {values[high]:g}")
    for name, least in _OR_CALIBRATED.items():
        if -1.0 < (value := values[name]) < least:
            raise ConfigError(f"configuration: {name} is {value:g}; give -1 (the calibration's) or at least {least:g}")
    return config


def _names() -> Iterator[str]:
    return (name for name, _ in leaves(to_dict(Config())))


def leaves(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and value of all parameters in a nested dict."""
    for name, value in tree.items():
        yield from leaves(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]


def to_dict(config: Config) -> dict[str, Any]:
    """The nested dict that ``from_dict`` reads back to the same configuration."""
    return dict(msgspec.to_builtins(config))


def overridden(config: Config, assignments: dict[str, Any]) -> Config:
    """A copy with dotted names replaced, e.g. ``{"planner.phi_rad_m": 0.5}``.

    Raises ConfigError for an unknown name or an impossible value."""
    tree = to_dict(config)
    for name, value in assignments.items():
        *branches, leaf = name.split(".")
        node = tree
        for branch in branches:
            node = node.get(branch, {}) if isinstance(node, dict) else {}
        if not isinstance(node, dict) or leaf not in node:
            raise ConfigError(f"configuration: {no_parameter(name, _names())}")
        node[leaf] = value
    return from_dict(tree)
