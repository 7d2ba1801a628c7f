"""Every parameter of the stack on one page: name, unit, default, bound. Branches carry the names of the components
that receive them. ``vsx config`` prints this tree; config/default.yaml is generated from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from vsx_ros.errors import ConfigError

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Factor = Annotated[float, Meta(gt=0, le=1)]
Count = Annotated[int, Meta(ge=1)]


class _Branch(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Common policy: immutable, unknown names refused, keyword only."""


class MountConfig(_Branch, frozen=True):
    """Where the camera sits on the base (T_base_cam)."""

    forward_m: float = -0.09
    left_m: float = 0.0
    height_m: Positive = 0.31
    pitch_down_rad: Annotated[float, Meta(ge=-0.8, le=0.8)] = 0.0
    yaw_left_rad: float = 0.0


class OdometryConfig(_Branch, frozen=True):
    """What the base multiplies way and turn of its wheels by; 'vsx calibrate odometry' finds it."""

    linear_scale: Annotated[float, Meta(ge=0.5, le=2)] = 1.0
    angular_scale: Annotated[float, Meta(ge=0.5, le=2)] = 1.0


class RobotConfig(_Branch, frozen=True):
    """The body."""

    radius_m: Positive = 0.18
    height_m: Positive = 0.45
    mount: MountConfig = MountConfig()
    odometry: OdometryConfig = OdometryConfig()


class LimitsConfig(_Branch, frozen=True):
    """What the time scaling and the follower never exceed; the bounds are about what the bases can do. a_stop_m_s2 is
    for what comes to light too near for a_m_s2: 6 cm from 0.3 m/s instead of 14. The bases stop harder than that, as
    they do for a hazard, but then the images blur."""

    v_m_s: Annotated[float, Meta(gt=0, le=0.7)] = 0.3
    a_m_s2: Annotated[float, Meta(gt=0, le=3)] = 0.4
    jerk_m_s3: Annotated[float, Meta(gt=0, le=100)] = 2.0
    omega_rad_s: Annotated[float, Meta(gt=0, le=3.2)] = 0.4
    alpha_rad_s2: Annotated[float, Meta(gt=0, le=20)] = 1.0
    a_stop_m_s2: Annotated[float, Meta(gt=0, le=3)] = 1.0

    def braking(self, a_m_s2: float) -> LimitsConfig:
        """The limits while braking by a_m_s2: harder than usual it sets in more steeply, too, and where the way bends
        the turn rate falls with the speed."""
        share = max(1.0, a_m_s2 / self.a_m_s2)
        jerk, alpha = share * share * self.jerk_m_s3, share * self.alpha_rad_s2
        return msgspec.structs.replace(self, a_m_s2=share * self.a_m_s2, jerk_m_s3=jerk, alpha_rad_s2=alpha)


class InitializationConfig(_Branch, frozen=True):
    """Two-frame start of the map (paper 3.1). Without odometry the baseline gets unit_baseline_m, and only parallax
    tells whether it is long enough."""

    baseline_m: Positive = 0.20
    baseline_max_m: Positive = 0.6
    unit_baseline_m: Positive = 0.1
    min_matches: Count = 60
    min_parallax_deg: Positive = 0.7
    min_parallax_without_odometry_deg: Positive = 0.25
    max_turn_deg: Positive = 30.0  # more than the planner bends over the baseline (phi 2 rad/m)


class TrackerConfig(_Branch, frozen=True):
    """Per-frame tracking."""

    max_points: Count = 800
    coarse_radius_px: Positive = 30.0
    fine_radius_px: Positive = 10.0
    good_ratio: Ratio = 0.3
    lost_ratio: Ratio = 0.13
    min_found: Count = 30
    lost_after_frames: Count = 3


class KeyframeConfig(_Branch, frozen=True):
    """When a frame becomes a keyframe (paper 3.1: conservative where the map is already known)."""

    min_gap_frames: Count = 4
    distance_ratio: Positive = 0.06
    angle_deg: Positive = 8.0
    overlap_ratio: Ratio = 0.55


class MapperConfig(_Branch, frozen=True):
    """Making, refining and removing points."""

    window_keyframes: Count = 8
    target_keyframes: Count = 3
    max_points_per_keyframe: Count = 400
    min_parallax_deg: Positive = 0.8
    local_iterations: Count = 10
    global_iterations: Count = 10


class CullingConfig(_Branch, frozen=True):
    """A keyframe is redundant when that share of its points is seen by so many others from as near; the newest are
    kept. With 3 viewers, as ORB-SLAM has it, keyframes as near to each other as here are made again at once."""

    seen_ratio: Ratio = 0.9
    viewers: Count = 6
    keep_newest: Count = 10


class ShutterConfig(_Branch, frozen=True):
    """How the camera exposes: its rows one after the other (0: all at once), each for so long. With odometry, images
    are freed from how the camera moves meanwhile. Defaults: the Kinect's colour camera indoors."""

    readout_s: NonNegative = 0.026
    exposure_s: NonNegative = 0.015


class WheelConfig(_Branch, frozen=True):
    """How far wheel odometry between keyframes is believed, per axis: a constant plus a share of the motion; and how
    far the base stands level on the floor. What is wrong with the wheels' diameter is wrong everywhere alike and
    becomes the world's size; what counts here is how unlike one stretch is to the next."""

    distance_sigma_m: Positive = 0.0003
    distance_sigma_ratio: Positive = 0.002
    sideways_sigma_ratio: Positive = 0.006
    turn_sigma_rad: Positive = 0.002
    turn_sigma_ratio: Positive = 0.01
    tilt_sigma_rad: Positive = 0.01
    floor_height_sigma_m: Positive = 0.01
    floor_tilt_sigma_rad: Positive = 0.02


class SlamConfig(_Branch, frozen=True):
    """Keyframe SLAM (paper 3)."""

    initialization: InitializationConfig = InitializationConfig()
    tracker: TrackerConfig = TrackerConfig()
    keyframes: KeyframeConfig = KeyframeConfig()
    mapper: MapperConfig = MapperConfig()
    culling: CullingConfig = CullingConfig()
    wheels: WheelConfig = WheelConfig()
    shutter: ShutterConfig = ShutterConfig()


class PlannerConfig(_Branch, frozen=True):
    """Motion planning (paper 4)."""

    phi_rad_m: Positive = 2.0
    # Beside the body: kept always, and kept where that is no detour.
    clearance_m: NonNegative = 0.04
    preferred_clearance_m: NonNegative = 0.15
    max_reverse_m: NonNegative = 1.5
    # What the tracker needs in view, how fast to drive where it is not, and how far at most in one go.
    sight_landmarks: Count = 20
    sight_fov_rad: Annotated[float, Meta(gt=0, lt=3.14)] = 1.05
    sight_range_m: Positive = 5.0
    blind_v_m_s: Positive = 0.2
    max_blind_m: NonNegative = 2.0


class FollowerConfig(_Branch, frozen=True):
    """Following a timed trajectory."""

    stiffness_rad_m: Positive = 5.0
    max_lateral_error_m: Positive = 0.12
    max_heading_error_rad: Positive = 0.25
    pose_timeout_s: Positive = 0.5
    # Speed while tracking is dubious (state POOR), as a share of the planned one, and how long it stays so afterwards.
    dubious_speed_factor: Factor = 0.5
    dubious_hold_s: NonNegative = 1.0
    replans_after_divergence: Annotated[int, Meta(ge=0)] = 2


class GroundMapConfig(_Branch, frozen=True):
    """The 2-D map (paper 5.2)."""

    resolution_m: Positive = 0.05
    obstacle_min_height_m: NonNegative = 0.06
    obstacle_max_height_m: Positive = 0.60
    clear_max_height_m: Positive = 0.40
    max_range_m: Positive = 4.5
    start_clear_m: NonNegative = 0.7


class PlanesConfig(_Branch, frozen=True):
    """Planes of the sparse map by J-linkage (paper 5.1), tile by tile."""

    tile_m: Positive = 3.0
    max_points_per_tile: Count = 1000
    hypotheses: Count = 2000
    noise_px: Positive = 0.4
    floor_sigma_m: Positive = 0.01
    inlier_sigmas: Positive = 2.5
    max_distance_m: Positive = 0.08
    max_sigma_m: Positive = 0.3
    partner_sigma_m: Positive = 0.8
    min_separation_m: Positive = 0.10
    min_points: Count = 15


class DenseConfig(_Branch, frozen=True):
    """Dense planar mapping (paper 5.1). Textures are standard deviations, in grey levels, of what a cell shows."""

    enabled: bool = True
    planes: PlanesConfig = PlanesConfig()
    cell_m: Positive = 0.08
    patch_m: Positive = 0.12
    min_texture: NonNegative = 1.0
    accept_zncc: Ratio = 0.75
    grow_zncc: Ratio = 0.65
    rival_margin: Ratio = 0.05
    min_views: Count = 3
    min_parallax_deg: Positive = 2.0
    max_parallax_deg: Positive = 30.0
    min_range_m: Positive = 0.4
    max_range_m: Positive = 4.5
    max_incidence_deg: Annotated[float, Meta(gt=0, lt=90)] = 80.0
    contact_contrast: NonNegative = 5.0
    contact_step: Positive = 1.2
    contact_min_views: Count = 3
    contact_max_support_m: Positive = 0.3
    max_fill_height_m: Positive = 0.6
    cells_per_update: Count = 3000


class ExplorationConfig(_Branch, frozen=True):
    """Frontiers, views and the mission (paper 5.2)."""

    ranker: str = "views"
    sensor_range_m: Positive = 3.0
    sensor_fov_rad: Positive = 1.05
    mean_free_path_m: Positive = 1.0
    init_drive_m: Annotated[float, Meta(gt=0, le=1)] = 0.45
    init_attempts: Count = 4
    min_frontier_m: NonNegative = 0.25
    min_gain_m2: NonNegative = 0.08
    min_utility_m: NonNegative = 0.03
    stop_cost_m: Positive = 2.0
    look_range_m: Positive = 3.0
    looks_to_half: Positive = 1.5
    wall_gap_m: Positive = 1.0
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


class ComputingConfig(_Branch, frozen=True):
    """What computing costs in lock-step, in emulated time: a frame, from its stamp to its pose being known; a ranking
    of views, at least and per known ground; a plan, at least and per metre of the way. Twice the processor time that
    benchmarks/computing.py measures: on a laptop of two cores SLAM runs on them, too."""

    frame_ms: NonNegative = 60.0
    ranking_ms: NonNegative = 60.0
    ranking_ms_m2: NonNegative = 1.3
    plan_ms: NonNegative = 40.0
    plan_ms_m: NonNegative = 11.0


class Config(_Branch, frozen=True):
    """The whole tree."""

    robot: RobotConfig = RobotConfig()
    limits: LimitsConfig = LimitsConfig()
    slam: SlamConfig = SlamConfig()
    planner: PlannerConfig = PlannerConfig()
    follower: FollowerConfig = FollowerConfig()
    ground_map: GroundMapConfig = GroundMapConfig()
    dense: DenseConfig = DenseConfig()
    exploration: ExplorationConfig = ExplorationConfig()
    computing: ComputingConfig = ComputingConfig()


def from_dict(tree: dict[str, Any]) -> Config:
    """The configuration of a nested dict; missing entries take their default.

    Raises ConfigError naming the entry, e.g. ``Expected `float` > 0.0 - at `$.planner.phi_rad_m`, not -1``.
    """
    try:
        config: Config = msgspec.convert(tree, Config)
    except msgspec.ValidationError as error:
        wrong = f"{error}{_given(tree, str(error))}"
        raise ConfigError(f"configuration: {wrong}; 'vsx config' prints every name, unit and default") from error
    for name, value in _leaves(to_dict(config)):
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"configuration: {name} is {value}; it needs a finite number")
    return config


def _leaves(tree: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in tree.items():
        yield from _leaves(value, f"{prefix}{name}.") if isinstance(value, dict) else [(prefix + name, value)]


def _given(tree: Any, message: str) -> str:
    """The value that a message of msgspec is about, e.g. ", not -1"; nothing where it is about a whole branch."""
    for name in message.rpartition("`$.")[2].rstrip("`").split("."):
        if not isinstance(tree, dict) or name not in tree:
            return ""
        tree = tree[name]
    return "" if isinstance(tree, dict) else f", not {tree!r:.80}"


def to_dict(config: Config) -> dict[str, Any]:
    """The nested dict that ``from_dict`` reads back to the same configuration."""
    tree: dict[str, Any] = msgspec.to_builtins(config)
    return tree


def overridden(config: Config, assignments: dict[str, Any]) -> Config:
    """A copy with dotted names replaced, e.g. ``{"planner.phi_rad_m": 0.5}``.

    Raises ConfigError for an unknown name or an impossible value.
    """
    tree = to_dict(config)
    for name, value in assignments.items():
        *branches, leaf = name.split(".")
        node = tree
        for branch in branches:
            node = node.get(branch, {}) if isinstance(node, dict) else {}
        if not isinstance(node, dict) or leaf not in node:
            raise ConfigError(f"configuration: there is no parameter {name!r}; 'vsx config' prints every name")
        node[leaf] = value
    return from_dict(tree)
